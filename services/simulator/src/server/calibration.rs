//! The fixtures of a calibration over gRPC, and what the referee says of its outcome.

use std::sync::{Arc, Mutex};

use arthro_bootstrap::status;
use arthro_geometry::frame::{Camera, Flange, ForcepsBase};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::bench_service_server::BenchService;
use arthro_proto::simulator::v1::{
    BoardCorner, CameraScore, CaptureBoardRequest, CaptureBoardResponse, ReadDivotRequest,
    ReadDivotResponse, ScoreCalibrationRequest, ScoreCalibrationResponse, TipScore,
};
use tonic::{Request, Response, Status};

use super::UNIT_TOLERANCE;
use crate::cell::Cell;
use crate::clock::lock;
use crate::scenario::Scenario;

/// What stands on the bench.
#[derive(Clone, Debug)]
pub struct BenchApi {
    scenario: Arc<Scenario>,
    cell: Arc<Mutex<Cell>>,
}

impl BenchApi {
    /// The bench of a cell.
    pub fn new(scenario: Arc<Scenario>, cell: Arc<Mutex<Cell>>) -> Self {
        Self { scenario, cell }
    }

    /// The flange of the forceps arm as it truly is.
    fn flange(&self) -> Rigid<ForcepsBase, Flange> {
        lock(&self.cell).forceps_base_from_flange()
    }

    /// The calibration board as the camera sees it.
    pub(super) fn capture_board(
        &self,
        request: CaptureBoardRequest,
    ) -> Result<Response<CaptureBoardResponse>, Status> {
        let spec = &self.scenario.spec;
        let corners = self.scenario.board_corners(&self.flange(), request.seed);
        let corners = corners.map_err(|not_in_view| {
            status::refused("BOARD_NOT_IN_VIEW", not_in_view.to_string(), &[])
        })?;
        let [cx_px, cy_px] = spec.camera.principal_point_px();
        let corners = corners.into_iter().map(|corner| BoardCorner {
            x_mm: corner.on_board_mm[0],
            y_mm: corner.on_board_mm[1],
            column_px: corner.seen_px[0],
            row_px: corner.seen_px[1],
        });
        Ok(Response::new(CaptureBoardResponse {
            fx_px: spec.camera.focal_px,
            fy_px: spec.camera.focal_px,
            cx_px,
            cy_px,
            corners: corners.collect(),
        }))
    }
}

#[tonic::async_trait]
impl BenchService for BenchApi {
    async fn read_divot(
        &self,
        request: Request<ReadDivotRequest>,
    ) -> Result<Response<ReadDivotResponse>, Status> {
        let seed = request.into_inner().seed;
        let reading = self.scenario.divot_reading(&self.flange(), seed);
        let read = reading.map_err(|empty| {
            status::refused(
                "DIVOT_EMPTY",
                empty.to_string(),
                &[("distance_mm", format!("{:.2}", empty.distance_mm))],
            )
        })?;
        Ok(Response::new(ReadDivotResponse {
            x_mm: read.x,
            y_mm: read.y,
            z_mm: read.z,
        }))
    }
}

// === referee ===

/// How far a claimed calibration is from the truth.
pub(super) fn score(
    scenario: &Scenario,
    claimed: &ScoreCalibrationRequest,
) -> Result<Response<ScoreCalibrationResponse>, Status> {
    let truth = &scenario.truth.mounted;
    let base_from_camera = claimed.base_from_camera.as_ref().map(pose).transpose()?;
    let work_point = match &claimed.work_point {
        Some(at) => point("work_point", at)?,
        None => scenario.camera_from_ct() * scenario.truth.crescent.ct_from_knee.origin(),
    };
    let tip = claimed
        .tip_in_flange
        .as_ref()
        .map(|at| point("tip_in_flange", at))
        .transpose()?;
    let camera = base_from_camera.map(|found| {
        let real = truth.forceps_base_from_camera;
        CameraScore {
            error_mm: (found * work_point - real * work_point).norm(),
            rotation_error_rad: found.rotation().angle_to(&real.rotation()),
            translation_error_mm: (found.origin() - real.origin()).norm(),
        }
    });
    let tip = tip.map(|found| TipScore {
        error_mm: (found - truth.flange_from_tools[0].origin()).norm(),
    });
    Ok(Response::new(ScoreCalibrationResponse { camera, tip }))
}

fn pose(claimed: &common::Pose) -> Result<Rigid<ForcepsBase, Camera>, Status> {
    let (Some(rotation), Some(translation)) = (&claimed.rotation, &claimed.translation) else {
        let all = "must be set, rotation and translation";
        return Err(status::invalid("base_from_camera", all));
    };
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let norm = quaternion.norm();
    if norm.is_nan() || (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(status::invalid(
            "base_from_camera.rotation",
            format!("has norm {norm}, must be 1 within {UNIT_TOLERANCE}"),
        ));
    }
    let translation: Vector3 = point("base_from_camera.translation", translation)?.coords;
    Ok(Rigid::new(
        Rotation::from_quaternion(quaternion),
        translation,
    ))
}

fn point(field: &str, point: &common::Point) -> Result<Point3, Status> {
    let mm = [point.x_mm, point.y_mm, point.z_mm];
    if mm.iter().any(|value| !value.is_finite()) {
        return Err(status::invalid(field, format!("{mm:?} must be finite")));
    }
    Ok(mm.into())
}
