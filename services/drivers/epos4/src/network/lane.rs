//! The SDO requests to one node: one at a time, as a node has one SDO server.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::Instant;

use super::load::worst_case_bits;
use super::{Error, LANE_LEN, Priority, Reading};
use crate::canopen::object::Address;
use crate::canopen::sdo::client::{Failure, Step, Transfer};
use crate::canopen::sdo::{self, AbortCode};
use crate::frame::Frame;

/// How many segments of a block are given to the bus at once; its queue takes more, but not a whole block.
const BURST: usize = 16;
/// A block that was given up may still be answered by this many frames.
const ANSWERS_OF_A_BLOCK: u8 = 128;

/// A request to a node.
#[derive(Debug)]
pub(super) struct Sdo {
    pub(super) address: Address,
    pub(super) transfer: Transfer,
    pub(super) first: [u8; 8],
    /// Another than that of the network.
    pub(super) timeout: Option<Duration>,
    pub(super) reply: oneshot::Sender<Result<Reading<Vec<u8>>, Error>>,
}

/// The requests to one node.
pub(super) struct Lane {
    node_id: u8,
    timeout: Duration,
    /// How long a burst takes on the bus.
    burst_time: Duration,
    waiting: VecDeque<Sdo>,
    active: Option<Active>,
    /// Answers that may come although nobody waits for them: to a request that was given up, or to another master's.
    owed_answers: u8,
}

struct Active {
    sdo: Sdo,
    timeout: Duration,
    deadline: Instant,
    /// Segments of a block that wait for the bus, and when it takes more.
    outgoing: VecDeque<[u8; 8]>,
    next_burst: Instant,
}

/// What follows for the network.
#[derive(Default)]
pub(super) struct LaneStep {
    /// To be sent.
    pub(super) frames: Vec<Frame>,
    /// An answer came that only a second node can have given.
    pub(super) second_answer: bool,
}

impl Lane {
    pub(super) fn new(node_id: u8, timeout: Duration, bit_rate: u32) -> Self {
        let segment = Frame::standard(sdo::request_cob_id(node_id), [0; 8]);
        let bits = BURST as u32 * worst_case_bits(&segment);
        Self {
            node_id,
            timeout,
            burst_time: Duration::from_secs(bits.into()) / bit_rate.max(1),
            waiting: VecDeque::new(),
            active: None,
            owed_answers: 0,
        }
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        let active = self.active.as_ref()?;
        if active.outgoing.is_empty() {
            return Some(active.deadline);
        }
        Some(active.next_burst)
    }

    pub(super) fn on_request(&mut self, priority: Priority, sdo: Sdo) -> LaneStep {
        match priority {
            Priority::Normal if self.waiting.len() >= LANE_LEN => {
                let node_id = self.node_id;
                // The caller may be gone, which is no loss here.
                sdo.reply.send(Err(Error::Busy { node_id })).ok();
            }
            Priority::Normal => self.waiting.push_back(sdo),
            Priority::Urgent => self.waiting.push_front(sdo),
        }
        self.begin_next(LaneStep::default())
    }

    /// Takes a frame that only the node's SDO server sends.
    pub(super) fn on_response(&mut self, response: [u8; 8], stamp: Duration) -> LaneStep {
        let mut step = LaneStep::default();
        let Some(active) = &mut self.active else {
            step.second_answer = !self.take_owed();
            return step;
        };
        let outcome = match active.sdo.transfer.on_response(response) {
            Ok(Step::Ignored) => {
                step.second_answer = !self.take_owed();
                return step;
            }
            Ok(Step::Send(next)) => {
                active.deadline = Instant::now() + active.timeout;
                step.frames.push(request_frame(self.node_id, next));
                return step;
            }
            Ok(Step::SendAll(all)) => {
                active.outgoing = all.into();
                self.send_burst(&mut step);
                return step;
            }
            Ok(Step::Wait) => {
                active.deadline = Instant::now() + active.timeout;
                return step;
            }
            Ok(Step::SendAndDone(last, value)) => {
                step.frames.push(request_frame(self.node_id, last));
                Ok(Reading { value, stamp })
            }
            Ok(Step::Done(value)) => Ok(Reading { value, stamp }),
            Err(failure) => {
                if let Failure::Protocol(code) = failure {
                    let abort = active.sdo.transfer.abort(code);
                    step.frames.push(request_frame(self.node_id, abort));
                    self.owe_what_may_follow();
                }
                Err(self.failed(failure))
            }
        };
        self.finish(outcome, step)
    }

