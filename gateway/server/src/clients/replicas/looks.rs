//! Looks at every replica's health once a second, and asks the DNS again now and then, for as long as anybody calls.

use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;
use tonic::Code;
use tonic::transport::Channel;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use super::Shared;
use super::addresses::Where;
use super::pool::Health;
use crate::clients::{Peer, within};

/// How often every replica is looked at.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// A replica that says nothing for so long does not answer. A busy one is asked in vain now and then; that costs it no
/// more than its turn.
const LOOK_LIMIT: Duration = Duration::from_secs(2);
/// How often a name of the DNS is asked for again, in looks.
const LOOKS_A_RESOLUTION: u32 = 10;
/// How long a name of the DNS may take.
pub(super) const RESOLVE_LIMIT: Duration = Duration::from_secs(2);

/// Looks until the replicas are dropped. A service with one listed address is looked at too: the look tells its return.
pub(super) fn begin(shared: &Arc<Shared>) {
    tokio::spawn(look_on(Arc::downgrade(shared)));
}

async fn look_on(replicas: Weak<Shared>) {
    let mut ticks = tokio::time::interval(LOOK_EVERY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut looks: u32 = 0;
    loop {
        ticks.tick().await;
        let Some(shared) = replicas.upgrade() else {
            return;
        };
        if matches!(shared.place, Where::Named { .. }) && looks.is_multiple_of(LOOKS_A_RESOLUTION) {
            shared.resolve().await;
        }
        looks = looks.wrapping_add(1);
        let peer = shared.peer;
        let mut answers = JoinSet::new();
        for (address, channel) in shared.pool().channels() {
            answers.spawn(async move { (address, look(peer, channel).await) });
        }
        // Nobody is kept alive by being looked at.
        drop(shared);
        while let Some(answer) = answers.join_next().await {
            let (Ok((address, health)), Some(shared)) = (answer, replicas.upgrade()) else {
                continue;
            };
            if shared.pool().looked(&address, health) {
                tracing::info!(%peer, replica = address, ?health, "replica changed");
            }
        }
    }
}

async fn look(peer: Peer, channel: Channel) -> Health {
    let request = HealthCheckRequest {
        service: service_of(peer).to_owned(),
    };
    let mut client = HealthClient::new(channel);
    let call = client.check(within(LOOK_LIMIT, request));
    match tokio::time::timeout(LOOK_LIMIT, call).await {
        Ok(Ok(answer)) => match answer.into_inner().status() {
            ServingStatus::Serving => Health::Serving,
            ServingStatus::NotServing => Health::NotServing,
            ServingStatus::Unknown | ServingStatus::ServiceUnknown => Health::Unknown,
        },
        // It is there, but tells nothing of its health.
        Ok(Err(status)) if matches!(status.code(), Code::Unimplemented | Code::NotFound) => {
            Health::Unknown
        }
        Ok(Err(_)) | Err(_) => Health::Unreachable,
    }
}

fn service_of(peer: Peer) -> &'static str {
    match peer {
        Peer::Registration => "arthro.registration.v1.RegistrationService",
        Peer::Planning => "arthro.planning.v1.PlanningService",
        Peer::Motion => "arthro.motion.v1.MotionService",
        Peer::Instrument => "arthro.instrument.v1.InstrumentService",
    }
}
