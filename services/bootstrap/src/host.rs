//! What a service is given by the server that hosts it: the signal to go down, and word of calls that never reached it.

use std::net::SocketAddr;

use tokio::sync::broadcast;

use crate::drain::{Drain, DrainSource};
use crate::identity::Caller;

/// A subscriber that falls this far behind is told how many it has missed.
const REFUSALS_KEPT: usize = 1024;

/// The server around a service. Clones are the same one.
#[derive(Clone, Debug)]
pub struct Host {
    /// Tells owner tasks and streams that the server is going down.
    pub drain: Drain,
    reports: Reports,
}

/// A call that was answered before it reached the service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefusedCall {
    /// Who called; nobody, where it did not come to that.
    pub caller: Option<Caller>,
    /// Where from.
    pub peer: Option<SocketAddr>,
    /// The method's path, `/package.Service/Method`.
    pub method: String,
    /// The stable word of the refusal.
    pub reason: String,
    /// What the caller was told.
    pub message: String,
}

/// Where refusals are reported.
#[derive(Clone, Debug)]
pub(crate) struct Reports {
    refusals: broadcast::Sender<RefusedCall>,
}

// === impl Host ===

impl Host {
    pub(crate) fn new(drain: Drain) -> Self {
        Self {
            drain,
            reports: Reports::new(),
        }
    }

    pub(crate) fn channel() -> (DrainSource, Self) {
        let (source, drain) = Drain::channel();
        (source, Self::new(drain))
    }

    /// A host that never goes down and refuses nothing, for tests and for parts that run without a server.
    pub fn alone() -> Self {
        Self::new(Drain::never())
    }

    /// The calls that are refused from now on.
    pub fn refusals(&self) -> broadcast::Receiver<RefusedCall> {
        self.reports.refusals.subscribe()
    }

    pub(crate) fn reports(&self) -> Reports {
        self.reports.clone()
    }
}

// === impl Reports ===

impl Reports {
    pub(crate) fn new() -> Self {
        Self {
            refusals: broadcast::Sender::new(REFUSALS_KEPT),
        }
    }

    pub(crate) fn refused(&self, call: RefusedCall) {
        tracing::warn!(
            method = call.method,
            reason = call.reason,
            caller = call.caller.as_ref().map(Caller::name),
            peer = call.peer.map(tracing::field::display),
            "call refused: {}",
            call.message
        );
        // Nobody needs to listen.
        self.refusals.send(call).ok();
    }
}