    /// Another master asks the same node.
    pub(super) fn on_foreign_request(&mut self, request: [u8; 8]) -> LaneStep {
        let is_abort = matches!(sdo::Request::decode(request), sdo::Request::Abort(..));
        if !is_abort {
            self.owed_answers = self.owed_answers.saturating_add(1);
        }
        LaneStep::default()
    }

    /// A node that has just started does not remember what it was asked.
    pub(super) fn on_restart(&mut self) -> LaneStep {
        let Some(active) = &self.active else {
            return LaneStep::default();
        };
        let error = Error::Restarted {
            node_id: self.node_id,
            address: active.sdo.address,
        };
        self.owe_what_may_follow();
        self.finish(Err(error), LaneStep::default())
    }

    /// Sends what waits for the bus, or gives up a request that was not answered.
    pub(super) fn on_time(&mut self, now: Instant) -> LaneStep {
        let mut step = LaneStep::default();
        let Some(active) = &mut self.active else {
            return step;
        };
        if !active.outgoing.is_empty() {
            if active.next_burst <= now {
                self.send_burst(&mut step);
            }
            return step;
        }
        if active.deadline > now {
            return step;
        }
        let abort = active.sdo.transfer.abort(AbortCode::TIMED_OUT);
        step.frames.push(request_frame(self.node_id, abort));
        let error = Error::NoAnswer {
            node_id: self.node_id,
            address: active.sdo.address,
            timeout: active.timeout,
        };
        self.owe_what_may_follow();
        self.finish(Err(error), step)
    }

    fn send_burst(&mut self, step: &mut LaneStep) {
        let Some(active) = &mut self.active else {
            return;
        };
        let now = Instant::now();
        let burst = active.outgoing.len().min(BURST);
        step.frames.extend(
            active
                .outgoing
                .drain(..burst)
                .map(|segment| request_frame(self.node_id, segment)),
        );
        active.next_burst = now + self.burst_time;
        active.deadline = now + active.timeout;
    }

    /// Whether an answer that nobody waits for is explained.
    fn take_owed(&mut self) -> bool {
        let explained = self.owed_answers > 0;
        self.owed_answers = self.owed_answers.saturating_sub(1);
        explained
    }

    fn owe_what_may_follow(&mut self) {
        let is_block = self
            .active
            .as_ref()
            .is_some_and(|active| active.sdo.transfer.is_block());
        let answers = if is_block { ANSWERS_OF_A_BLOCK } else { 1 };
        self.owed_answers = self.owed_answers.saturating_add(answers);
    }

    fn failed(&self, failure: Failure) -> Error {
        let address = self.active.as_ref().map(|active| active.sdo.address);
        Error::Failed {
            node_id: self.node_id,
            address: address.unwrap_or(Address::new(0, 0)),
            failure,
        }
    }

    fn finish(&mut self, outcome: Result<Reading<Vec<u8>>, Error>, step: LaneStep) -> LaneStep {
        if let Some(active) = self.active.take() {
            // The caller may be gone; what it asked for is done all the same.
            active.sdo.reply.send(outcome).ok();
        }
        self.begin_next(step)
    }

    fn begin_next(&mut self, mut step: LaneStep) -> LaneStep {
        while self.active.is_none() {
            let Some(sdo) = self.waiting.pop_front() else {
                break;
            };
            // A caller that is gone does not want it done any more.
            if sdo.reply.is_closed() {
                continue;
            }
            step.frames.push(request_frame(self.node_id, sdo.first));
            let (now, timeout) = (Instant::now(), sdo.timeout.unwrap_or(self.timeout));
            self.active = Some(Active {
                sdo,
                timeout,
                deadline: now + timeout,
                outgoing: VecDeque::new(),
                next_burst: now,
            });
        }
        step
    }
}

fn request_frame(node_id: u8, request: [u8; 8]) -> Frame {
    Frame::standard(sdo::request_cob_id(node_id), request)
}
