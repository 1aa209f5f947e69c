//! `arthro calibrate`: where camera, tool and shaft are mounted, from a file of poses or by the whole routine in a
//! simulated cell.
//!
//! The files are described in `docs/calibration.md`. What is solved from a file is solved in this process.

mod cell;
mod file;
mod show;

use arthro_registration::calibration::{hand_eye, tool};
use arthro_registration::error::Error;
use serde_json::Value;
use tonic::Status;

use crate::arguments::{Calibrate, CalibrationFile};
use crate::calibrate::file::{CameraMounting, HandEyeFile, ToolFile};
use crate::exit::Failure;
use crate::output::Output;

/// Runs one calibration to its end.
pub async fn run(calibrate: Calibrate, output: &Output) -> Result<(), Failure> {
    match calibrate {
        Calibrate::HandEye(file) => print(&solve_hand_eye(&file)?, output),
        Calibrate::ToolTip(file) => print(&solve_tool(&file)?, output),
        Calibrate::Cell(arguments) => return Box::pin(cell::run(&arguments, output)).await,
    }
    Ok(())
}

fn solve_hand_eye(file: &CalibrationFile) -> Result<Value, Failure> {
    let asked = HandEyeFile::read(&file.file)?;
    let (stations, options) = asked.stations().map_err(refused)?;
    match asked.mounting {
        CameraMounting::BesideArm => hand_eye::eye_on_base(&stations, &options)
            .map(|found| show::hand_eye(&found, "base_from_camera", "flange_from_board")),
        CameraMounting::OnFlange => hand_eye::eye_in_hand(&stations, &options)
            .map(|found| show::hand_eye(&found, "flange_from_camera", "base_from_board")),
    }
    .map_err(refused)
}

fn solve_tool(file: &CalibrationFile) -> Result<Value, Failure> {
    let asked = ToolFile::read(&file.file)?;
    let (poses, shaft, options) = asked.measurements().map_err(refused)?;
    tool::solve(&poses, &shaft, &options)
        .map(|found| show::tool(&found))
        .map_err(refused)
}

/// As the service would say it.
fn refused(error: Error) -> Failure {
    Status::from(error).into()
}

fn print(value: &Value, output: &Output) {
    output.line(show::table(value));
    output.result(value);
}
