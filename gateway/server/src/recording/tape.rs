//! The thread that writes recordings, and the bounded queue to it.
//!
//! Whoever records never waits: when the disk is slow and the queue full, lines are dropped and counted, and the recording
//! says where. When the disk is full the file is ended with a line that says so, and the procedure goes on without.

mod folder;
mod writer;

use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

use arthro_proto::gateway::v1 as proto;
use prost::Message as _;
use tokio::sync::watch;

use self::folder::remove_reserves;
use self::writer::Writer;
use super::segment::Line;
use super::topics::Topic;
use super::{RecordingError, Settings};
use crate::wall_clock::now_ns;

/// Lines that wait for the disk; some seconds' worth.
const QUEUE_LINES: usize = 4096;

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
        let writer = Writer::new(settings, state.clone());
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

#[cfg(test)]
mod tests;
