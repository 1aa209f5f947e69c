//! The two arms, through the motion service.

mod tip;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid, Rotation};
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as proto;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use tonic::Streaming;
use tonic::transport::Channel;

use super::{
    Failure, Fault, MOTION_DEADLINE, Peer, SHORT_DEADLINE, STOP_DEADLINE, ask, first, follow,
    within,
};
use crate::wire;
use crate::words::words;

pub use tip::TipWatch;

const PEER: Peer = Peer::Motion;

/// A client of the motion service; clones share one connection.
#[derive(Clone, Debug)]
pub struct Motion(MotionServiceClient<Channel>);

words! {
    /// The two arms of the cell.
    Arm {
        /// Carries the forceps.
        Forceps = "FORCEPS",
        /// Carries the arthroscope.
        Arthroscope = "ARTHROSCOPE",
    }
}

/// What an arm shall do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// Straight to a pose outside the body.
    Free {
        /// base_from_tool at the end.
        rotation: Rotation,
        /// Where the tip is at the end.
        tip: Point3,
    },
    /// Turn about the portal until the shaft aims at a point.
    Pivot {
        /// In the arm's base.
        aim: Point3,
    },
    /// Advance along the shaft.
    Insert {
        /// Depth of the tip at the end, mm.
        depth_mm: f64,
    },
    /// Draw back along the shaft.
    Retract {
        /// Depth of the tip at the end, mm; negative is outside.
        depth_mm: f64,
    },
}

/// What was measured of an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmState {
    /// The controller's own clock, s.
    pub controller_time_s: f64,
    /// From measured joints.
    pub base_from_tool: Rigid<Base, Tool>,
    /// Whether the tip is beyond the portal.
    pub inside: bool,
    /// Whether a move runs or is being stopped.
    pub moving: bool,
    /// Whether the link is up; if not, this is what was measured last.
    pub connected: bool,
    /// The latched fault.
    pub fault: Option<Fault>,
}

/// Where both arms stood at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// Of the forceps, base_from_tool.
    pub forceps: Rigid<Base, Tool>,
    /// Of the arthroscope, base_from_tool.
    pub arthroscope: Rigid<Base, Tool>,
}

/// Both arms.
#[derive(Clone, Debug, PartialEq)]
pub struct Arms {
    /// The one with the forceps.
    pub forceps: ArmState,
    /// The one with the arthroscope.
    pub arthroscope: ArmState,
}

/// A message of a move under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoveProgress {
    /// Largest measured distance of the shaft to the portal so far while inside, mm.
    pub rcm_deviation_max_mm: f64,
    /// The moving arm's clock, s.
    pub controller_time_s: Option<f64>,
}

/// Whether a target is reached through the portal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// Whether it is.
    pub reachable: bool,
    /// A stable word when it is not.
    pub reason: String,
    /// With value and limit.
    pub detail: String,
}

impl Standing {
    /// One of the two.
    pub fn get(&self, arm: Arm) -> &Rigid<Base, Tool> {
        match arm {
            Arm::Forceps => &self.forceps,
            Arm::Arthroscope => &self.arthroscope,
        }
    }
}

impl Arms {
    /// Where they stand, if they do: a moving arm, or one that is out of sight, stands nowhere.
    pub fn standing(&self, at_ms: i64) -> Option<Standing> {
        let still = |arm: &ArmState| arm.connected && !arm.moving;
        (still(&self.forceps) && still(&self.arthroscope)).then_some(Standing {
            at_ms,
            forceps: self.forceps.base_from_tool,
            arthroscope: self.arthroscope.base_from_tool,
        })
    }

    /// One of the two.
    pub fn get(&self, arm: Arm) -> &ArmState {
        match arm {
            Arm::Forceps => &self.forceps,
            Arm::Arthroscope => &self.arthroscope,
        }
    }
}

