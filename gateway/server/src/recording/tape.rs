//! The thread that writes recordings, and the bounded queue to it.
//!
//! Whoever records never waits: when the disk is slow and the queue full, lines are dropped and counted, and the recording
//! says where. When the disk is full the file is ended with a line that says so, and the procedure goes on without.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use arthro_proto::gateway::v1 as proto;
use mcap::McapError;
use prost::Message as _;
use tokio::sync::watch;

use super::segment::{Line, Segment};
use super::topics::Topic;
use super::{RecordingError, Settings};
use crate::wall_clock::now_ns;

/// Lines that wait for the disk; some seconds' worth.
const QUEUE_LINES: usize = 4096;
/// Everything is handed to the system this often: less than this is lost with the process.
const FLUSH_EVERY: Duration = Duration::from_millis(50);
/// How often what was written is made to survive a loss of power.
const SYNC_EVERY: Duration = Duration::from_secs(1);
/// Kept beside a file under way, so that on a full disk there is room to end it.
const RESERVE_BYTES: usize = 64 * 1024;
/// The folder's size is taken anew this often.
const FOLDER_EVERY: Duration = Duration::from_secs(10);

/// What a file is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct About {
    pub procedure_id: String,
    pub case_id: String,
    pub plan_digest: String,
}

/// What the recorder is doing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TapeState {
    /// The file that is being written.
    pub file: Option<PathBuf>,
    /// Its size so far.
    pub file_bytes: u64,
    /// Lines that found no room in the queue.
    pub dropped_lines: u64,
    /// Why the last recording ended early: the stable word and text for a person.
    pub alarm: Option<(&'static str, String)>,
}

/// The end of the queue that whoever records holds.
pub(super) struct Tape {
    orders: SyncSender<Order>,
    state: watch::Sender<TapeState>,
    /// Lines dropped since the last one that found room.
    missing: u64,
    /// Beginnings and ends that found no room yet.
    kept: VecDeque<Order>,
}

enum Order {
    Begin(About),
    Write(Line),
    End,
}

// === impl Tape ===

impl Tape {
    /// Starts the thread. It ends once the tape is dropped and everything is written; then nobody tells the state any more.
    pub fn start(settings: Settings) -> Result<(Self, JoinHandle<()>), RecordingError> {
        fs::create_dir_all(&settings.folder).map_err(|source| RecordingError::Folder {
            folder: settings.folder.clone(),
            source,
        })?;
        remove_reserves(&settings.folder);
        let (orders, received) = sync_channel(QUEUE_LINES);
        let state = watch::Sender::default();
        let writer = Writer {
            settings,
            state: state.clone(),
            about: None,
            open: None,
            context: BTreeMap::new(),
        };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || writer.run(&received))
            .map_err(RecordingError::Thread)?;
        let this = Self {
            orders,
            state,
            missing: 0,
            kept: VecDeque::new(),
        };
        Ok((this, thread))
    }

    /// What the recorder is doing, as it changes.
    pub fn state(&self) -> watch::Receiver<TapeState> {
        self.state.subscribe()
    }

    pub fn begin(&mut self, about: About) {
        self.order(Order::Begin(about));
    }

    pub fn write(&mut self, topic: Topic, at_ns: u64, message: &impl prost::Message) {
        let message = message.encode_to_vec();
        self.order(Order::Write(Line {
            topic,
            at_ns,
            message,
        }));
    }

    pub fn end(&mut self) {
        self.order(Order::End);
    }

    /// Never waits. Beginnings and ends are kept until there is room for them; lines are not, and after a gap the first
    /// one that finds room says how many are missing.
    fn order(&mut self, order: Order) {
        let order = match order {
            Order::Write(_) => Some(order),
            Order::Begin(_) | Order::End => {
                self.kept.push_back(order);
                None
            }
        };
        while let Some(kept) = self.kept.pop_front() {
            if let Err(TrySendError::Full(kept)) = self.orders.try_send(kept) {
                self.kept.push_front(kept);
                if order.is_some() {
                    self.dropped();
                }
                return;
            }
        }
        let Some(order) = order else {
            return;
        };
        if self.missing > 0 {
            let gap = gap_line(self.missing, now_ns());
            match self.orders.try_send(Order::Write(gap)) {
                Ok(()) => self.missing = 0,
                Err(_) => return self.dropped(),
            }
        }
        if let Err(TrySendError::Full(_)) = self.orders.try_send(order) {
            self.dropped();
        }
    }

    fn dropped(&mut self) {
        if self.missing == 0 {
            tracing::warn!("the disk is too slow for the recording; lines are dropped");
        }
        self.missing += 1;
        self.state.send_modify(|state| state.dropped_lines += 1);
    }
}

/// What the thread owns.
struct Writer {
    settings: Settings,
    state: watch::Sender<TapeState>,
    /// The procedure under way; its recording may have ended early.
    about: Option<About>,
    open: Option<Open>,
    /// The last line of the topics that a following file of the same procedure begins with.
    context: BTreeMap<Topic, Line>,
}

