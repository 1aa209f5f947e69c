//! `arthro calibrate`: where camera, tool and shaft are mounted, from a file of poses or by the whole routine in a
//! simulated cell.
//!
//! The files are described in `docs/calibration.md`. What is solved from a file is solved in this process.

pub mod cell;
mod file;
mod show;

use arthro_proto::gateway::v1::save_calibration_request::Result as Answer;
use arthro_proto::registration::v1::{SolveHandEyeResponse, SolveToolTipResponse};
use arthro_registration::calibration::{hand_eye, tool};
use arthro_registration::calibration_answer as answer;
use arthro_registration::error::Error;
use serde_json::Value;
use tonic::Status;

use crate::arguments::{Calibrate, CalibrationFile};
use crate::calibrate::file::{CameraMounting, HandEyeFile, ToolFile};
use crate::calibrations;
use crate::exit::Failure;
use crate::output::Output;

/// Runs one calibration to its end.
pub async fn run(calibrate: Calibrate, gateway: &str, output: &Output) -> Result<(), Failure> {
    match calibrate {
        Calibrate::HandEye(file) => {
            let (shown, answer) = solve_hand_eye(&file)?;
            print(&shown, output);
            if let Some(answer) = answer {
                let answer = Answer::HandEye(answer);
                calibrations::save(answer, &file, gateway, output).await?;
            }
            Ok(())
        }
        Calibrate::ToolTip(file) => {
            let (shown, answer) = solve_tool(&file)?;
            print(&shown, output);
            calibrations::save(Answer::ToolTip(answer), &file, gateway, output).await
        }
        Calibrate::Cell(arguments) => Box::pin(cell::run(&arguments, output)).await,
    }
}

/// What is shown, and, with the camera beside the arm, what can be saved.
fn solve_hand_eye(
    file: &CalibrationFile,
) -> Result<(Value, Option<SolveHandEyeResponse>), Failure> {
    let asked = HandEyeFile::read(&file.file)?;
    let (stations, options) = asked.stations().map_err(refused)?;
    match asked.mounting {
        CameraMounting::BesideArm => hand_eye::eye_on_base(&stations, &options).map(|found| {
            let shown = show::hand_eye(&found, "base_from_camera", "flange_from_board");
            (shown, Some(answer::hand_eye(&found)))
        }),
        CameraMounting::OnFlange if file.save.is_some() => {
            return Err(Failure::refused(
                "MOUNTING_NOT_KEPT",
                "the gateway keeps calibrations of a camera beside the arm only; the file says on_flange",
            ));
        }
        CameraMounting::OnFlange => hand_eye::eye_in_hand(&stations, &options).map(|found| {
            let shown = show::hand_eye(&found, "flange_from_camera", "base_from_board");
            (shown, None)
        }),
    }
    .map_err(refused)
}

fn solve_tool(file: &CalibrationFile) -> Result<(Value, SolveToolTipResponse), Failure> {
    let asked = ToolFile::read(&file.file)?;
    let (poses, shaft, options) = asked.measurements().map_err(refused)?;
    tool::solve(&poses, &shaft, &options)
        .map(|found| (show::tool(&found), answer::tool(&found)))
        .map_err(refused)
}

/// As the service would say it.
pub fn refused(error: Error) -> Failure {
    Status::from(error).into()
}

fn print(value: &Value, output: &Output) {
    output.line(show::table(value));
    output.result(value);
}
