//! Arms under command from the command line: a lease that is kept alive, moves watched to their end, and poses at rest.

use std::time::Duration;

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange, Frame, Tool};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Rotation, Vector3};
use arthro_proto::common::v1::{self as common, OperationState};
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::motion::v1::move_request::Motion;
use tokio::task::JoinHandle;
use tonic::transport::Channel;

use crate::connection;
use crate::exit::{Failure, Kind};

const LEASE_TTL_S: f64 = 5.0;
const RENEW_EVERY: Duration = Duration::from_secs(1);
/// An arm that moved less than this between two states is at rest.
const REST_MM: f64 = 1e-3;
const REST_RAD: f64 = 1e-5;
/// States looked at before an arm is given up that does not come to rest.
const REST_STATES: usize = 500;
/// Controller time between two states, s.
const STATE_PERIOD_S: f64 = 0.1;

/// A motion service and the right to command its arms. Command ends with it.
#[derive(Debug)]
pub struct Commanded {
    client: MotionServiceClient<Channel>,
    fencing_token: u64,
    operations: u32,
    renewing: JoinHandle<()>,
}

impl Commanded {
    /// Takes command of both arms; `holder` is who asks, for people.
    pub async fn take(url: &str, holder: &str) -> Result<Self, Failure> {
        let mut client = MotionServiceClient::new(connection::open(url).await?);
        let request = motion::AcquireLeaseRequest {
            holder: holder.to_owned(),
            ttl_s: LEASE_TTL_S,
        };
        let lease = client.acquire_lease(request).await?.into_inner().lease;
        let fencing_token = lease
            .ok_or_else(|| unusable("no lease was sent"))?
            .fencing_token;
        Ok(Self {
            renewing: tokio::spawn(renew(client.clone(), fencing_token)),
            client,
            fencing_token,
            operations: 0,
        })
    }

    /// Performs one move to its end; gives its last message.
    pub async fn perform(
        &mut self,
        arm: common::Arm,
        motion: Motion,
    ) -> Result<motion::MoveResponse, Failure> {
        let request = motion::MoveRequest {
            authorization: Some(self.authorization()),
            arm: arm.into(),
            motion: Some(motion),
        };
        let mut progress = self.client.r#move(request).await?.into_inner();
        while let Some(message) = progress.message().await? {
            let operation = message.operation.clone().unwrap_or_default();
            match operation.state() {
                OperationState::Done => return Ok(message),
                OperationState::Running | OperationState::Unspecified => {}
                _ => {
                    return Err(Failure::new(
                        Kind::Failed,
                        operation.reason,
                        operation.detail,
                    ));
                }
            }
        }
        Err(unusable("a move ended without an outcome"))
    }

    /// Acknowledges an arm's fault once it is at rest.
    pub async fn acknowledge(&mut self, arm: common::Arm) -> Result<(), Failure> {
        self.tool_at_rest(arm).await?;
        let request = motion::RecoverFaultRequest {
            authorization: Some(self.authorization()),
            arm: arm.into(),
        };
        self.client.recover_fault(request).await?;
        Ok(())
    }

    /// States where an arm's portal is, and the axis of its cone.
    pub async fn set_portal(
        &mut self,
        arm: common::Arm,
        portal: common::Point,
        axis: Option<common::Direction>,
    ) -> Result<(), Failure> {
        let request = motion::SetPortalRequest {
            authorization: Some(self.authorization()),
            arm: arm.into(),
            portal: Some(portal),
            axis,
        };
        self.client.set_portal(request).await?;
        Ok(())
    }

    /// The measured pose of an arm's tool once it is at rest.
    pub async fn tool_at_rest(&mut self, arm: common::Arm) -> Result<Rigid<Base, Tool>, Failure> {
        tool_at_rest(&mut self.client, arm).await
    }

    /// Stops an arm; what was asked for goes unanswered, which is a failure of the command.
    pub async fn stop(mut self, arm: common::Arm, reason: &str) -> Result<(), Failure> {
        let request = motion::StopRequest {
            arm: arm.into(),
            reason: reason.to_owned(),
        };
        self.client.stop(request).await?;
        Err(Failure::new(Kind::Interrupted, "INTERRUPTED", reason))
    }