struct Open {
    segment: Segment<File>,
    path: PathBuf,
    /// A second handle of the file, for making it survive.
    synced: File,
    synced_at: Instant,
    flushed_at: Instant,
    number: u32,
    folder_at: Instant,
    /// The folder without this file.
    folder_bytes: u64,
}

// === impl Writer ===

impl Writer {
    fn run(mut self, orders: &Receiver<Order>) {
        loop {
            match orders.recv_timeout(FLUSH_EVERY) {
                Ok(Order::Begin(about)) => {
                    self.end();
                    self.context.clear();
                    self.about = Some(about);
                    self.attempt(|this| this.begin());
                }
                Ok(Order::Write(line)) => self.write(line),
                Ok(Order::End) => {
                    self.end();
                    self.about = None;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.end(),
            }
            self.keep_up();
        }
    }

    fn begin(&mut self) -> Result<(), Trouble> {
        let Some(about) = &self.about else {
            return Ok(());
        };
        let folder_bytes = folder_bytes(&self.settings.folder)?;
        if folder_bytes >= self.settings.folder_max_bytes {
            return Err(Trouble::FolderFull {
                bytes: folder_bytes,
                limit: self.settings.folder_max_bytes,
            });
        }
        let (path, number) = next_path(&self.settings.folder, &about.procedure_id)?;
        match open(path.clone(), number, about, self.context.values()) {
            Ok(opened) => {
                self.open = Some(Open {
                    folder_bytes,
                    ..opened
                });
            }
            Err(trouble) => {
                // It holds nothing yet, and its room is needed.
                fs::remove_file(&path).ok();
                fs::remove_file(reserve(&path)).ok();
                return Err(trouble);
            }
        }
        self.tell();
        Ok(())
    }

    fn write(&mut self, line: Line) {
        if matches!(line.topic, Topic::Procedure | Topic::Cell | Topic::AxisList) {
            self.context.insert(line.topic, line.clone());
        }
        self.attempt(|this| match &mut this.open {
            Some(open) => Ok(open.segment.write(&line)?),
            None => Ok(()),
        });
    }

    /// Flushes, syncs, rotates and keeps within the folder's limit, each when it is time.
    fn keep_up(&mut self) {
        self.attempt(|this| {
            let Some(open) = &mut this.open else {
                return Ok(());
            };
            if open.flushed_at.elapsed() < FLUSH_EVERY {
                return Ok(());
            }
            open.segment.flush()?;
            open.flushed_at = Instant::now();
            if open.synced_at.elapsed() >= SYNC_EVERY {
                open.synced.sync_data()?;
                open.synced_at = Instant::now();
            }
            if open.folder_at.elapsed() >= FOLDER_EVERY {
                let all = folder_bytes(&this.settings.folder)?;
                open.folder_bytes = all.saturating_sub(open.segment.whole_bytes());
                open.folder_at = Instant::now();
            }
            let bytes = open.folder_bytes + open.segment.whole_bytes();
            if bytes >= this.settings.folder_max_bytes {
                return Err(Trouble::FolderFull {
                    bytes,
                    limit: this.settings.folder_max_bytes,
                });
            }
            if open.segment.whole_bytes() >= this.settings.segment_max_bytes {
                this.end();
                this.begin()?;
            }
            this.tell();
            Ok(())
        });
    }

    /// Does something to the file; on trouble the recording of this procedure ends, and the file says so.
    fn attempt(&mut self, act: impl FnOnce(&mut Self) -> Result<(), Trouble>) {
        let Err(trouble) = act(self) else {
            return;
        };
        let (reason, detail) = (trouble.reason(), trouble.to_string());
        tracing::warn!(
            reason,
            detail,
            "the recording ends early; the procedure goes on"
        );
        if let Some(open) = self.open.take() {
            let last = event_line(
                proto::RecordedEvent {
                    kind: proto::RecordedEventKind::Recording.into(),
                    reason: reason.to_owned(),
                    detail: detail.clone(),
                    missing_messages: 0,
                },
                now_ns(),
            );
            let reserve = reserve(&open.path);
            let ended = open.segment.give_up(&last, || {
                // If it is gone already, there is no more room than there is.
                fs::remove_file(&reserve).ok();
            });
            if let Err(error) = ended {
                tracing::warn!(%error, "the recording could not even be ended");
            }
        }
        self.state.send_modify(|state| {
            state.file = None;
            state.file_bytes = 0;
            state.alarm = Some((reason, detail));
        });
    }

    fn end(&mut self) {
        let Some(open) = self.open.take() else {
            return;
        };
        let Open { segment, path, .. } = open;
        match segment.finish() {
            Ok(()) => self.state.send_modify(|state| {
                state.file = None;
                state.file_bytes = 0;
            }),
            // What was flushed before is there, and reads like a file of a killed process.
            Err(error) => {
                let trouble = Trouble::from(error);
                tracing::warn!(file = %path.display(), %trouble, "the recording has no index");
                self.state.send_modify(|state| {
                    state.file = None;
                    state.file_bytes = 0;
                    state.alarm = Some((trouble.reason(), trouble.to_string()));
                });
            }
        }
        // A leftover is removed at the next start.
        fs::remove_file(reserve(&path)).ok();
    }

    fn tell(&self) {
        let Some(open) = &self.open else {
            return;
        };
        self.state.send_modify(|state| {
            if state.file.as_ref() != Some(&open.path) {
                tracing::info!(file = %open.path.display(), segment = open.number, "recording");
                state.file = Some(open.path.clone());
                state.alarm = None;
            }
            state.file_bytes = open.segment.whole_bytes();
        });
    }
}

/// A new file with its head and whatever else it begins with.
fn open<'a>(
    path: PathBuf,
    number: u32,
    about: &About,
    context: impl Iterator<Item = &'a Line>,
) -> Result<Open, Trouble> {
    // Never over a file that is there.
    let file = File::options().write(true).create_new(true).open(&path)?;
    fs::write(reserve(&path), vec![0; RESERVE_BYTES])?;
    let head = proto::RecordingHead {
        procedure_id: about.procedure_id.clone(),
        case_id: about.case_id.clone(),
        plan_digest: about.plan_digest.clone(),
        segment: number,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let metadata = BTreeMap::from([
        ("procedure_id".to_owned(), head.procedure_id.clone()),
        ("case_id".to_owned(), head.case_id.clone()),
        ("plan_digest".to_owned(), head.plan_digest.clone()),
        ("segment".to_owned(), number.to_string()),
    ]);
    let synced = file.try_clone()?;
    let mut segment = Segment::begin(file, metadata)?;
    segment.write(&Line {
        topic: Topic::Recording,
        at_ns: now_ns(),
        message: head.encode_to_vec(),
    })?;
    for line in context {
        segment.write(line)?;
    }
    let now = Instant::now();
    Ok(Open {
        segment,
        path,
        synced,
        synced_at: now,
        flushed_at: now,
        number,
        folder_at: now,
        folder_bytes: 0,
    })
}

/// Why a recording ends early.
#[derive(Debug, thiserror::Error)]
enum Trouble {
    #[error("the folder of recordings holds {bytes} bytes; its limit is {limit}")]
    FolderFull { bytes: u64, limit: u64 },
    #[error("the disk takes no more: {0}")]
    DiskFull(io::Error),
    #[error("the file cannot be written: {0}")]
    Failed(String),
}

impl Trouble {
    fn reason(&self) -> &'static str {
        match self {
            Self::FolderFull { .. } => "RECORDINGS_FULL",
            Self::DiskFull(_) => "RECORDING_DISK_FULL",
            Self::Failed(_) => "RECORDING_FAILED",
        }
    }
}

