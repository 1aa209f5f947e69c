//! The bus with its drives and everybody else on it: puts frames in one order and carries the cell's time.

use std::collections::{HashMap, VecDeque};
use std::future::poll_fn;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use epos4_link::bus::{CanBus, Error};
use epos4_link::frame::{Frame, Stamped};
use tokio::sync::mpsc;

use super::drives::Drives;
use super::shaft::Mechanics;

/// The bus. The cell ticks it; members send and hear.
#[derive(Debug)]
pub struct Bus {
    wire: Mutex<Wire>,
}

/// One listener and sender. Leaves the bus when dropped.
#[derive(Debug)]
pub struct Member {
    sender: Sender,
    heard: mpsc::Receiver<Stamped>,
    /// What comes before that: taken over by the last [`CanBus::send`], with the answers to it.
    earlier: VecDeque<Stamped>,
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
        };
        Arc::new(Self {
            wire: Mutex::new(wire),
        })
    }

    /// Lets `dt_s` of cell time pass, up to `now_s`, with what the mechanism does to each drive meanwhile.
    pub fn tick(&self, dt_s: f64, now_s: f64, mechanics: &[Mechanics]) {
        let mut wire = self.wire();
        wire.now_s = now_s;
        let frames = wire.drives.tick(dt_s, now_s, mechanics);
        wire.publish(&frames, None);
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
            earlier: VecDeque::new(),
        }
    }

    fn wire(&self) -> MutexGuard<'_, Wire> {
        // Nothing between lock and unlock leaves the wire half changed.
        self.wire.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wire {
    fn stamp(&self) -> Duration {
        Duration::try_from_secs_f64(self.now_s).unwrap_or_default()
    }

    /// Shows frames to every member but their sender.
    fn publish(&mut self, frames: &[Frame], sender: Option<u64>) {
        let stamp = self.stamp();
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
        poll_fn(|context| self.poll_receive(context)).await.ok()
    }
}

impl CanBus for Member {
    /// As [`Sender::send`], but the answers are there when this returns and wake nobody: who sends asks for them next.
    fn send(&mut self, frame: Frame) -> Result<(), Error> {
        let number = self.sender.number;
        let mut wire = self.sender.bus.wire();
        // Nobody publishes meanwhile: the order on the wire is kept.
        while let Ok(heard) = self.heard.try_recv() {
            self.earlier.push_back(heard);
        }
        if self.earlier.len() >= UNREAD_MAX || !wire.members.contains_key(&number) {
            wire.members.remove(&number);
            return Err(put_off());
        }
        wire.publish(&[frame], Some(number));
        let now_s = wire.now_s;
        let answers = wire.drives.on_frame(&frame, now_s);
        wire.publish(&answers, Some(number));
        let stamp = wire.stamp();
        let answers = answers.into_iter().map(|frame| Stamped { frame, stamp });
        self.earlier.extend(answers);
        Ok(())
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, Error>> {
        if let Some(heard) = self.earlier.pop_front() {
            return Poll::Ready(Ok(heard));
        }
        let heard = self.heard.poll_recv(context);
        heard.map(|heard| heard.ok_or_else(put_off))
    }
}

fn put_off() -> Error {
    Error::Closed("too slow to read the bus, and put off it".to_owned())
}

impl Drop for Member {
    fn drop(&mut self) {
        self.sender.bus.wire().members.remove(&self.sender.number);
    }
}
