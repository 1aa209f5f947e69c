//! The camera, the bench, the referee and the faults over gRPC.

mod calibration;
mod drive_faults;
mod faults;

use std::pin::Pin;
use std::sync::{Arc, Mutex};

use arthro_bootstrap::status;
use arthro_geometry::frame::{Camera as CameraFrame, Ct};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Rotation, Similarity};
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::camera_service_server::CameraService;
use arthro_proto::simulator::v1::referee_service_server::RefereeService;
use arthro_proto::simulator::v1::{
    CaptureBoardRequest, CaptureBoardResponse, CaptureRequest, CaptureResponse, Collision,
    FrameHeader, GetAccountRequest, GetAccountResponse, GetCellRequest, GetCellResponse,
    ScoreCalibrationRequest, ScoreCalibrationResponse, ScoreRegistrationRequest,
    ScoreRegistrationResponse, ShaftAccount, capture_response::Payload,
};
use bytes::Bytes;
use tokio_stream::Stream;
use tonic::{Request, Response, Status};

pub use self::calibration::BenchApi;
pub use self::drive_faults::DriveFaultApi;
pub use self::faults::{FaultApi, Patient};
use crate::camera::{Camera, Picture};
use crate::cell::{Account, Cell};
use crate::clock::{self, lock};
use crate::scenario::Scenario;

/// Bytes of one message of a stream.
const CHUNK_BYTES: usize = 256 * 1024;

/// Takes pictures.
#[derive(Clone, Debug)]
pub struct CameraApi {
    camera: Arc<Camera>,
    bench: BenchApi,
}

impl CameraApi {
    /// A camera over the bench.
    pub fn new(camera: Camera, bench: BenchApi) -> Self {
        Self {
            camera: Arc::new(camera),
            bench,
        }
    }
}

#[tonic::async_trait]
impl CameraService for CameraApi {
    type CaptureStream = Pin<Box<dyn Stream<Item = Result<CaptureResponse, Status>> + Send>>;

    async fn capture(
        &self,
        request: Request<CaptureRequest>,
    ) -> Result<Response<Self::CaptureStream>, Status> {
        let seed = request.into_inner().seed;
        let camera = Arc::clone(&self.camera);
        let picture = tokio::task::spawn_blocking(move || camera.capture(seed))
            .await
            .map_err(|error| Status::internal(error.to_string()))?;
        let payloads =
            std::iter::once(Payload::Header(header(&self.camera))).chain(chunks(&picture));
        let messages = payloads.map(|payload| {
            Ok(CaptureResponse {
                payload: Some(payload),
            })
        });
        let messages: Vec<_> = messages.collect();
        Ok(Response::new(Box::pin(tokio_stream::iter(messages))))
    }

    async fn capture_board(
        &self,
        request: Request<CaptureBoardRequest>,
    ) -> Result<Response<CaptureBoardResponse>, Status> {
        self.bench.capture_board(request.into_inner())
    }
}

/// Tells what truly happened.
#[derive(Clone, Debug)]
pub struct RefereeApi {
    /// The case.
    pub scenario: Arc<Scenario>,
    /// The truth.
    pub cell: Arc<Mutex<Cell>>,
    /// Its clock.
    pub clock: clock::Handle,
    /// Each arm's controller.
    pub arm_addresses: [String; 2],
    /// The drives' bus.
    pub can_address: String,
}

#[tonic::async_trait]
impl RefereeService for RefereeApi {
    async fn get_cell(
        &self,
        _request: Request<GetCellRequest>,
    ) -> Result<Response<GetCellResponse>, Status> {
        Ok(Response::new(GetCellResponse {
            arm_addresses: self.arm_addresses.to_vec(),
            can_address: self.can_address.clone(),
            cell_time_s: lock(&self.cell).now_s(),
            time_scale: self.clock.time_scale(),
            time_scale_reached: self.clock.time_scale_reached(),
        }))
    }

    async fn get_account(
        &self,
        _request: Request<GetAccountRequest>,
    ) -> Result<Response<GetAccountResponse>, Status> {
        let account = lock(&self.cell).account();
        // The rim takes some milliseconds to measure.
        tokio::task::spawn_blocking(move || account_response(&account))
            .await
            .map(Response::new)
            .map_err(|error| Status::internal(error.to_string()))
    }

    async fn score_registration(
        &self,
        request: Request<ScoreRegistrationRequest>,
    ) -> Result<Response<ScoreRegistrationResponse>, Status> {
        let score = self.scenario.score(&similarity(request.into_inner())?);
        Ok(Response::new(ScoreRegistrationResponse {
            tre_rms_mm: score.tre_rms_mm,
            tre_max_mm: score.tre_max_mm,
            lesion_tre_rms_mm: score.lesion_tre_rms_mm,
            rotation_error_rad: score.rotation_error_rad,
            translation_error_mm: score.translation_error_mm,
            scale_error: score.scale_error,
        }))
    }

