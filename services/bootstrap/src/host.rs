//! What a service is given by the server that hosts it: the signal to go down, and word of calls that never reached it.

use std::net::SocketAddr;

use tokio::sync::broadcast;

use crate::drain::{Drain, DrainSource};
use crate::identity::Caller;
use crate::tls::Credentials;

/// A subscriber that falls this far behind is told how many it has missed.
const REPORTS_KEPT: usize = 1024;

/// The server around a service. Clones are the same one.
#[derive(Clone, Debug)]
pub struct Host {
    /// Tells owner tasks and streams that the server is going down.
    pub drain: Drain,
    /// With which others are called: the server's own certificate; `None` without TLS.
    pub credentials: Option<Credentials>,
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

/// A stop of a certified caller that was handed to the service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StopCall {
    /// Who called.
    pub caller: Caller,
    /// Where from.
    pub peer: Option<SocketAddr>,
    /// The method's path.
    pub method: String,
    /// Whether the service confirmed it.
    pub done: bool,
}

/// Where refusals and stops are reported.
#[derive(Clone, Debug)]
pub(crate) struct Reports {
    refusals: broadcast::Sender<RefusedCall>,
    stops: broadcast::Sender<StopCall>,
}

// === impl Host ===

impl Host {
    fn new(drain: Drain, credentials: Option<Credentials>) -> Self {
        Self {
            drain,
            credentials,
            reports: Reports::new(),
        }
    }

    pub(crate) fn channel(credentials: Option<Credentials>) -> (DrainSource, Self) {
        let (source, drain) = Drain::channel();
        (source, Self::new(drain, credentials))
    }

    /// A host that never goes down and refuses nothing, for tests and for parts that run without a server.
    pub fn alone() -> Self {
        Self::new(Drain::never(), None)
    }

    /// The calls that are refused from now on.
    pub fn refusals(&self) -> broadcast::Receiver<RefusedCall> {
        self.reports.refusals.subscribe()
    }

    /// The stops of certified callers from now on, carried out or failed.
    pub fn stops(&self) -> broadcast::Receiver<StopCall> {
        self.reports.stops.subscribe()
    }

    pub(crate) fn reports(&self) -> Reports {
        self.reports.clone()
    }
}

// === impl Reports ===

impl Reports {
    pub(crate) fn new() -> Self {
        Self {
            refusals: broadcast::Sender::new(REPORTS_KEPT),
            stops: broadcast::Sender::new(REPORTS_KEPT),
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

    pub(crate) fn stopped(&self, call: StopCall) {
        tracing::info!(
            method = call.method,
            caller = call.caller.name(),
            peer = call.peer.map(tracing::field::display),
            done = call.done,
            "stop called"
        );
        self.stops.send(call).ok();
    }
}