    /// Gives command back.
    pub async fn release(mut self) -> Result<(), Failure> {
        self.renewing.abort();
        let request = motion::ReleaseLeaseRequest {
            fencing_token: self.fencing_token,
        };
        self.client.release_lease(request).await?;
        Ok(())
    }

    /// A new operation under the lease.
    fn authorization(&mut self) -> common::Authorization {
        self.operations += 1;
        common::Authorization {
            fencing_token: self.fencing_token,
            operation_id: format!("arthro-{}-{}", self.fencing_token, self.operations),
        }
    }
}

impl Drop for Commanded {
    fn drop(&mut self) {
        self.renewing.abort();
    }
}

/// The tool that the motion service believes an arm carries.
pub async fn believed_tool(
    client: &mut MotionServiceClient<Channel>,
    arm: common::Arm,
) -> Result<Rigid<Flange, Tool>, Failure> {
    let cell = client
        .get_cell(motion::GetCellRequest {})
        .await?
        .into_inner();
    cell.arms
        .iter()
        .find(|described| described.arm() == arm)
        .and_then(|described| described.flange_from_tool.as_ref())
        .and_then(rigid)
        .ok_or_else(|| unusable("GetCell names no tool of this arm"))
}

/// The measured pose of an arm's tool once it is at rest; needs no lease.
pub async fn tool_at_rest(
    client: &mut MotionServiceClient<Channel>,
    which: common::Arm,
) -> Result<Rigid<Base, Tool>, Failure> {
    let request = motion::WatchStateRequest {
        period_s: STATE_PERIOD_S,
    };
    let mut states = client.watch_state(request).await?.into_inner();
    let mut before: Option<Rigid<Base, Tool>> = None;
    for _ in 0..REST_STATES {
        let Some(state) = states.message().await? else {
            break;
        };
        let measured = state
            .arms
            .iter()
            .find(|arm| arm.arm() == which)
            .filter(|arm| !arm.moving)
            .and_then(|arm| arm.base_from_tool.as_ref())
            .and_then(rigid);
        if let (Some(before), Some(now)) = (before, measured)
            && (before.translation_mm() - now.translation_mm()).norm() < REST_MM
            && before.rotation().angle_to(&now.rotation()) < REST_RAD
        {
            return Ok(now);
        }
        before = measured;
    }
    Err(unusable("an arm does not come to rest"))
}

/// A straight move of the tool at the speed limit.
pub fn straight_to(base_from_tool: &Rigid<Base, Tool>) -> Motion {
    Motion::Free(motion::FreeMove {
        base_from_tool: Some(message(base_from_tool)),
        speed_mm_s: 0.0,
    })
}

/// A transform as a message.
pub fn message<A: Frame, B: Frame>(pose: &Rigid<A, B>) -> common::Pose {
    let rotation = pose.rotation().into_inner();
    let [x_mm, y_mm, z_mm] = pose.translation_mm().into();
    common::Pose {
        rotation: Some(common::Quaternion {
            w: rotation.w,
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
        }),
        translation: Some(common::Point { x_mm, y_mm, z_mm }),
    }
}

/// A transform from a message; `None` where a part is missing.
pub fn rigid<A: Frame, B: Frame>(pose: &common::Pose) -> Option<Rigid<A, B>> {
    let (rotation, translation) = pose.rotation.as_ref().zip(pose.translation.as_ref())?;
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let translation = Vector3::new(translation.x_mm, translation.y_mm, translation.z_mm);
    Some(Rigid::new(
        Rotation::from_quaternion(quaternion),
        translation,
    ))
}

/// An answer that the motion service should not give.
pub fn unusable(what: &str) -> Failure {
    Failure::new(Kind::Failed, "MOTION_ANSWER_UNUSABLE", what)
}

/// A lease that cannot be renewed is lost, and the next move says so.
async fn renew(mut client: MotionServiceClient<Channel>, fencing_token: u64) {
    let mut due = tokio::time::interval(RENEW_EVERY);
    loop {
        due.tick().await;
        let request = motion::RenewLeaseRequest { fencing_token };
        if client.renew_lease(request).await.is_err() {
            return;
        }
    }
}
