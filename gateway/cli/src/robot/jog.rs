//! A small move outside: one joint, or the tool along an axis of base or tool.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Rigid, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::motion::v1::move_request::Motion;

use super::perform;
use crate::arguments::{AxisName, Jog};
use crate::commanded::{message, tool_at_rest, unusable};
use crate::connection;
use crate::exit::Failure;
use crate::output::Output;

/// Slow enough to let go in time.
const JOG_SPEED_RAD_S: f64 = 0.1;
const JOG_SPEED_MM_S: f64 = 10.0;

/// Moves from where the arm stands now.
pub async fn run(url: &str, jog: &Jog, output: &Output) -> Result<(), Failure> {
    let mut client = MotionServiceClient::new(connection::open(url).await?);
    let arm = common::Arm::from(jog.arm);
    let motion = match (jog.joint.zip(jog.by_rad), jog.along.zip(jog.by_mm)) {
        (Some((joint, by_rad)), _) => {
            let mut joints_rad = joints_now(&mut client, arm).await?;
            joints_rad[usize::from(joint) - 1] += by_rad;
            Motion::Joint(motion::JointMove {
                joints_rad: joints_rad.to_vec(),
                speed_rad_s: JOG_SPEED_RAD_S,
            })
        }
        (None, Some((axis, by_mm))) => {
            let now = tool_at_rest(&mut client, arm).await?;
            Motion::Free(motion::FreeMove {
                base_from_tool: Some(message(&moved(&now, axis, by_mm))),
                speed_mm_s: JOG_SPEED_MM_S,
            })
        }
        // The command line demands one of them.
        (None, None) => return Ok(()),
    };
    perform(url, jog.arm, motion, output).await
}

async fn joints_now(
    client: &mut MotionServiceClient<tonic::transport::Channel>,
    arm: common::Arm,
) -> Result<[f64; 6], Failure> {
    let request = motion::WatchStateRequest { period_s: 0.0 };
    let mut states = client.watch_state(request).await?.into_inner();
    let state = states.message().await?.unwrap_or_default();
    state
        .arms
        .iter()
        .find(|state| state.arm() == arm)
        .and_then(|state| state.joints_rad.as_slice().try_into().ok())
        .ok_or_else(|| unusable("no joints were sent: is the arm connected?"))
}

fn moved(now: &Rigid<Base, Tool>, axis: AxisName, by_mm: f64) -> Rigid<Base, Tool> {
    let step = match axis {
        AxisName::BaseX => Vector3::x(),
        AxisName::BaseY => Vector3::y(),
        AxisName::BaseZ => Vector3::z(),
        AxisName::ToolX => now.direction(&Vector3::x()),
        AxisName::ToolY => now.direction(&Vector3::y()),
        AxisName::ToolZ => now.direction(&Vector3::z()),
    };
    Rigid::new(now.rotation(), now.translation_mm() + step * by_mm)
}