    async fn score_calibration(
        &self,
        request: Request<ScoreCalibrationRequest>,
    ) -> Result<Response<ScoreCalibrationResponse>, Status> {
        calibration::score(&self.scenario, &request.into_inner())
    }
}

// === camera ===

fn header(camera: &Camera) -> FrameHeader {
    let lens = camera.intrinsics();
    let [cx_px, cy_px] = camera.principal_point_px();
    FrameHeader {
        width_px: lens.width_px,
        height_px: lens.height_px,
        fx_px: lens.focal_px,
        fy_px: lens.focal_px,
        cx_px,
        cy_px,
        depth_unit_mm: lens.depth_unit_mm,
    }
}

fn chunks(picture: &Picture) -> impl Iterator<Item = Payload> + use<> {
    let depth: Vec<u8> = picture
        .depth
        .iter()
        .flat_map(|unit| unit.to_le_bytes())
        .collect();
    let color = picture.color.as_flattened().to_vec();
    split(depth)
        .map(Payload::Depth)
        .chain(split(color).map(Payload::Color))
}

fn split(bytes: Vec<u8>) -> impl Iterator<Item = Bytes> {
    let bytes = Bytes::from(bytes);
    (0..bytes.len())
        .step_by(CHUNK_BYTES)
        .map(move |start| bytes.slice(start..bytes.len().min(start + CHUNK_BYTES)))
}

// === referee ===

fn account_response(account: &Account) -> GetAccountResponse {
    let tissue = account.referee.tissue();
    let intact = account.knee.intact();
    let collisions = account
        .referee
        .collisions()
        .iter()
        .map(|collision| Collision {
            cell_time_s: collision.time_s,
            first: collision.between.0.to_owned(),
            second: collision.between.1.to_owned(),
            penetration_mm: collision.penetration_mm,
        });
    let arms = [common::Arm::Forceps, common::Arm::Arthroscope];
    let shafts = arms.into_iter().zip(account.referee.shafts());
    let shafts = shafts.map(|(arm, shaft)| ShaftAccount {
        arm: arm.into(),
        rcm_max_mm: shaft.rcm_max_mm,
        rcm_rms_mm: shaft.rcm_rms_mm(),
        ticks_inside: shaft.ticks_inside,
        depth_max_mm: shaft.depth_max_mm,
        insertions: shaft.insertions,
    });
    GetAccountResponse {
        cell_time_s: account.time_s,
        tissue_mm3: intact.total_mm3(),
        damaged_mm3: intact.damaged_mm3,
        damaged_removed_mm3: tissue.removed.damaged_mm3,
        damaged_removed_percent: percent(tissue.removed.damaged_mm3, intact.damaged_mm3),
        healthy_removed_mm3: tissue.removed.healthy_mm3,
        rim_min_mm: account.knee.rim_min_mm(),
        bites: tissue.bites,
        empty_bites: tissue.empty_bites,
        dropped_inside_mm3: tissue.dropped_inside_mm3,
        delivered_to_tray_mm3: tissue.delivered_mm3,
        collisions: collisions.collect(),
        shafts: shafts.collect(),
    }
}

fn percent(part: f64, whole: f64) -> f64 {
    if whole > 0.0 {
        100.0 * part / whole
    } else {
        0.0
    }
}

/// A quaternion may be off unit length by this much.
const UNIT_TOLERANCE: f64 = 1e-3;

fn similarity(request: ScoreRegistrationRequest) -> Result<Similarity<CameraFrame, Ct>, Status> {
    let missing = |field: &str| status::invalid(field, "must be set");
    let claimed = request
        .camera_from_ct
        .ok_or_else(|| missing("camera_from_ct"))?;
    let rotation = claimed
        .rotation
        .ok_or_else(|| missing("camera_from_ct.rotation"))?;
    let translation = claimed
        .translation
        .ok_or_else(|| missing("camera_from_ct.translation"))?;
    if !(claimed.scale.is_finite() && claimed.scale > 0.0) {
        return Err(status::invalid(
            "camera_from_ct.scale",
            format!("{} must be finite and greater than 0", claimed.scale),
        ));
    }
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let norm = quaternion.norm();
    if norm.is_nan() || (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(status::invalid(
            "camera_from_ct.rotation",
            format!("has norm {norm}, must be 1 within {UNIT_TOLERANCE}"),
        ));
    }
    let translation_mm = [translation.x_mm, translation.y_mm, translation.z_mm];
    if translation_mm.iter().any(|value| !value.is_finite()) {
        return Err(status::invalid(
            "camera_from_ct.translation",
            format!("{translation_mm:?} must be finite"),
        ));
    }
    Ok(Similarity::new(
        claimed.scale,
        Rotation::from_quaternion(quaternion),
        translation_mm.into(),
    ))
}
