//! The master of a CANopen network: sends the SDO requests of any number of callers, one at a time to each node, and
//! tells what the nodes report by themselves.
//!
//! The network does not run by itself. Its owner calls [`Network::next_event`] again and again; the [`Node`] handles
//! make progress only then. An owner that drops the future of a caller thus knows that nothing of it is sent any more
//! beyond the one request that is on the bus already.

mod node;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, sleep_until};

use crate::bus::{self, CanBus};
use crate::canopen::emcy::Emergency;
use crate::canopen::object::Address;
use crate::canopen::sdo::client::{Failure, Step, Transfer};
use crate::canopen::sdo::{self, AbortCode};
use crate::canopen::{heartbeat, nmt};
use crate::frame::{Frame, Id, Stamped};

pub use self::node::{Node, Nodes};

/// How many requests wait to be taken over by the network.
const REQUEST_QUEUE_LEN: usize = 64;
/// How many requests wait for one node.
const LANE_LEN: usize = 64;

/// The network; see the module.
pub struct Network {
    bus: Box<dyn CanBus>,
    requests: mpsc::Receiver<Request>,
    lanes: BTreeMap<u8, Lane>,
    sdo_timeout: Duration,
    now: Duration,
    heard_at: Instant,
}

/// What nodes and bus report by themselves. Stamps are the time of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event {
    /// A node lives.
    Heartbeat {
        /// Which node.
        node_id: u8,
        /// Its state.
        state: nmt::State,
        /// When.
        stamp: Duration,
    },
    /// An error of a node appeared or went.
    Emergency {
        /// Which node.
        node_id: u8,
        /// What it says.
        emergency: Emergency,
    },
    /// The controller reports an error of the bus.
    BusError {
        /// Class bits of `linux/can/error.h`, e.g. [`Id::ERROR_BUS_OFF`].
        class: u32,
    },
}

/// Why an SDO transfer did not succeed.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Error {
    /// The node does not answer.
    #[error("node {node_id} did not answer the request for {address} within {} s", .timeout.as_secs_f64())]
    NoAnswer {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// The node refused, or broke the protocol.
    #[error("node {node_id}, object {address}: {failure}")]
    Failed {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// How.
        failure: Failure,
    },
    /// The object has another size than its type.
    #[error("node {node_id}, object {address} has {len} bytes, {expected} expected")]
    Size {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
        /// What came.
        len: usize,
        /// What the type has.
        expected: usize,
    },
    /// The node started anew and knows nothing of the request.
    #[error("node {node_id} restarted before it answered the request for {address}")]
    Restarted {
        /// Which node.
        node_id: u8,
        /// Which object.
        address: Address,
    },
    /// Too many requests wait for the node.
    #[error("{LANE_LEN} requests wait for node {node_id} already")]
    Busy {
        /// Which node.
        node_id: u8,
    },
    /// The network is gone.
    #[error("the can network is gone")]
    Gone,
}

impl Error {
    /// The node's abort code, when it refused.
    pub fn abort_code(&self) -> Option<AbortCode> {
        match self {
            Self::Failed {
                failure: Failure::Aborted(code),
                ..
            } => Some(*code),
            _ => None,
        }
    }
}

/// A value and when it was read, on the clock of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reading<T> {
    /// The value.
    pub value: T,
    /// When the answer was on the bus.
    pub stamp: Duration,
}

/// Whether a request waits for those before it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Priority {
    /// After those before it.
    Normal,
    /// Before everything that is not on the bus yet: for quick stop.
    Urgent,
}

#[derive(Debug)]
enum Request {
    Sdo(u8, Priority, Sdo),
    Nmt(nmt::Command, nmt::Target),
}

#[derive(Debug)]
struct Sdo {
    address: Address,
    transfer: Transfer,
    first: [u8; 8],
    reply: oneshot::Sender<Result<Reading<Vec<u8>>, Error>>,
}

/// The requests to one node.
#[derive(Default)]
struct Lane {
    waiting: VecDeque<Sdo>,
    active: Option<Active>,
}

struct Active {
    sdo: Sdo,
    deadline: Instant,
}

// === impl Network ===

impl Network {
    /// The network on a bus, waiting this long for each SDO answer. An answer is a matter of wire and firmware and not of
    /// motion: this is real time, also where the bus carries the time of a simulated cell.
    pub fn new(bus: Box<dyn CanBus>, sdo_timeout: Duration) -> (Self, Nodes) {
        let (sender, requests) = mpsc::channel(REQUEST_QUEUE_LEN);
        (
            Self {
                bus,
                requests,
                lanes: BTreeMap::new(),
                sdo_timeout,
                now: Duration::ZERO,
                heard_at: Instant::now(),
            },
            Nodes::new(sender),
        )
    }

    /// The stamp of the newest frame.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// When the newest frame came, in real time; at first when the network was made.
    pub fn heard_at(&self) -> Instant {
        self.heard_at
    }

    /// Serves the nodes' handles until something is reported. An error is final. Nothing is lost when the future is
    /// dropped.
    pub async fn next_event(&mut self) -> Result<Event, bus::Error> {
        loop {
            let deadline = self
                .lanes
                .values()
                .filter_map(|lane| Some(lane.active.as_ref()?.deadline))
                .min();
            tokio::select! {
                biased;
                Some(request) = self.requests.recv() => self.on_request(request)?,
                received = self.bus.receive() => {
                    if let Some(event) = self.on_frame(received?)? {
                        return Ok(event);
                    }
                }
                () = sleep_until(deadline.unwrap_or_else(Instant::now)), if deadline.is_some() => self.on_timeout()?,
            }
        }
    }