impl Motion {
    pub(super) fn new(channel: Channel) -> Self {
        Self(MotionServiceClient::new(channel))
    }

    /// The measured state of both arms now.
    pub async fn arms(&self) -> Result<Arms, Failure> {
        let request = within(SHORT_DEADLINE, proto::WatchStateRequest { period_s: 0.0 });
        let state = first(PEER, self.0.clone().watch_state(request)).await?;
        let find = |arm: Arm| {
            state
                .arms
                .iter()
                .find(|state| state.arm() == arm.message())
                .ok_or_else(|| Failure::unusable(PEER, "the state lacks an arm"))
                .and_then(arm_state)
        };
        Ok(Arms {
            forceps: find(Arm::Forceps)?,
            arthroscope: find(Arm::Arthroscope)?,
        })
    }

    /// The measured states as they come, every `period_s` of controller time, for the record.
    pub async fn watch(
        &self,
        period_s: f64,
    ) -> Result<Streaming<proto::WatchStateResponse>, Failure> {
        let request = proto::WatchStateRequest { period_s };
        ask(PEER, self.0.clone().watch_state(request)).await
    }

    /// What the cell's arms are, for the record.
    pub async fn describe(&self) -> Result<proto::GetCellResponse, Failure> {
        let request = within(SHORT_DEADLINE, proto::GetCellRequest {});
        ask(PEER, self.0.clone().get_cell(request)).await
    }

    /// Which arms have a portal in force.
    pub async fn has_portal(&self, arm: Arm) -> Result<bool, Failure> {
        let cell = ask(
            PEER,
            self.0
                .clone()
                .get_cell(within(SHORT_DEADLINE, proto::GetCellRequest {})),
        )
        .await?;
        Ok(cell
            .arms
            .iter()
            .any(|described| described.arm() == arm.message() && described.portal.is_some()))
    }

    /// Takes command; answers the fencing token.
    pub async fn acquire(&self, holder: &str, ttl_s: f64) -> Result<u64, Failure> {
        let request = proto::AcquireLeaseRequest {
            holder: holder.to_owned(),
            ttl_s,
        };
        ask(
            PEER,
            self.0
                .clone()
                .acquire_lease(within(SHORT_DEADLINE, request)),
        )
        .await?
        .lease
        .map(|lease| lease.fencing_token)
        .ok_or_else(|| Failure::unusable(PEER, "no lease was sent"))
    }

    /// Keeps command.
    pub async fn renew(&self, fencing_token: u64) -> Result<(), Failure> {
        let request = proto::RenewLeaseRequest { fencing_token };
        let call = within(SHORT_DEADLINE, request);
        ask(PEER, self.0.clone().renew_lease(call)).await.map(drop)
    }

    /// Gives command back.
    pub async fn release(&self, fencing_token: u64) -> Result<(), Failure> {
        let request = proto::ReleaseLeaseRequest { fencing_token };
        let call = within(SHORT_DEADLINE, request);
        ask(PEER, self.0.clone().release_lease(call))
            .await
            .map(drop)
    }

    /// States where an arm's portal is.
    pub async fn set_portal(
        &self,
        authorization: common::Authorization,
        arm: Arm,
        portal: &Point3,
    ) -> Result<(), Failure> {
        let request = proto::SetPortalRequest {
            authorization: Some(authorization),
            arm: arm.message().into(),
            portal: Some(wire::point_message(portal)),
            ..proto::SetPortalRequest::default()
        };
        let call = within(SHORT_DEADLINE, request);
        ask(PEER, self.0.clone().set_portal(call)).await.map(drop)
    }

