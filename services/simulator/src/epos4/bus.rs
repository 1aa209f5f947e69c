//! The bus with its drives and everybody else on it: puts frames in one order and carries the cell's time.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use epos4_link::canopen::heartbeat;
use epos4_link::frame::{Frame, Stamped};
use tokio::sync::{Notify, mpsc};
use tokio::time::{Instant, timeout_at};

use super::drives::Drives;
use super::mechanics::Mechanics;

/// The bus. The cell ticks it; members send and hear.
#[derive(Debug)]
pub struct Bus {
    wire: Mutex<Wire>,
    /// A heartbeat came, or a member left.
    beat: Notify,
}

/// One listener and sender. Leaves the bus when dropped.
#[derive(Debug)]
pub struct Member {
    sender: Sender,
    heard: mpsc::Receiver<Stamped>,
}

/// The sending side of a member.
#[derive(Clone, Debug)]
pub struct Sender {
    bus: Arc<Bus>,
    number: u64,
}

#[derive(Debug)]
struct Wire {
    drives: Drives,
    now_s: f64,
    members: HashMap<u64, mpsc::Sender<Stamped>>,
    next_number: u64,
    /// Heartbeats are not waited for until the next one comes.
    gave_up: bool,
}

/// A member that has this many frames unread is put off the bus.
const UNREAD_MAX: usize = 8192;

impl Bus {
    /// A bus with these drives, at cell time 0.
    #[must_use]
    pub fn new(drives: Drives) -> Arc<Self> {
        let wire = Wire {
            drives,
            now_s: 0.0,
            members: HashMap::new(),
            next_number: 0,
            gave_up: false,
        };
        Arc::new(Self {
            wire: Mutex::new(wire),
            beat: Notify::new(),
        })
    }

    /// Lets `dt_s` of cell time pass, up to `now_s`, with what the mechanism does to each drive meanwhile.
    pub fn tick(&self, dt_s: f64, now_s: f64, mechanics: &[Mechanics]) {
        let mut wire = self.wire();
        wire.now_s = now_s;
        let frames = wire.drives.tick(dt_s, now_s, mechanics);
        wire.publish(&frames, None);
    }

    /// Lock step with whoever a drive expects heartbeats of: when one would be missed in the next `dt_s`, waits for it,
    /// at most for `bound` of the wall clock. Who does not send in time is not waited for until the next heartbeat.
    pub async fn wait_for_heartbeats(&self, dt_s: f64, bound: Duration) {
        let deadline = Instant::now() + bound;
        loop {
            let mut beat = std::pin::pin!(self.beat.notified());
            beat.as_mut().enable();
            if !self.wire().owed_a_heartbeat(dt_s) {
                return;
            }
            if timeout_at(deadline, beat).await.is_err() {
                self.wire().gave_up = true;
                return;
            }
        }
    }

    /// The true shafts, quadcounts, in the order of the drives.
    #[must_use]
    pub fn positions_quadcounts(&self) -> Vec<f64> {
        self.wire()
            .drives
            .nodes
            .iter()
            .map(super::Node::position_quadcounts)
            .collect()
    }

    /// Looks at the drives, or does something to them.
    pub fn with_drives<T>(&self, act: impl FnOnce(&mut Drives) -> T) -> T {
        act(&mut self.wire().drives)
    }

    /// How many listen.
    #[must_use]
    pub fn members(&self) -> usize {
        self.wire().members.len()
    }

    /// Joins the bus.
    #[must_use]
    pub fn join(self: &Arc<Self>) -> Member {
        let (sender, heard) = mpsc::channel(UNREAD_MAX);
        let mut wire = self.wire();
        let number = wire.next_number;
        wire.next_number += 1;
        wire.members.insert(number, sender);
        Member {
            sender: Sender {
                bus: Arc::clone(self),
                number,
            },
            heard,
        }
    }

    fn wire(&self) -> MutexGuard<'_, Wire> {
        // Nothing between lock and unlock leaves the wire half changed.
        self.wire.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wire {
    fn owed_a_heartbeat(&self, dt_s: f64) -> bool {
        let runs_out = |node: &super::Node| {
            let patience_s = node.patience_s(self.now_s);
            patience_s.is_some_and(|patience_s| patience_s <= dt_s)
        };
        !self.gave_up && !self.members.is_empty() && self.drives.nodes.iter().any(runs_out)
    }

    /// Shows frames to every member but their sender.
    fn publish(&mut self, frames: &[Frame], sender: Option<u64>) {
        let stamp = Duration::try_from_secs_f64(self.now_s).unwrap_or_default();
        self.members.retain(|number, member| {
            let others = frames.iter().filter(|_| sender != Some(*number));
            let kept = others
                .map(|frame| Stamped {
                    frame: *frame,
                    stamp,
                })
                .all(|frame| member.try_send(frame).is_ok());
            if !kept {
                tracing::warn!(
                    member = number,
                    unread = UNREAD_MAX,
                    "a member does not read and is put off the bus"
                );
            }
            kept
        });
    }
}

impl Sender {
    /// Puts a frame on the bus. Everybody else hears it, then the drives' answers, which this member hears too.
    pub fn send(&self, frame: &Frame) {
        let mut wire = self.bus.wire();
        wire.publish(&[*frame], Some(self.number));
        let now_s = wire.now_s;
        let answers = wire.drives.on_frame(frame, now_s);
        wire.publish(&answers, None);
        if heartbeat::decode(frame).is_some() {
            wire.gave_up = false;
            self.bus.beat.notify_waiters();
        }
    }
}

impl Member {
    /// Its sending side.
    #[must_use]
    pub fn sender(&self) -> Sender {
        self.sender.clone()
    }

    /// The next frame that somebody else sent; none when this member was put off the bus.
    pub async fn heard(&mut self) -> Option<Stamped> {
        self.heard.recv().await
    }

    /// The next frame if there is one already.
    pub fn try_heard(&mut self) -> Option<Stamped> {
        self.heard.try_recv().ok()
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        self.sender.bus.wire().members.remove(&self.sender.number);
        self.sender.bus.beat.notify_waiters();
    }
}