    fn on_request(&mut self, request: Request) -> Result<(), bus::Error> {
        match request {
            Request::Nmt(command, target) => self.bus.send(nmt::encode(command, target)),
            Request::Sdo(node_id, priority, sdo) => {
                let lane = self.lanes.entry(node_id).or_default();
                match priority {
                    Priority::Normal if lane.waiting.len() >= LANE_LEN => {
                        // The caller may be gone, which is no loss here.
                        sdo.reply.send(Err(Error::Busy { node_id })).ok();
                    }
                    Priority::Normal => lane.waiting.push_back(sdo),
                    Priority::Urgent => lane.waiting.push_front(sdo),
                }
                self.begin_next(node_id)
            }
        }
    }

    fn begin_next(&mut self, node_id: u8) -> Result<(), bus::Error> {
        let Some(lane) = self.lanes.get_mut(&node_id) else {
            return Ok(());
        };
        while lane.active.is_none() {
            let Some(sdo) = lane.waiting.pop_front() else {
                break;
            };
            // A caller that is gone does not want it done any more.
            if sdo.reply.is_closed() {
                continue;
            }
            self.bus.send(request_frame(node_id, sdo.first))?;
            lane.active = Some(Active {
                sdo,
                deadline: Instant::now() + self.sdo_timeout,
            });
        }
        Ok(())
    }

    fn on_frame(&mut self, Stamped { frame, stamp }: Stamped) -> Result<Option<Event>, bus::Error> {
        self.now = stamp;
        self.heard_at = Instant::now();
        if let Id::Error(class) = frame.id() {
            return Ok(Some(Event::BusError { class }));
        }
        if let Some((node_id, state)) = heartbeat::decode(&frame) {
            if state == nmt::State::BootUp {
                self.on_restart(node_id)?;
            }
            return Ok(Some(Event::Heartbeat {
                node_id,
                state,
                stamp,
            }));
        }
        if let Some((node_id, emergency)) = Emergency::decode(&frame) {
            return Ok(Some(Event::Emergency { node_id, emergency }));
        }
        let node_id = frame.cob_id().and_then(sdo::responding_node);
        if let (Some(node_id), Ok(response)) = (node_id, <[u8; 8]>::try_from(frame.data())) {
            self.on_response(node_id, response, stamp)?;
        }
        Ok(None)
    }

    fn on_response(
        &mut self,
        node_id: u8,
        response: [u8; 8],
        stamp: Duration,
    ) -> Result<(), bus::Error> {
        let Some(lane) = self.lanes.get_mut(&node_id) else {
            return Ok(());
        };
        let Some(active) = &mut lane.active else {
            return Ok(());
        };
        let outcome = match active.sdo.transfer.on_response(response) {
            Ok(Step::Ignored) => return Ok(()),
            Ok(Step::Send(next)) => {
                active.deadline = Instant::now() + self.sdo_timeout;
                return self.bus.send(request_frame(node_id, next));
            }
            Ok(Step::Done(value)) => Ok(Reading { value, stamp }),
            Err(failure) => {
                if let Failure::Protocol(code) = failure {
                    self.bus
                        .send(request_frame(node_id, active.sdo.transfer.abort(code)))?;
                }
                Err(Error::Failed {
                    node_id,
                    address: active.sdo.address,
                    failure,
                })
            }
        };
        self.finish(node_id, outcome)
    }

    /// A node that has just started does not remember what it was asked.
    fn on_restart(&mut self, node_id: u8) -> Result<(), bus::Error> {
        let active = self
            .lanes
            .get(&node_id)
            .and_then(|lane| lane.active.as_ref());
        match active.map(|active| active.sdo.address) {
            Some(address) => self.finish(node_id, Err(Error::Restarted { node_id, address })),
            None => Ok(()),
        }
    }

    fn on_timeout(&mut self) -> Result<(), bus::Error> {
        let now = Instant::now();
        let late: Vec<(u8, Address, [u8; 8])> = self
            .lanes
            .iter()
            .filter_map(|(node_id, lane)| {
                Some((
                    *node_id,
                    lane.active
                        .as_ref()
                        .filter(|active| active.deadline <= now)?,
                ))
            })
            .map(|(node_id, active)| {
                (
                    node_id,
                    active.sdo.address,
                    active.sdo.transfer.abort(AbortCode::TIMED_OUT),
                )
            })
            .collect();
        for (node_id, address, abort) in late {
            self.bus.send(request_frame(node_id, abort))?;
            self.finish(
                node_id,
                Err(Error::NoAnswer {
                    node_id,
                    address,
                    timeout: self.sdo_timeout,
                }),
            )?;
        }
        Ok(())
    }

    fn finish(
        &mut self,
        node_id: u8,
        outcome: Result<Reading<Vec<u8>>, Error>,
    ) -> Result<(), bus::Error> {
        if let Some(active) = self
            .lanes
            .get_mut(&node_id)
            .and_then(|lane| lane.active.take())
        {
            // The caller may be gone; what it asked for is done all the same.
            active.sdo.reply.send(outcome).ok();
        }
        self.begin_next(node_id)
    }
}

fn request_frame(node_id: u8, request: [u8; 8]) -> Frame {
    Frame::standard(sdo::request_cob_id(node_id), request)
}

#[cfg(test)]
mod tests;
