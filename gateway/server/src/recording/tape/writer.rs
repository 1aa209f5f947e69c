//! The thread that writes recordings: one file after the other, flushed and kept from filling the disk.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use arthro_proto::gateway::v1 as proto;
use mcap::McapError;
use prost::Message as _;
use tokio::sync::watch;

use super::folder::{folder_bytes, next_path, reserve};
use super::{About, Order, TapeState, event_line};
use crate::recording::Settings;
use crate::recording::segment::{Line, Segment};
use crate::recording::topics::Topic;
use crate::wall_clock::now_ns;

/// Everything is handed to the system this often: less than this is lost with the process.
const FLUSH_EVERY: Duration = Duration::from_millis(50);
/// How often what was written is made to survive a loss of power.
const SYNC_EVERY: Duration = Duration::from_secs(1);
/// Kept beside a file under way, so that on a full disk there is room to end it.
const RESERVE_BYTES: usize = 64 * 1024;
/// The folder's size is taken anew this often.
const FOLDER_EVERY: Duration = Duration::from_secs(10);

/// What the thread owns.
pub(super) struct Writer {
    settings: Settings,
    pub(super) state: watch::Sender<TapeState>,
    /// The procedure under way; its recording may have ended early.
    pub(super) about: Option<About>,
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
    pub(super) fn new(settings: Settings, state: watch::Sender<TapeState>) -> Self {
        Self {
            settings,
            state,
            about: None,
            open: None,
            context: BTreeMap::new(),
        }
    }

    pub(super) fn run(mut self, orders: &Receiver<Order>) {
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

    pub(super) fn begin(&mut self) -> Result<(), Trouble> {
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

    pub(super) fn write(&mut self, line: Line) {
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
    pub(super) fn attempt(&mut self, act: impl FnOnce(&mut Self) -> Result<(), Trouble>) {
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

    pub(super) fn end(&mut self) {
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
pub(super) enum Trouble {
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
