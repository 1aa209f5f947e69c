//! `arthro robot`: what an engineer at the bench needs of the arms, through the motion service, or of one controller
//! through its dashboard.

mod dashboard;
mod jog;
mod kinematics;
mod state;
mod taught;
mod teach;

use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::move_request::Motion;
use serde_json::json;

use crate::arguments::{ArmName, Robot, RobotCommand};
use crate::commanded::Commanded;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// For people who find the lease held.
const HOLDER: &str = "arthro robot";

/// Runs one command to its end.
pub async fn run(robot: Robot, output: &Output) -> Result<(), Failure> {
    let motion = robot.motion;
    match robot.command {
        RobotCommand::State(arguments) => state::show(&motion, &arguments, output).await,
        RobotCommand::Dashboard(arguments) => dashboard::ask(&arguments, output).await,
        RobotCommand::Jog(arguments) => jog::run(&motion, &arguments, output).await,
        RobotCommand::Retract(arguments) => {
            let retract = Motion::Retract(motion::RetractMove {
                depth_mm: arguments.to_depth_mm,
                speed_mm_s: 0.0,
            });
            perform(&motion, arguments.arm, retract, output).await
        }
        RobotCommand::Teach(taught) => teach::add(&motion, &taught, output).await,
        RobotCommand::Portal(portal) => teach::portal(&motion, &portal, output).await,
        RobotCommand::Shaft(taught) => teach::shaft(&motion, &taught, output).await,
        RobotCommand::Kinematics(arguments) => kinematics::show(&arguments, output).await,
        RobotCommand::Recover(which) => acknowledge(&motion, which.arm, output).await,
    }
}

/// One move under a lease of its own, which is given back however it ends. Ctrl-C stops the arm.
async fn perform(url: &str, arm: ArmName, motion: Motion, output: &Output) -> Result<(), Failure> {
    let mut commanded = Commanded::take(url, HOLDER).await?;
    let outcome = tokio::select! {
        outcome = commanded.perform(arm.into(), motion) => outcome,
        _ = tokio::signal::ctrl_c() => {
            // The move ends as STOPPED, and command with this process.
            return commanded.stop(arm.into(), "interrupted from the terminal").await;
        }
    };
    let released = commanded.release().await;
    let ended = outcome?;
    released?;
    let detail = ended.operation.unwrap_or_default().detail;
    output.line(format!("done: {detail}"));
    let state = ended.state.as_ref().map(state::value);
    output.result(&json!({
        "done": true,
        "rcm_deviation_max_mm": ended.rcm_deviation_max_mm,
        "arm": state,
    }));
    Ok(())
}

/// HOST or HOST:PORT, with the port that is usual.
fn place(controller: &str, usual_port: u16) -> Result<(String, u16), Failure> {
    let Some((host, port)) = controller.split_once(':') else {
        return Ok((controller.to_owned(), usual_port));
    };
    let port = port.parse().map_err(|_| {
        let fault = format!("{controller:?} is none; give HOST or HOST:PORT");
        Failure::refused("ADDRESS_INVALID", fault)
    })?;
    Ok((host.to_owned(), port))
}

/// A controller that cannot be reached or says nothing sensible.
fn unreachable(error: &ur_link::Error) -> Failure {
    let failure = Failure::refused_because("CONTROLLER_UNREACHABLE", error);
    Failure::new(Kind::Unreachable, failure.reason, failure.message)
}

/// Clears a fault under a lease of its own.
async fn acknowledge(url: &str, arm: ArmName, output: &Output) -> Result<(), Failure> {
    let mut commanded = Commanded::take(url, HOLDER).await?;
    let outcome = commanded.acknowledge(arm.into()).await;
    let released = commanded.release().await;
    outcome?;
    released?;
    output.line("acknowledged");
    output.result(&json!({"acknowledged": true}));
    Ok(())
}

impl From<ArmName> for common::Arm {
    fn from(name: ArmName) -> Self {
        match name {
            ArmName::Forceps => Self::Forceps,
            ArmName::Arthroscope => Self::Arthroscope,
        }
    }
}
