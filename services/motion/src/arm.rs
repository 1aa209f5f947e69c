//! One arm and its owner: a task that alone talks to the controller, one command for each state.
//!
//! Others hold an [`ArmHandle`]. A move belongs to the owner and the lease, never to the call that
//! asked for it; a stop passes by every queue.

#[cfg(test)]
pub(crate) mod fake;
mod motion;
mod owner;
mod pilot;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Duration;

use arthro_authority::Operation;
use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Tool};
use tokio::sync::{mpsc, oneshot, watch};
use ur_link::{RobotLink, RobotMode, SafetyMode};

pub use self::owner::Owner;
use crate::cell::Berth;
use crate::command::{Authorization, Begun, Commander, Progress};
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::plan::Move;
use crate::rcm::{Placement, Portal};

/// Requests that may wait for the next controller cycle.
const WAITING_REQUESTS: usize = 16;

/// What an owner is started with.
#[derive(Clone, Debug)]
pub struct ArmOptions {
    /// For people: "forceps" or "arthroscope".
    pub name: &'static str,
    /// host:port of the controller, for people.
    pub address: String,
    /// The arm and its tool.
    pub arm: ToolArm,
    /// Its limits.
    pub limits: Limits,
    /// Where it stands in the cell.
    pub berth: Berth,
    /// The portal, if it is known from the start.
    pub portal: Option<Portal>,
    /// The controller's period as far as it is known without a link, s.
    pub period_s: f64,
    /// Wall time without a state after which a moving arm is told to stop and a fault latched. The limit by the
    /// controller's clock is `limits.stale_s`; a dead link shows on the wall clock alone.
    pub silence: Duration,
    /// Wall time between two attempts to connect.
    pub reconnect: Duration,
}

/// Makes links to the controller, again and again. A new link never moves anything.
pub trait Connect: Send + 'static {
    /// What it makes.
    type Link: RobotLink;

    /// Connects once.
    fn connect(&mut self) -> impl Future<Output = Result<Self::Link, ur_link::Error>> + Send;
}

/// Asks the owner of an arm. Clones ask the same owner.
#[derive(Clone)]
pub struct ArmHandle {
    options: Arc<ArmOptions>,
    commander: Commander,
    requests: mpsc::Sender<Request>,
    stop: Arc<watch::Sender<StopOrder>>,
    published: watch::Receiver<Published>,
}

/// What the owner publishes each controller cycle.
#[derive(Clone, Debug, Default)]
pub struct Published {
    /// Whether the link is up; if not, `state` is the last one known.
    pub connected: bool,
    /// The arm; none before the first link.
    pub state: Option<ArmState>,
    /// The portal in force.
    pub portal: Option<Portal>,
    /// The number of the last stop order that was carried out.
    stops_served: u64,
}

/// What was measured of an arm in one controller cycle, and what the owner makes of it.
#[derive(Clone, Debug)]
pub struct ArmState {
    /// Controller clock, s.
    pub time_s: f64,
    /// Measured joints, rad.
    pub joints_rad: Joints,
    /// From measured joints.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Power and brakes.
    pub robot_mode: RobotMode,
    /// The controller's safety system.
    pub safety_mode: SafetyMode,
    /// Whether a move runs or is being stopped.
    pub moving: bool,
    /// Whether the tip is beyond the portal.
    pub inside: bool,
    /// To the portal, once it is set.
    pub placement: Option<Placement>,
    /// Latched until it is recovered.
    pub fault: Option<Fault>,
    /// What comes near to a limit while it lasts; the arm goes on.
    pub warning: Option<Fault>,
    /// 0 .. 1.
    pub speed_scaling: f64,
    /// The move under way.
    pub operation_id: Option<String>,
    /// Whether the link is up; if not, this is what was measured last.
    pub connected: bool,
    /// States of the controller that did not come since the link was made.
    pub states_missed: u64,
}

/// Why an arm does not move until somebody recovers it, or what may become such a reason.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// A stable word.
    pub reason: &'static str,
    /// With value and limit.
    pub detail: String,
}

/// A move that was accepted, now or before.
pub enum Accepted {
    /// It runs; the last progress has its outcome.
    Running {
        /// Follows it.
        progress: watch::Receiver<Progress>,
        /// Whether it had been asked for before.
        repeated: bool,
    },
    /// It had been asked for before and has ended.
    Ended(Operation),
}

#[derive(Clone, Debug, Default)]
struct StopOrder {
    number: u64,
    reason: String,
}

type MoveReply = oneshot::Sender<Result<watch::Receiver<Progress>, Error>>;
type DoneReply = oneshot::Sender<Result<(), Error>>;

enum Request {
    Move {
        by: Authorization,
        wanted: Move,
        reply: MoveReply,
    },
    SetPortal {
        by: Authorization,
        portal: Portal,
        reply: DoneReply,
    },
    RecoverFault {
        by: Authorization,
        reply: DoneReply,
    },
}

