//! `arthro calibrate cell`: the whole routine in a simulated cell.
//!
//! The cell's camera, tool, board and divot are mounted off their drawing, by how much only the simulator knows. The
//! routine knows the drawing, moves the forceps arm through the motion service, looks at the board, seats the tip in
//! the divot, solves, and has the referee say how far off the answers are.

mod arm;
pub mod board;
pub mod divot;
mod summary;

use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_registration::calibration::{hand_eye, tool_tip};
use arthro_simulator::scenario::{Mounting, SystemView};

use self::arm::Arm;
use self::summary::Summary;
use crate::arguments::CalibrateCell;
use crate::calibrate::file::{HandEyeFile, ToolFile};
use crate::calibrate::refused;
use crate::cell::{Cell, Ports, Urls};
use crate::connection;
use crate::demo;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// The arthroscope is drawn back this far before the forceps arm moves about, mm.
const ARTHROSCOPE_BACK_MM: f64 = 220.0;

/// Runs the routine to its end.
pub async fn run(arguments: &CalibrateCell, output: &Output) -> Result<(), Failure> {
    let scenario = demo::mounted_scenario(&arguments.cell, Mounting::uncalibrated(), output)?;
    let (folder, _removed_at_the_end) = match &arguments.keep {
        Some(folder) => (folder.clone(), None),
        None => {
            let folder = tempfile::Builder::new()
                .prefix("arthro-calibrate-")
                .tempdir()?;
            (folder.path().to_owned(), Some(folder))
        }
    };
    let time_scale = arguments.cell.time_scale;
    let mut cell = Box::pin(Cell::start(
        &scenario,
        &folder,
        time_scale,
        Ports::Free,
        None,
        output,
    ))
    .await?;
    let urls = cell.urls();
    let drawn = scenario.system_view();
    let outcome = tokio::select! {
        outcome = perform(&drawn, &urls, arguments, output) => outcome,
        failure = cell.failed() => Err(failure),
        _ = tokio::signal::ctrl_c() => Err(Failure::new(Kind::Interrupted, "INTERRUPTED", "interrupted from the terminal")),
    };
    cell.stop().await;
    let summary = outcome?;
    output.line(summary.table());
    output.result(&summary.json());
    summary.limits_kept()
}

/// `drawn` is what stands in the services' configuration, never the truth.
async fn perform(
    drawn: &SystemView,
    urls: &Urls,
    arguments: &CalibrateCell,
    output: &Output,
) -> Result<Summary, Failure> {
    let mut arm = Arm::take(&urls.motion).await?;
    arm.clear_the_other(ARTHROSCOPE_BACK_MM).await?;
    let seed = arguments.cell.seed;
    let stations = board::look(&mut arm, drawn, urls, arguments.poses, seed, output).await?;
    // From where the arm began every fixture is a straight way off.
    arm.turn(drawn.start_joints_rad[0]).await?;
    let pivots = divot::pivot(&mut arm, drawn, urls, seed, output).await?;
    arm.release().await?;
    if let Some(folder) = &arguments.keep {
        HandEyeFile::beside_arm(&stations, &board::options())
            .write(&folder.join("hand_eye.json"))?;
        ToolFile::pivot(&pivots).write(&folder.join("tool_tip.json"))?;
    }
    let hand_eye = hand_eye::eye_on_base(&stations, &board::options()).map_err(refused)?;
    let tool = tool_tip::solve(&pivots, &tool_tip::Options::default()).map_err(refused)?;
    let referee = RefereeServiceClient::new(connection::open(&urls.simulator).await?);
    Summary::graded(referee, drawn, hand_eye, tool).await
}
