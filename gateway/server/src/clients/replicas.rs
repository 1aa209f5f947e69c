//! A service that runs several times: which replica takes a call, and what happens when one fails in the middle.
//!
//! Registration and planning only compute, so any replica can do any call and a call that broke can be done again
//! elsewhere. Motion and instrument are one a cell and never stand here. [`pool`] chooses, [`breaker`] keeps away from what
//! fails, [`looks`] looks at every replica's health and asks the DNS again; [`Run`] is a computation that survives its replica.

pub mod addresses;
pub mod breaker;
mod looks;
pub mod pool;
mod run;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use arthro_bootstrap::status;
use arthro_bootstrap::tls::DialError;
use tonic::transport::Channel;
use tonic::{Response, Status};

use self::addresses::Where;
use self::pool::Pool;
use super::channel::Connector;
use super::{COMPUTATION_DEADLINE, Failure, Peer};

pub use self::run::{BegunAnew, Event, Run};

/// How often a call is begun again after its first attempt.
pub const RESTARTS_MAX: u32 = 3;

/// The replicas of one service; clones are the same ones.
#[derive(Clone, Debug)]
pub struct Replicas(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    peer: Peer,
    place: Where,
    connector: Connector,
    pool: Mutex<Pool<Channel>>,
}

/// One call to one replica; counted there until it is dropped.
#[derive(Debug)]
struct Ticket {
    shared: Arc<Shared>,
    address: String,
    settled: bool,
}

/// The attempts of one call.
#[derive(Debug)]
struct Attempts {
    replicas: Replicas,
    deadline: Instant,
    /// Replicas that failed in this call.
    tried: Vec<String>,
    restarts: u32,
}

// === impl Replicas ===

impl Replicas {
    /// Begins to look at the replicas. Must be called within a Tokio runtime.
    pub fn new(peer: Peer, place: Where, connector: Connector) -> Result<Self, DialError> {
        let mut pool = Pool::default();
        if let Where::Listed(addresses) = &place {
            pool.renew(addresses, |address| connector.channel(address))?;
        }
        let this = Self(Arc::new(Shared {
            peer,
            place,
            connector,
            pool: Mutex::new(pool),
        }));
        looks::begin(&this.0);
        Ok(this)
    }

    /// Which service.
    pub(super) fn peer(&self) -> Peer {
        self.0.peer
    }

    /// Makes a call that only computes, elsewhere again if its replica fails or has no room, and answers with what came.
    pub(super) async fn ask<M, F>(
        &self,
        call: impl Fn(Channel, Duration) -> F,
    ) -> Result<M, Failure>
    where
        F: Future<Output = Result<Response<M>, Status>>,
    {
        let mut attempts = Attempts::new(self);
        let (mut ticket, answer) = attempts.answered(&call).await?;
        ticket.answered();
        Ok(answer)
    }

    async fn choose(&self, tried: &[String]) -> Result<(Ticket, Channel), Failure> {
        if self.0.pool().is_empty() {
            self.0.resolve().await;
        }
        let now = Instant::now();
        let chosen = self.0.pool().choose(tried, now);
        match chosen {
            Some((address, channel)) => {
                let ticket = Ticket {
                    shared: self.0.clone(),
                    address,
                    settled: false,
                };
                Ok((ticket, channel))
            }
            None => Err(self.0.nobody(now)),
        }
    }
}

// === impl Shared ===

impl Shared {
    fn pool(&self) -> MutexGuard<'_, Pool<Channel>> {
        // Nothing panics while it is held, and what it guards is whole at any time.
        self.pool.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks the DNS for the addresses of a name. What was known stays if there is no answer.
    async fn resolve(&self) {
        let Where::Named { name, port } = &self.place else {
            return;
        };
        let lookup = tokio::net::lookup_host((name.as_str(), *port));
        let found = match tokio::time::timeout(looks::RESOLVE_LIMIT, lookup).await {
            Ok(Ok(found)) => found,
            Ok(Err(error)) => return tracing::warn!(name, %error, "the name does not resolve"),
            Err(_) => return tracing::warn!(name, "the name was not resolved in time"),
        };
        let mut addresses: Vec<_> = found.map(|address| address.to_string()).collect();
        addresses.sort();
        addresses.dedup();
        if addresses.is_empty() {
            return;
        }
        let renewed = self
            .pool()
            .renew(&addresses, |address| match address.parse() {
                Ok(socket) => self.connector.channel_to(socket, name),
                Err(_) => self.connector.channel(address),
            });
        if let Err(error) = renewed {
            tracing::warn!(name, %error, "an address of the name cannot be used");
        }
    }

    fn nobody(&self, now: Instant) -> Failure {
        let reason = format!("{}_UNAVAILABLE", self.peer);
        let trouble = match &self.place {
            Where::Named { name, .. } if self.pool().is_empty() => {
                format!("the name {name:?} stands for no address")
            }
            _ => self.pool().trouble(now),
        };
        let message = format!("no replica takes the call: {trouble}");
        let service = [("service", self.peer.as_str().to_lowercase())];
        Failure::answered(self.peer, status::unavailable(&reason, message, &service))
    }
}

// === impl Ticket ===

impl Ticket {
    fn answered(&mut self) {
        if !self.settled {
            self.settled = true;
            self.shared.pool().answered(&self.address);
        }
    }

    fn failed(&mut self) {
        self.settled = true;
        self.shared.pool().failed(&self.address, Instant::now());
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.shared
            .pool()
            .over(&self.address, self.settled, Instant::now());
    }
}

// === impl Attempts ===

impl Attempts {
    fn new(replicas: &Replicas) -> Self {
        Self {
            replicas: replicas.clone(),
            deadline: Instant::now() + COMPUTATION_DEADLINE,
            tried: Vec::new(),
            restarts: 0,
        }
    }

    /// The first answer of a replica that gives one.
    async fn answered<M, F>(
        &mut self,
        call: &impl Fn(Channel, Duration) -> F,
    ) -> Result<(Ticket, M), Failure>
    where
        F: Future<Output = Result<Response<M>, Status>>,
    {
        loop {
            let (mut ticket, channel) = self.replicas.choose(&self.tried).await?;
            match call(channel, self.remaining()).await {
                Ok(answer) => return Ok((ticket, answer.into_inner())),
                Err(status) => self.failed(&mut ticket, status)?,
            }
        }
    }

    /// Notes a failure; hands it back if it is the caller's.
    fn failed(&mut self, ticket: &mut Ticket, status: Status) -> Result<(), Failure> {
        let peer = self.replicas.peer();
        let failure = Failure::answered(peer, status);
        let broken = failure.is_unavailable();
        if broken {
            ticket.failed();
        } else {
            ticket.answered();
        }
        let again = (broken || failure.is_exhausted())
            && self.restarts < RESTARTS_MAX
            && !self.remaining().is_zero();
        if !again {
            return Err(failure);
        }
        tracing::warn!(%peer, replica = ticket.address, %failure, "begun anew elsewhere");
        self.tried.push(ticket.address.clone());
        self.restarts += 1;
        Ok(())
    }

    fn remaining(&self) -> Duration {
        self.deadline.saturating_duration_since(Instant::now())
    }
}