impl ArmOptions {
    /// The owner, whose `run` somebody must poll, and the handle to it.
    pub fn start<C: Connect>(self, connector: C, commander: Commander) -> (ArmHandle, Owner<C>) {
        let (requests, waiting) = mpsc::channel(WAITING_REQUESTS);
        let (stop, stop_orders) = watch::channel(StopOrder::default());
        let (publish, published) = watch::channel(Published {
            portal: self.portal,
            ..Published::default()
        });
        let options = Arc::new(self);
        let owner = Owner::new(
            options.clone(),
            connector,
            commander.clone(),
            waiting,
            stop_orders,
            publish,
        );
        let handle = ArmHandle {
            options,
            commander,
            requests,
            stop: Arc::new(stop),
            published,
        };
        (handle, owner)
    }
}

impl ArmHandle {
    /// What the arm was started with.
    pub fn options(&self) -> &ArmOptions {
        &self.options
    }

    /// What is published each controller cycle.
    pub fn published(&self) -> watch::Receiver<Published> {
        self.published.clone()
    }

    /// Begins a move. `command` is the request encoded, to tell a repetition from a mix-up.
    pub async fn begin(
        &self,
        by: Authorization,
        command: &[u8],
        wanted: Move,
    ) -> Result<Accepted, Error> {
        if let Begun::Repeated(operation, progress) = self.commander.begin(&by, command)? {
            return Ok(match progress {
                Some(progress) => Accepted::Running {
                    progress,
                    repeated: true,
                },
                None => Accepted::Ended(operation),
            });
        }
        let progress = self
            .ask(|reply| Request::Move { by, wanted, reply })
            .await??;
        Ok(Accepted::Running {
            progress,
            repeated: false,
        })
    }

    /// States where the portal is.
    pub async fn set_portal(
        &self,
        by: Authorization,
        command: &[u8],
        portal: impl Into<Portal>,
    ) -> Result<(), Error> {
        match self.commander.begin(&by, command)? {
            Begun::Repeated(operation, _) => answered_before(operation),
            Begun::New => {
                let portal = portal.into();
                self.ask(|reply| Request::SetPortal { by, portal, reply })
                    .await?
            }
        }
    }

    /// Clears the latched fault if its cause is gone.
    pub async fn recover_fault(&self, by: Authorization, command: &[u8]) -> Result<(), Error> {
        match self.commander.begin(&by, command)? {
            Begun::Repeated(operation, _) => answered_before(operation),
            Begun::New => {
                self.ask(|reply| Request::RecoverFault { by, reply })
                    .await?
            }
        }
    }

    /// Stops the arm; returns once the order has gone out to the controller, or when there is no link.
    pub async fn stop(&self, reason: String) {
        let mut number = 0;
        self.stop.send_modify(|order| {
            order.number += 1;
            order.reason = reason;
            number = order.number;
        });
        let mut published = self.published.clone();
        // The owner is gone when this fails, and with it the link: the controller stops by itself.
        published
            .wait_for(|published| published.stops_served >= number)
            .await
            .ok();
    }

    /// Hands a request to the owner. Between beginning an operation and this there is no await, so
    /// that a call that is dropped leaves no operation behind that nobody ends.
    async fn ask<T>(
        &self,
        request: impl FnOnce(oneshot::Sender<T>) -> Request,
    ) -> Result<T, Error> {
        let (reply, answer) = oneshot::channel();
        if let Err(unsent) = self.requests.try_send(request(reply)) {
            let (error, request) = match unsent {
                mpsc::error::TrySendError::Full(request) => (Error::Busy, request),
                mpsc::error::TrySendError::Closed(request) => (Error::Gone, request),
            };
            return Err(self.commander.refuse(request.operation_id(), error));
        }
        answer.await.map_err(|_| Error::Gone)
    }
}

impl Request {
    fn operation_id(&self) -> &str {
        match self {
            Self::Move { by, .. } | Self::SetPortal { by, .. } | Self::RecoverFault { by, .. } => {
                &by.operation_id
            }
        }
    }

    fn refuse(self, commander: &Commander, error: Error) {
        let error = commander.refuse(self.operation_id(), error);
        // A caller that has gone needs no answer.
        match self {
            Self::Move { reply, .. } => drop(reply.send(Err(error))),
            Self::SetPortal { reply, .. } | Self::RecoverFault { reply, .. } => {
                drop(reply.send(Err(error)));
            }
        }
    }
}

/// What a repeated command that is done at once answers.
fn answered_before(operation: Operation) -> Result<(), Error> {
    if operation.reason.is_empty() {
        return Ok(());
    }
    Err(Error::Remembered {
        reason: operation.reason,
        detail: operation.detail,
    })
}
