//! The bus with its drives and everybody else on it: puts frames in one order and carries the cell's time.

mod faults;
mod lock_step;

use std::collections::{HashMap, VecDeque};
use std::future::poll_fn;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use epos4_link::bus::{CanBus, Error};
use epos4_link::canopen::heartbeat;
use epos4_link::frame::{Frame, Stamped};
use tokio::sync::{Notify, mpsc};

use super::drives::Drives;
use super::fault::Fault;
use super::mechanics::Mechanics;

/// The bus. The cell ticks it; members send and hear.
#[derive(Debug)]
pub struct Bus {
    wire: Mutex<Wire>,
    /// A heartbeat came, or a member left.
    beat: Notify,
    /// A fault came, went or met something.
    changed: Notify,
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
    members: HashMap<u64, Host>,
    next_number: u64,
    /// Heartbeats are not waited for until the next one comes.
    gave_up: bool,
}

/// A member as the bus sees it.
#[derive(Debug)]
struct Host {
    heard: mpsc::Sender<Stamped>,
    /// Its controller takes no part in the bus.
    bus_off: bool,
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
            changed: Notify::new(),
        })
    }

    /// Lets `dt_s` of cell time pass, up to `now_s`, with what the mechanism does to each drive meanwhile.
    pub fn tick(&self, dt_s: f64, now_s: f64, mechanics: &[Mechanics]) {
        let mut wire = self.wire();
        wire.now_s = now_s;
        let frames = wire.drives.tick(dt_s, now_s, mechanics);
        wire.publish(&frames, None);
        self.tell_changes(&mut wire);
    }

    /// The bus's clock, s.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.wire().now_s
    }

    /// Puts a member's frame on the bus; what the drives answer. A controller that is bus-off loses it.
    fn put(&self, wire: &mut Wire, number: u64, frame: &Frame) -> Vec<Frame> {
        if wire.members.get(&number).is_some_and(|host| host.bus_off) {
            wire.drives.faults().meet(Fault::BusOff, 1);
            return Vec::new();
        }
        wire.publish(&[*frame], Some(number));
        let now_s = wire.now_s;
        let answers = wire.drives.on_frame(frame, now_s);
        if heartbeat::decode(frame).is_some() {
            wire.gave_up = false;
            self.beat.notify_waiters();
        }
        answers
    }

    fn tell_changes(&self, wire: &mut Wire) {
        if wire.drives.faults().take_changed() {
            self.changed.notify_waiters();
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
        wire.members.insert(
            number,
            Host {
                heard: sender,
                bus_off: false,
            },
        );
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
    /// Shows frames to every member but their sender.
    fn publish(&mut self, frames: &[Frame], sender: Option<u64>) {
        let stamp = self.stamp();
        let mut kept_back = 0;
        self.members.retain(|number, host| {
            if host.bus_off {
                kept_back += frames.len() as u64;
                return true;
            }
            let others = frames.iter().filter(|_| sender != Some(*number));
            let kept = others
                .map(|frame| Stamped {
                    frame: *frame,
                    stamp,
                })
                .all(|frame| host.heard.try_send(frame).is_ok());
            if !kept {
                tracing::warn!(
                    member = number,
                    unread = UNREAD_MAX,
                    "a member does not read and is put off the bus"
                );
            }
            kept
        });
        if kept_back > 0 {
            self.drives.faults().meet(Fault::BusOff, kept_back);
        }
    }

    fn stamp(&self) -> Duration {
        Duration::try_from_secs_f64(self.now_s).unwrap_or_default()
    }
}

impl Sender {
    /// Puts a frame on the bus. Everybody else hears it, then the drives' answers, which this member hears too.
    pub fn send(&self, frame: &Frame) {
        let mut wire = self.bus.wire();
        let answers = self.bus.put(&mut wire, self.number, frame);
        wire.publish(&answers, None);
        self.bus.tell_changes(&mut wire);
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
        let answers = self.sender.bus.put(&mut wire, number, &frame);
        wire.publish(&answers, Some(number));
        self.sender.bus.tell_changes(&mut wire);
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
        self.sender.bus.beat.notify_waiters();
    }
}
