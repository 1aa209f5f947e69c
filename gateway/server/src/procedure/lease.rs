//! The gateway's right to command: one lease on the arms, one on the drives, kept by a task of its
//! own, so that no slow step or write lets them run out.

use std::time::Duration;

use arthro_proto::common::v1::Authorization;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior};

use crate::clients::{Clients, Failure, Peer};

/// A lease that is not renewed within this time is lost.
pub const TTL: Duration = Duration::from_secs(2);
/// How often both leases are renewed: four times within their life.
pub const RENEWAL_PERIOD: Duration = Duration::from_millis(500);

/// Command of both device services. Dropping it ends the renewals, and the services stop their devices when the leases
/// run out.
#[derive(Debug)]
pub struct Command {
    clients: Clients,
    tokens: Tokens,
    lost: watch::Receiver<Option<Failure>>,
    renewing: JoinHandle<()>,
}

#[derive(Clone, Copy, Debug)]
struct Tokens {
    motion: u64,
    instrument: u64,
}

/// What to do while somebody else holds a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WhenHeld {
    /// Give up at once.
    Refuse,
    /// Wait until a lease that nobody renews has run out: after an interruption it may be our own.
    WaitOneTtl,
}

impl Command {
    /// Takes command of both services.
    pub async fn acquire(
        clients: Clients,
        holder: &str,
        when_held: WhenHeld,
    ) -> Result<Self, Failure> {
        let ttl_s = TTL.as_secs_f64();
        let motion = patiently(when_held, || clients.motion.acquire(holder, ttl_s)).await?;
        let instrument =
            match patiently(when_held, || clients.instrument.acquire(holder, ttl_s)).await {
                Ok(token) => token,
                Err(failure) => {
                    // Best effort: it runs out by itself.
                    clients.motion.release(motion).await.ok();
                    return Err(failure);
                }
            };
        let tokens = Tokens { motion, instrument };
        let (losing, lost) = watch::channel(None);
        let renewing = tokio::spawn(keep(clients.clone(), tokens, losing));
        Ok(Self {
            clients,
            tokens,
            lost,
            renewing,
        })
    }

    /// For a command to an arm.
    pub fn of_motion(&self, operation_id: String) -> Authorization {
        Authorization {
            fencing_token: self.tokens.motion,
            operation_id,
        }
    }

    /// For a command to a drive.
    pub fn of_instrument(&self, operation_id: String) -> Authorization {
        Authorization {
            fencing_token: self.tokens.instrument,
            operation_id,
        }
    }

    /// Resolves when a lease could not be kept, with the reason.
    pub async fn lost(&self) -> Failure {
        let mut lost = self.lost.clone();
        loop {
            if let Some(failure) = lost.borrow_and_update().clone() {
                return failure;
            }
            if lost.changed().await.is_err() {
                // The renewing task only ends after it has said why, or with this value.
                std::future::pending::<()>().await;
            }
        }
    }

    /// Gives both leases back; a lease that cannot be given back runs out.
    pub async fn release(self) {
        self.renewing.abort();
        let (motion, instrument) = tokio::join!(
            self.clients.motion.release(self.tokens.motion),
            self.clients.instrument.release(self.tokens.instrument),
        );
        for failure in [motion.err(), instrument.err()].into_iter().flatten() {
            tracing::info!(%failure, "lease not given back; it runs out");
        }
    }
}

impl Drop for Command {
    fn drop(&mut self) {
        self.renewing.abort();
    }
}

/// Renews until a service refuses, or does not answer for as long as a lease lives.
async fn keep(clients: Clients, tokens: Tokens, losing: watch::Sender<Option<Failure>>) {
    let failure = tokio::select! {
        failure = keep_one(Peer::Motion, || clients.motion.renew(tokens.motion)) => failure,
        failure = keep_one(Peer::Instrument, || clients.instrument.renew(tokens.instrument)) => failure,
    };
    tracing::warn!(%failure, "lease lost");
    losing.send_replace(Some(failure));
}

async fn keep_one<F>(peer: Peer, renew: impl Fn() -> F) -> Failure
where
    F: Future<Output = Result<(), Failure>>,
{
    let mut ticks = tokio::time::interval(RENEWAL_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut held_until = Instant::now() + TTL;
    loop {
        ticks.tick().await;
        let asked_at = Instant::now();
        match tokio::time::timeout_at(held_until, renew()).await {
            Ok(Ok(())) => held_until = asked_at + TTL,
            Ok(Err(failure)) if failure.is_unavailable() && Instant::now() < held_until => {}
            Ok(Err(failure)) => return failure,
            Err(_) => return Failure::silent(peer, TTL),
        }
    }
}

async fn patiently<F>(when_held: WhenHeld, acquire: impl Fn() -> F) -> Result<u64, Failure>
where
    F: Future<Output = Result<u64, Failure>>,
{
    // One period more than the life of a lease, for the time the answers take.
    let give_up_at = Instant::now() + TTL + RENEWAL_PERIOD;
    loop {
        match acquire().await {
            Err(failure)
                if failure.reason() == "LEASE_HELD"
                    && when_held == WhenHeld::WaitOneTtl
                    && Instant::now() < give_up_at =>
            {
                tokio::time::sleep(RENEWAL_PERIOD / 2).await;
            }
            answer => return answer,
        }
    }
}
