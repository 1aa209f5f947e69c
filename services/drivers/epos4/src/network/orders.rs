//! NMT commands whose end is waited for: the node's heartbeat tells it.

use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::Instant;

use super::Error;
use crate::canopen::nmt;

/// How many are waited for at most.
const MAX_ORDERS: usize = 128;

/// A command under way.
#[derive(Debug)]
pub(super) struct Order {
    pub(super) node_id: u8,
    pub(super) wanted: nmt::State,
    pub(super) timeout: Duration,
    pub(super) reply: oneshot::Sender<Result<Duration, Error>>,
}

/// All that are under way.
#[derive(Debug, Default)]
pub(super) struct Orders {
    waiting: Vec<(Instant, Option<nmt::State>, Order)>,
}

impl Orders {
    /// The command has been sent.
    pub(super) fn begin(&mut self, order: Order) {
        self.waiting
            .retain(|(_, _, order)| !order.reply.is_closed());
        if self.waiting.len() >= MAX_ORDERS {
            let node_id = order.node_id;
            // In every answer: who ordered may be gone, which is no loss here.
            order.reply.send(Err(Error::Busy { node_id })).ok();
            return;
        }
        self.waiting
            .push((Instant::now() + order.timeout, None, order));
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        self.waiting.iter().map(|(deadline, ..)| *deadline).min()
    }

    pub(super) fn on_heartbeat(&mut self, node_id: u8, state: nmt::State, stamp: Duration) {
        let is_done = |(_, heard, order): &mut (Instant, Option<nmt::State>, Order)| {
            if order.node_id == node_id {
                *heard = Some(state);
            }
            order.node_id == node_id && order.wanted == state
        };
        for (_, _, order) in self.waiting.extract_if(.., is_done) {
            order.reply.send(Ok(stamp)).ok();
        }
    }

    pub(super) fn on_time(&mut self, now: Instant) {
        let late = self
            .waiting
            .extract_if(.., |(deadline, ..)| *deadline <= now);
        for (_, heard, order) in late {
            let error = Error::NotInState {
                node_id: order.node_id,
                wanted: order.wanted,
                heard,
                timeout: order.timeout,
            };
            order.reply.send(Err(error)).ok();
        }
    }
}