impl From<io::Error> for Trouble {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::StorageFull
            | io::ErrorKind::QuotaExceeded
            | io::ErrorKind::FileTooLarge => Self::DiskFull(error),
            _ => Self::Failed(error.to_string()),
        }
    }
}

impl From<McapError> for Trouble {
    fn from(error: McapError) -> Self {
        match error {
            McapError::Io(error) => error.into(),
            error => Self::Failed(error.to_string()),
        }
    }
}

fn gap_line(missing: u64, at_ns: u64) -> Line {
    event_line(
        proto::RecordedEvent {
            kind: proto::RecordedEventKind::Recording.into(),
            reason: "RECORDING_GAP".to_owned(),
            detail: format!("the disk was too slow: {missing} lines are missing"),
            missing_messages: missing,
        },
        at_ns,
    )
}

fn event_line(event: proto::RecordedEvent, at_ns: u64) -> Line {
    Line {
        topic: Topic::Event,
        at_ns,
        message: event.encode_to_vec(),
    }
}

// === the folder ===

/// `PROCEDURE-001.mcap`, or the number after the last that is there.
fn next_path(folder: &Path, procedure_id: &str) -> io::Result<(PathBuf, u32)> {
    let mut last = 0;
    for entry in fs::read_dir(folder)? {
        let name = entry?.file_name();
        let number = name
            .to_str()
            .and_then(|name| name.strip_prefix(procedure_id)?.strip_prefix('-'))
            .and_then(|rest| rest.strip_suffix(".mcap")?.parse().ok());
        last = last.max(number.unwrap_or(0));
    }
    let number = last + 1;
    Ok((
        folder.join(format!("{procedure_id}-{number:03}.mcap")),
        number,
    ))
}

fn folder_bytes(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        // A file that goes while it is looked at holds nothing.
        bytes += entry?.metadata().map_or(0, |metadata| metadata.len());
    }
    Ok(bytes)
}

fn reserve(path: &Path) -> PathBuf {
    path.with_extension("mcap.reserve")
}

/// Reserves that a killed gateway left.
fn remove_reserves(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "reserve")
        {
            fs::remove_file(path).ok();
        }
    }
}

#[cfg(test)]
mod tests;
