//! The forceps arm as the calibration moves it: free moves, and the flange at rest.

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::{Rigid, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::motion::v1::move_request::Motion;

use crate::commanded::{Commanded, believed_tool, straight_to};
use crate::connection;
use crate::exit::{Failure, Kind};

/// The supervisor stopped a move near a singularity of the wrist: that pose is left out, the routine goes on.
const TOO_FAST: &str = "JOINT_SPEED";

/// The commanded arm. Command ends with it.
#[derive(Debug)]
pub struct Arm {
    commanded: Commanded,
    flange_from_tool: Rigid<Flange, Tool>,
}

impl Arm {
    /// Takes command of the forceps arm.
    pub async fn take(url: &str) -> Result<Self, Failure> {
        let mut client = MotionServiceClient::new(connection::open(url).await?);
        Ok(Self {
            flange_from_tool: believed_tool(&mut client, common::Arm::Forceps).await?,
            commanded: Commanded::take(url, "arthro calibrate").await?,
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
        let there = self
            .commanded
            .tool_at_rest(common::Arm::Arthroscope)
            .await?;
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
        match self.commanded.perform(arm, motion).await {
            Err(failure) if failure.kind == Kind::Failed && failure.reason == TOO_FAST => {
                self.commanded.acknowledge(arm).await?;
                Err(Failure::refused(TOO_FAST, failure.message))
            }
            outcome => outcome.map(|_| ()),
        }
    }

    /// The measured flange once the arm is at rest.
    pub async fn flange_at_rest(&mut self) -> Result<Rigid<Base, Flange>, Failure> {
        let tool = self.commanded.tool_at_rest(common::Arm::Forceps).await?;
        Ok(tool * self.flange_from_tool.inverse())
    }

    /// Gives command back.
    pub async fn release(self) -> Result<(), Failure> {
        self.commanded.release().await
    }
}
