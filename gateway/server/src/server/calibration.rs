//! `CalibrationService`.

use arthro_bootstrap::Caller;
use arthro_geometry::Vector3;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::calibration_service_server::CalibrationService;
use arthro_proto::gateway::v1::save_calibration_request::Result as Given;
use arthro_proto::registration::v1 as registration;
use prost::Message as _;
use tonic::{Request, Response, Status};

use super::{Violations, id, person, refuse, text};
use crate::approval;
use crate::calibrations::record::{Calibration, How, Kind, Measured};
use crate::calibrations::{Calibrations, Listed, New};
use crate::clients::Motion;
use crate::clients::motion::Arm;
use crate::config::Cell;
use crate::error::{Error, Result as DomainResult, Violation};
use crate::error_budget::hand_eye_deviation_mm;
use crate::wall_clock::now_ms;
use crate::wire;

/// Ten years: no mounting is trusted for longer without another look.
const LONGEST_S: f64 = 315_360_000.0;
/// The motion service's tip may be this far from the calibrated one, mm: what rounds in a configuration file.
const SAME_TIP_MM: f64 = 0.05;
/// Where the accuracy of a hand-eye calibration is told: this far in front of the camera, mm.
const WORK_DISTANCE_MM: f64 = 350.0;

/// Serves the calibrations.
pub(super) struct CalibrationApi {
    calibrations: Calibrations,
    motion: Motion,
}

impl CalibrationApi {
    pub(super) const fn new(calibrations: Calibrations, motion: Motion) -> Self {
        Self {
            calibrations,
            motion,
        }
    }

    async fn activate(
        &self,
        caller: &Caller,
        request: proto::ActivateCalibrationRequest,
    ) -> DomainResult<Listed> {
        let calibration_id = id("calibration_id", request.calibration_id)?;
        let operator = person(caller, "operator", request.operator)?;
        if Kind::of_configured(&calibration_id).is_none() {
            let calibration = self.calibrations.saved(&calibration_id).await?;
            calibration.usable(now_ms())?;
            if let Measured::ToolTip { tip, .. } = &calibration.measured {
                self.check_tip(tip).await?;
            }
        }
        self.calibrations.activate(&calibration_id, &operator).await
    }

    /// The motion service brings its own tip to the bites: a calibration of another one would say nothing of them.
    async fn check_tip(&self, calibrated: &arthro_geometry::Point3) -> DomainResult<()> {
        let in_use = self.motion.tip_in_flange(Arm::Forceps).await?;
        let apart_mm = (in_use - calibrated).norm();
        if apart_mm <= SAME_TIP_MM {
            return Ok(());
        }
        Err(Error::ToolNotInUse {
            apart_mm,
            limit_mm: SAME_TIP_MM,
        })
    }

    fn message(&self, listed: &Listed) -> proto::Calibration {
        match listed {
            Listed::Configured(kind, in_force) => self
                .calibrations
                .configured()
                .map_or_else(proto::Calibration::default, |cell| {
                    configured_message(*kind, *in_force, cell)
                }),
            Listed::Saved(calibration, in_force) => saved_message(calibration, *in_force),
        }
    }
}

#[tonic::async_trait]
impl CalibrationService for CalibrationApi {
    async fn save_calibration(
        &self,
        request: Request<proto::SaveCalibrationRequest>,
    ) -> Result<Response<proto::SaveCalibrationResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let new = new(&caller, request.into_inner()).map_err(refuse)?;
        let saved = self.calibrations.save(new).await.map_err(refuse)?;
        Ok(Response::new(proto::SaveCalibrationResponse {
            calibration: Some(self.message(&saved)),
        }))
    }

    async fn list_calibrations(
        &self,
        _: Request<proto::ListCalibrationsRequest>,
    ) -> Result<Response<proto::ListCalibrationsResponse>, Status> {
        let listed = self.calibrations.list().await.map_err(refuse)?;
        Ok(Response::new(proto::ListCalibrationsResponse {
            calibrations: listed.iter().map(|one| self.message(one)).collect(),
        }))
    }

    async fn get_calibration(
        &self,
        request: Request<proto::GetCalibrationRequest>,
    ) -> Result<Response<proto::GetCalibrationResponse>, Status> {
        let calibration_id = request.into_inner().calibration_id;
        let calibration_id = id("calibration_id", calibration_id).map_err(refuse)?;
        let found = self.calibrations.get(&calibration_id).await;
        Ok(Response::new(proto::GetCalibrationResponse {
            calibration: Some(self.message(&found.map_err(refuse)?)),
        }))
    }

    async fn activate_calibration(
        &self,
        request: Request<proto::ActivateCalibrationRequest>,
    ) -> Result<Response<proto::ActivateCalibrationResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let activated = self.activate(&caller, request.into_inner()).await;
        Ok(Response::new(proto::ActivateCalibrationResponse {
            calibration: Some(self.message(&activated.map_err(refuse)?)),
        }))
    }

    async fn revoke_calibration(
        &self,
        request: Request<proto::RevokeCalibrationRequest>,
    ) -> Result<Response<proto::RevokeCalibrationResponse>, Status> {
        let caller = Caller::of(request.extensions());
        let request = request.into_inner();
        let mut violations = Violations::default();
        let calibration_id = violations.check(id("calibration_id", request.calibration_id));
        let operator = violations.check(person(&caller, "operator", request.operator));
        let because = violations.check(text("because", request.because, 200));
        violations.finish().map_err(refuse)?;
        let (Some(calibration_id), Some(operator), Some(because)) =
            (calibration_id, operator, because)
        else {
            return Err(refuse(Error::Invalid(Vec::new())));
        };
        let revoked = self
            .calibrations
            .revoke(&calibration_id, operator, because)
            .await;
        Ok(Response::new(proto::RevokeCalibrationResponse {
            calibration: Some(self.message(&revoked.map_err(refuse)?)),
        }))
    }
}

