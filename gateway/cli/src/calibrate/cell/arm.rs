//! The forceps arm through the motion service: a lease that is kept alive, free moves, and the pose at rest.

use std::time::Duration;

use arthro_geometry::frame::{Base, Flange, Frame, Tool};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_proto::common::v1::{self as common, OperationState};
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::motion::v1::move_request::Motion;
use tokio::task::JoinHandle;
use tonic::transport::Channel;

use crate::exit::{Failure, Kind};

const LEASE_TTL_S: f64 = 5.0;
const RENEW_EVERY: Duration = Duration::from_secs(1);
/// An arm that moved less than this between two states is at rest.
const REST_MM: f64 = 1e-3;
const REST_RAD: f64 = 1e-5;
/// The supervisor stopped a move near a singularity of the wrist: that pose is left out, the routine goes on.
const TOO_FAST: &str = "JOINT_SPEED";
/// States looked at before an arm is given up that does not come to rest.
const REST_STATES: usize = 500;

/// The commanded arm. Command ends with it.
#[derive(Debug)]
pub struct Arm {
    client: MotionServiceClient<Channel>,
    fencing_token: u64,
    flange_from_tool: Rigid<Flange, Tool>,
    moves: u32,
    renewing: JoinHandle<()>,
}

impl Arm {
    /// Takes command of the forceps arm.
    pub async fn take(url: &str) -> Result<Self, Failure> {
        let mut client = MotionServiceClient::connect(url.to_owned()).await?;
        let described = client
            .get_cell(motion::GetCellRequest {})
            .await?
            .into_inner();
        let flange_from_tool = described
            .arms
            .iter()
            .find(|arm| arm.arm() == common::Arm::Forceps)
            .and_then(|arm| arm.flange_from_tool.as_ref())
            .and_then(rigid)
            .ok_or_else(|| unusable("GetCell names no tool of the forceps arm"))?;
        let request = motion::AcquireLeaseRequest {
            holder: "arthro calibrate".to_owned(),
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
            flange_from_tool,
            moves: 0,
        })
    }

    /// The tool that the motion service believes in.
    pub fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        self.flange_from_tool
    }

    /// Moves straight to a pose of the believed tool. What cannot be reached is refused.
    pub async fn go(&mut self, base_from_tool: &Rigid<Base, Tool>) -> Result<(), Failure> {
        self.perform(common::Arm::Forceps, straight_to(base_from_tool))
            .await
    }

    /// Draws the arthroscope back along its shaft, out of this arm's way.
    pub async fn clear_the_other(&mut self, back_mm: f64) -> Result<(), Failure> {
        let there = self.tool_at_rest(common::Arm::Arthroscope).await?;
        let back = Rigid::<Base, Tool>::new(
            there.rotation(),
            there.translation_mm() - there.direction(&Vector3::x()) * back_mm,
        );
        self.perform(common::Arm::Arthroscope, straight_to(&back))
            .await
    }

    /// Turns the joints to where they shall be.
    pub async fn turn(&mut self, joints_rad: [f64; 6]) -> Result<(), Failure> {
        let turned = Motion::Joint(motion::JointMove {
            joints_rad: joints_rad.to_vec(),
            speed_rad_s: 0.0,
        });
        self.perform(common::Arm::Forceps, turned).await
    }

    async fn perform(&mut self, arm: common::Arm, motion: Motion) -> Result<(), Failure> {
        let request = motion::MoveRequest {
            authorization: Some(self.authorization()),
            arm: arm.into(),
            motion: Some(motion),
        };
        let mut progress = self.client.r#move(request).await?.into_inner();
        while let Some(message) = progress.message().await? {
            let operation = message.operation.unwrap_or_default();
            match operation.state() {
                OperationState::Done => return Ok(()),
                OperationState::Failed if operation.reason == TOO_FAST => {
                    self.acknowledge(arm).await?;
                    return Err(Failure::refused(TOO_FAST, operation.detail));
                }
                OperationState::Failed | OperationState::Stopped | OperationState::InDoubt => {
                    return Err(Failure::new(
                        Kind::Failed,
                        operation.reason,
                        operation.detail,
                    ));
                }
                OperationState::Running | OperationState::Unspecified => {}
            }
        }
        Err(unusable("a move ended without an outcome"))
    }

    async fn acknowledge(&mut self, arm: common::Arm) -> Result<(), Failure> {
        self.tool_at_rest(arm).await?;
        let request = motion::RecoverFaultRequest {
            authorization: Some(self.authorization()),
            arm: arm.into(),
        };
        self.client.recover_fault(request).await?;
        Ok(())
    }

    /// A new operation under the lease.
    fn authorization(&mut self) -> common::Authorization {
        self.moves += 1;
        common::Authorization {
            fencing_token: self.fencing_token,
            operation_id: format!("calibrate-{}-{}", self.fencing_token, self.moves),
        }
    }

    /// The measured flange once the arm is at rest.
    pub async fn flange_at_rest(&mut self) -> Result<Rigid<Base, Flange>, Failure> {
        let tool = self.tool_at_rest(common::Arm::Forceps).await?;
        Ok(tool * self.flange_from_tool.inverse())
    }

    async fn tool_at_rest(&mut self, which: common::Arm) -> Result<Rigid<Base, Tool>, Failure> {
        let request = motion::WatchStateRequest { period_s: 0.1 };
        let mut states = self.client.watch_state(request).await?.into_inner();
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

    /// Gives command back.
    pub async fn release(mut self) -> Result<(), Failure> {
        self.renewing.abort();
        let request = motion::ReleaseLeaseRequest {
            fencing_token: self.fencing_token,
        };
        self.client.release_lease(request).await?;
        Ok(())
    }
}

impl Drop for Arm {
    fn drop(&mut self) {
        self.renewing.abort();
    }
}

fn straight_to(base_from_tool: &Rigid<Base, Tool>) -> Motion {
    Motion::Free(motion::FreeMove {
        base_from_tool: Some(message(base_from_tool)),
        speed_mm_s: 0.0,
    })
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

fn unusable(what: &str) -> Failure {
    Failure::new(Kind::Failed, "MOTION_ANSWER_UNUSABLE", what)
}

fn rigid<A: Frame, B: Frame>(pose: &common::Pose) -> Option<Rigid<A, B>> {
    let (rotation, translation) = pose.rotation.as_ref().zip(pose.translation.as_ref())?;
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let translation = Vector3::new(translation.x_mm, translation.y_mm, translation.z_mm);
    Some(Rigid::new(
        Rotation::from_quaternion(quaternion),
        translation,
    ))
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
