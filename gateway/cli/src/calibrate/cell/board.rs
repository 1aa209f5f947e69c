//! The camera: the arm holds the board into its view, turned this way and that, and both say where it is.

use std::ops::RangeInclusive;

use arthro_geometry::frame::{Base, Board, Camera, Flange, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_proto::simulator::v1::camera_service_client::CameraServiceClient;
use arthro_proto::simulator::v1::{CaptureBoardRequest, CaptureBoardResponse};
use arthro_registration::calibration::board::{self, Corner, Lens};
use arthro_registration::calibration::hand_eye::{Options, Station};
use arthro_registration::calibration::noise::PoseNoise;
use arthro_simulator::calibration_board;
use arthro_simulator::scenario::SystemView;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::arm::Arm;
use crate::calibrate::refused;
use crate::cell::Urls;
use crate::connection;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// Where registrations happen, in the camera's frame, mm.
pub const WORK_POINT: Point3 = Point3::new(0.0, 0.0, 350.0);
/// The middle of the board is held within these ranges of the camera's frame: to one side, across that, in front, mm.
const AWAY_MM: RangeInclusive<f64> = 90.0..=165.0;
const ACROSS_MM: RangeInclusive<f64> = -60.0..=60.0;
const DISTANCE_MM: RangeInclusive<f64> = 240.0..=320.0;
/// Tilted up to this far about any axis of its plane, and turned in it, degrees.
const TILT_DEG: f64 = 32.0;
const TWIST_DEG: f64 = 20.0;
/// Candidates a view: some are out of reach or out of view.
const CANDIDATES_A_VIEW: u32 = 8;
/// Repeatability of a UR5 by its data sheet, and what that is as a turn over a shaft.
const ARM_NOISE: PoseNoise = PoseNoise {
    rotation_rad: 2e-4,
    translation_mm: 0.1,
};

/// Takes `count` views.
pub async fn look(
    arm: &mut Arm,
    drawn: &SystemView,
    urls: &Urls,
    count: u32,
    seed: u64,
    output: &Output,
) -> Result<Vec<Station>, Failure> {
    let mut camera = CameraServiceClient::new(connection::open(&urls.simulator).await?);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let bar = output.progress("board", u64::from(count));
    let mut stations = Vec::new();
    for candidate in 0..count * CANDIDATES_A_VIEW {
        if stations.len() == count as usize {
            break;
        }
        let target = target(drawn, &view(drawn, &mut rng), &arm.flange_from_tool());
        if reached(arm.go(&target).await)?.is_none() {
            continue;
        }
        let base_from_flange = arm.flange_at_rest().await?;
        let request = CaptureBoardRequest {
            seed: seed.wrapping_add(u64::from(candidate)),
        };
        match reached(camera.capture_board(request).await.map_err(Failure::from))? {
            Some(seen) => stations.push(station(base_from_flange, &seen.into_inner())?),
            None => continue,
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if stations.len() < count as usize {
        return Err(Failure::new(
            Kind::Failed,
            "TOO_FEW_VIEWS",
            format!(
                "{} of {count} views were reached and in view",
                stations.len()
            ),
        ));
    }
    output.note(format!("{count} views of the board were taken"));
    Ok(stations)
}

/// What is known of the arm, and where the answer will be used.
pub fn options() -> Options {
    Options {
        work_point: WORK_POINT,
        arm_noise: Some(ARM_NOISE),
        ..Options::default()
    }
}

/// What was refused is no view; anything else ends the routine.
fn reached<T>(outcome: Result<T, Failure>) -> Result<Option<T>, Failure> {
    match outcome {
        Ok(value) => Ok(Some(value)),
        Err(failure) if failure.kind == Kind::Refused => Ok(None),
        Err(failure) => Err(failure),
    }
}

/// The board somewhere in view, held to the side that is away from the other arm, with the shaft pointing there too: so
/// neither meets the knee or the arthroscope.
pub fn view(drawn: &SystemView, rng: &mut ChaCha8Rng) -> Rigid<Camera, Board> {
    let away = away_from_the_other_arm(drawn);
    let across = Vector3::z().cross(&away);
    let middle = away * rng.random_range(AWAY_MM)
        + across * rng.random_range(ACROSS_MM)
        + Vector3::z() * rng.random_range(DISTANCE_MM);
    let roll = Rotation::from_scaled_axis(Vector3::z() * away.y.atan2(away.x));
    let side = rng.random_range(0.0..std::f64::consts::TAU);
    let tilt_rad = rng.random_range(0.3..=1.0) * TILT_DEG.to_radians();
    let tilt = Rotation::from_scaled_axis(Vector3::new(side.cos(), side.sin(), 0.0) * tilt_rad);
    let twist_rad = rng.random_range(-1.0..=1.0) * TWIST_DEG.to_radians();
    let twist = Rotation::from_scaled_axis(Vector3::z() * twist_rad);
    let rotation = tilt * roll * twist;
    Rigid::new(rotation, middle - rotation * calibration_board::middle())
}

/// In the picture.
fn away_from_the_other_arm(drawn: &SystemView) -> Vector3 {
    let there = drawn.forceps_base_from_camera * WORK_POINT;
    let away = there - drawn.forceps_base_from_arthroscope_base.origin();
    let level = Vector3::new(away.x, away.y, 0.0);
    let in_camera = drawn.forceps_base_from_camera.inverse().direction(&level);
    Vector3::new(in_camera.x, in_camera.y, 0.0)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::x)
}

/// Where the motion service must bring the tool for that, by the drawing.
fn target(
    drawn: &SystemView,
    camera_from_board: &Rigid<Camera, Board>,
    flange_from_tool: &Rigid<Flange, Tool>,
) -> Rigid<Base, Tool> {
    let base_from_camera: Rigid<Base, Camera> =
        Rigid::from_isometry(*drawn.forceps_base_from_camera.isometry());
    base_from_camera * *camera_from_board * drawn.flange_from_board.inverse() * *flange_from_tool
}

fn station(
    base_from_flange: Rigid<Base, Flange>,
    seen: &CaptureBoardResponse,
) -> Result<Station, Failure> {
    let lens = Lens {
        focal_px: [seen.fx_px, seen.fy_px],
        center_px: [seen.cx_px, seen.cy_px],
    };
    let corners: Vec<Corner> = seen
        .corners
        .iter()
        .map(|corner| Corner {
            on_board_mm: [corner.x_mm, corner.y_mm],
            seen_px: [corner.column_px, corner.row_px],
        })
        .collect();
    let found = board::solve(&corners, &lens, None).map_err(refused)?;
    Ok(Station {
        base_from_flange,
        camera_from_board: found.camera_from_board,
        camera_covariance: Some(found.covariance),
    })
}