// === reading ===

fn new(caller: &Caller, request: proto::SaveCalibrationRequest) -> DomainResult<New> {
    let mut violations = Violations::default();
    let label = violations.check(text("label", request.label, 200));
    let saved_by = violations.check(person(caller, "operator", request.operator));
    let valid_for_s = violations.check(valid_for_s(request.valid_for_s));
    let result =
        violations.check(match request.result {
            Some(Given::HandEye(result)) => wire::hand_eye(&result, "hand_eye")
                .map(|measured| (measured, result.encode_to_vec())),
            Some(Given::ToolTip(result)) => wire::tool_tip(&result, "tool_tip")
                .map(|measured| (measured, result.encode_to_vec())),
            None => Err(Violation::new(
                "result",
                "is missing; must be hand_eye or tool_tip",
            )),
        });
    violations.finish()?;
    let (Some(label), Some(saved_by), Some(valid_for_s), Some((measured, encoded))) =
        (label, saved_by, valid_for_s, result)
    else {
        return Err(Error::Invalid(Vec::new()));
    };
    Ok(New {
        label,
        saved_by,
        valid_for_s,
        measured,
        encoded: encoded.into(),
    })
}

/// `None`: as long as the configuration says.
fn valid_for_s(seconds: f64) -> Result<Option<f64>, Violation> {
    if seconds == 0.0 {
        return Ok(None);
    }
    if (1.0..=LONGEST_S).contains(&seconds) {
        return Ok(Some(seconds));
    }
    Err(Violation::new(
        "valid_for_s",
        format!("is {seconds} s; must be 0 or within 1 .. {LONGEST_S} s"),
    ))
}

// === writing ===

fn saved_message(calibration: &Calibration, in_force: bool) -> proto::Calibration {
    use proto::calibration::Result as Shown;
    let state = match calibration.usable(now_ms()) {
        Ok(()) => proto::CalibrationState::Valid,
        Err(unusable) => match unusable.how {
            How::Expired => proto::CalibrationState::Expired,
            How::Revoked => proto::CalibrationState::Revoked,
        },
    };
    // What was read from the journal has been decoded before.
    let encoded = calibration.encoded.as_ref();
    let (deviation_mm, result) = match &calibration.measured {
        Measured::HandEye { pose, covariance } => {
            let lever = pose.direction(&(Vector3::z() * WORK_DISTANCE_MM));
            let result = registration::SolveHandEyeResponse::decode(encoded);
            (
                hand_eye_deviation_mm(covariance, &lever),
                result.ok().map(Shown::HandEye),
            )
        }
        Measured::ToolTip { covariance_mm2, .. } => {
            let result = registration::SolveToolTipResponse::decode(encoded);
            (
                covariance_mm2.trace().max(0.0).sqrt(),
                result.ok().map(Shown::ToolTip),
            )
        }
    };
    let revoked = calibration.revoked.clone();
    proto::Calibration {
        calibration_id: calibration.id.clone(),
        kind: kind_message(calibration.kind()).into(),
        label: calibration.label.clone(),
        saved_by: calibration.saved_by.clone(),
        saved_at_ms: calibration.saved_at_ms,
        valid_until_ms: calibration.valid_until_ms,
        state: state.into(),
        in_force,
        revoked_at_ms: revoked.as_ref().map_or(0, |revoked| revoked.at_ms),
        revoked_by: revoked
            .as_ref()
            .map_or_else(String::new, |revoked| revoked.by.clone()),
        revoked_because: revoked.map_or_else(String::new, |revoked| revoked.because),
        digest: approval::calibration_digest(calibration).to_string(),
        deviation_mm,
        result,
    }
}

fn configured_message(kind: Kind, in_force: bool, cell: &Cell) -> proto::Calibration {
    let calibrations = &cell.calibrations;
    let lever = Vector3::z() * WORK_DISTANCE_MM;
    let lever = cell.forceps_base_from_camera.direction(&lever);
    let (digest, valid_until_ms, deviation_mm) = match kind {
        Kind::HandEye => {
            let standing = &calibrations.hand_eye;
            let covariance = standing.covariance.as_ref();
            let deviation_mm = covariance.map(|known| hand_eye_deviation_mm(known, &lever));
            (standing.digest, standing.valid_until_ms, deviation_mm)
        }
        Kind::ToolTip => {
            let standing = &calibrations.tool_tip;
            let covariance = standing.covariance.as_ref();
            let deviation_mm = covariance.map(|known| known.trace().max(0.0).sqrt());
            (standing.digest, standing.valid_until_ms, deviation_mm)
        }
    };
    let state = match valid_until_ms {
        Some(until_ms) if until_ms < now_ms() => proto::CalibrationState::Expired,
        _ => proto::CalibrationState::Valid,
    };
    proto::Calibration {
        calibration_id: kind.configured_id().to_owned(),
        kind: kind_message(kind).into(),
        label: "of the configuration".to_owned(),
        valid_until_ms: valid_until_ms.unwrap_or_default(),
        state: state.into(),
        in_force,
        digest: digest.to_string(),
        deviation_mm: deviation_mm.unwrap_or_default(),
        ..proto::Calibration::default()
    }
}

const fn kind_message(kind: Kind) -> proto::CalibrationKind {
    match kind {
        Kind::HandEye => proto::CalibrationKind::HandEye,
        Kind::ToolTip => proto::CalibrationKind::ToolTip,
    }
}