    /// Dry run of targets through a portal, in order.
    pub async fn check(
        &self,
        arm: Arm,
        targets: &[Point3],
        portal: &Point3,
    ) -> Result<Vec<Check>, Failure> {
        let request = proto::CheckMotionRequest {
            arm: arm.message().into(),
            targets: targets.iter().map(wire::point_message).collect(),
            portal: Some(wire::point_message(portal)),
            ..proto::CheckMotionRequest::default()
        };
        let answer = ask(
            PEER,
            self.0
                .clone()
                .check_motion(within(SHORT_DEADLINE * 12, request)),
        )
        .await?;
        if answer.checks.len() != targets.len() {
            return Err(Failure::unusable(PEER, "not one check a target"));
        }
        Ok(answer
            .checks
            .into_iter()
            .map(|check| Check {
                reachable: check.reachable,
                reason: check.reason,
                detail: check.detail,
            })
            .collect())
    }

    /// Moves an arm and returns when the move has ended as commanded.
    pub async fn perform(
        &self,
        authorization: common::Authorization,
        arm: Arm,
        motion: Move,
        mut watch: impl FnMut(MoveProgress) + Send,
    ) -> Result<(), Failure> {
        let request = proto::MoveRequest {
            authorization: Some(authorization),
            arm: arm.message().into(),
            motion: Some(motion.message()),
        };
        let call = within(MOTION_DEADLINE, request);
        follow(PEER, self.0.clone().r#move(call), |message| {
            watch(MoveProgress {
                rcm_deviation_max_mm: message.rcm_deviation_max_mm,
                controller_time_s: message.state.as_ref().map(|state| state.controller_time_s),
            });
            message.operation.clone()
        })
        .await
        .map(drop)
    }

    /// Stops both arms at once.
    pub async fn stop(&self, reason: &str) -> Result<(), Failure> {
        let request = proto::StopRequest {
            arm: common::Arm::Unspecified.into(),
            reason: reason.to_owned(),
        };
        let call = within(STOP_DEADLINE, request);
        ask(PEER, self.0.clone().stop(call)).await.map(drop)
    }

    /// Acknowledges an arm's fault.
    pub async fn recover_fault(
        &self,
        authorization: common::Authorization,
        arm: Arm,
    ) -> Result<(), Failure> {
        let request = proto::RecoverFaultRequest {
            authorization: Some(authorization),
            arm: arm.message().into(),
        };
        let call = within(SHORT_DEADLINE * 6, request);
        ask(PEER, self.0.clone().recover_fault(call))
            .await
            .map(drop)
    }
}

impl Arm {
    fn message(self) -> common::Arm {
        match self {
            Self::Forceps => common::Arm::Forceps,
            Self::Arthroscope => common::Arm::Arthroscope,
        }
    }
}

impl Move {
    /// Speeds are left to the motion service's limits.
    fn message(&self) -> proto::move_request::Motion {
        use proto::move_request::Motion;
        match self {
            Self::Free { rotation, tip } => Motion::Free(proto::FreeMove {
                base_from_tool: Some(wire::pose_message(rotation, tip)),
                speed_mm_s: 0.0,
            }),
            Self::Pivot { aim } => Motion::Pivot(proto::PivotMove {
                aim: Some(wire::point_message(aim)),
                speed_rad_s: 0.0,
            }),
            Self::Insert { depth_mm } => Motion::Insert(proto::InsertMove {
                depth_mm: *depth_mm,
                speed_mm_s: 0.0,
            }),
            Self::Retract { depth_mm } => Motion::Retract(proto::RetractMove {
                depth_mm: *depth_mm,
                speed_mm_s: 0.0,
            }),
        }
    }
}

fn arm_state(state: &proto::ArmState) -> Result<ArmState, Failure> {
    Ok(ArmState {
        controller_time_s: state.controller_time_s,
        base_from_tool: wire::pose(state.base_from_tool, "base_from_tool").map_err(
            |violation| {
                Failure::unusable(
                    PEER,
                    &format!("{} {}", violation.field, violation.description),
                )
            },
        )?,
        inside: state.inside,
        moving: state.moving,
        connected: state.connected,
        fault: Fault::of(&state.fault_reason, &state.fault_detail),
    })
}
