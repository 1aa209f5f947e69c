//! Recordings: each procedure as MCAP files, with what the gateway decided and what the devices measured.
//!
//! A recording never holds a procedure up. [`Recorder`] is told of each procedure and follows it in a task of its own;
//! [`tape`] writes in a thread behind a bounded queue; [`segment`] is one file and [`topics`] what stands in it. [`read`] reads
//! a file again, also one that a crash cut off.

mod feeds;
mod follow;
pub mod read;
mod scene;
pub mod segment;
pub mod summary;
mod tape;
pub mod topics;

use std::path::PathBuf;
use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use crate::clients::Clients;
use crate::config::Cell;
use crate::journal::Journal;
use crate::procedure::Procedure;
use crate::recording::follow::Follower;
use crate::recording::tape::Tape;

pub use crate::recording::tape::TapeState;

/// Procedures that wait to be recorded; one at a time is under way.
const PROCEDURES_WAITING: usize = 16;

/// Where recordings go, and how large they may become.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The folder.
    pub folder: PathBuf,
    /// A file that reaches this size is followed by another.
    pub segment_max_bytes: u64,
    /// Nothing is recorded while the folder holds as much. Nothing is ever deleted.
    pub folder_max_bytes: u64,
}

/// Why there can be no recordings.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The folder is not there and cannot be made.
    #[error("gateway.recordings {folder} cannot be used")]
    Folder {
        /// Which one.
        folder: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The machine has no thread left.
    #[error("the recorder cannot be started")]
    Thread(#[source] std::io::Error),
}

/// Records procedures; clones are the same one.
#[derive(Clone, Debug)]
pub struct Recorder {
    procedures: mpsc::Sender<watch::Receiver<Procedure>>,
    closing: watch::Sender<bool>,
    state: watch::Receiver<TapeState>,
}

impl Recorder {
    /// Begins to wait for procedures. Must be called within a Tokio runtime.
    pub fn start(
        settings: Settings,
        clients: Clients,
        journal: Arc<dyn Journal>,
        cell: Option<Cell>,
    ) -> Result<Self, RecordingError> {
        let (tape, _) = Tape::start(settings)?;
        let state = tape.state();
        let (procedures, opened) = mpsc::channel(PROCEDURES_WAITING);
        let closing = watch::Sender::new(false);
        let follower = Follower::new(tape, clients, journal, cell);
        tokio::spawn(follower.run(opened, closing.subscribe()));
        Ok(Self {
            procedures,
            closing,
            state,
        })
    }

    /// Ends the file under way, and resolves when everything is written. Nothing is recorded after that.
    pub async fn finish(&self) {
        self.closing.send_replace(true);
        let mut state = self.state.clone();
        // The thread that writes tells its state until it ends.
        while state.changed().await.is_ok() {}
    }

    /// Records this procedure until it is over or interrupted. Never waits.
    pub fn follow(&self, procedure: watch::Receiver<Procedure>) {
        if self.procedures.try_send(procedure).is_err() {
            tracing::warn!("the recorder is gone; the procedure is not recorded");
        }
    }

    /// What is being recorded, and what hinders it.
    pub fn state(&self) -> TapeState {
        self.state.borrow().clone()
    }
}
