//! Calibrations: saved, put in force, expired and revoked, and what each does to plans and approvals.

use arthro_gateway::config::Config;
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::{CalibrationKind, CalibrationState, CaseState, ProcedureState};
use arthro_proto::registration::v1 as registration;
use proto::save_calibration_request::Result as Saved;
use tonic::Status;

use super::bench::{Bench, calibration, reason};
use super::fakes::motion::TIP_IN_FLANGE;

/// A camera found this far along x from where the configuration has it, mm.
const CAMERA_OFF_MM: f64 = 2.0;

fn residuals(kept: usize, rejected: usize) -> Vec<registration::CalibrationResidual> {
    let residual = |rejected| registration::CalibrationResidual {
        translation_mm: 0.1,
        rejected,
        ..registration::CalibrationResidual::default()
    };
    let kept = std::iter::repeat_n(residual(false), kept);
    kept.chain(std::iter::repeat_n(residual(true), rejected))
        .collect()
}

fn diagonal(size: usize, variance: f64) -> Vec<f64> {
    let entry = |index: usize| match index % (size + 1) {
        0 => variance,
        _ => 0.0,
    };
    (0..size * size).map(entry).collect()
}

fn hand_eye() -> registration::SolveHandEyeResponse {
    let configured = calibration().forceps_base_from_camera;
    let [w, x, y, z] = configured.rotation;
    let [x_mm, y_mm, z_mm] = configured.translation_mm;
    registration::SolveHandEyeResponse {
        mount_from_camera: Some(common::Pose {
            rotation: Some(common::Quaternion { w, x, y, z }),
            translation: Some(common::Point {
                x_mm: x_mm + CAMERA_OFF_MM,
                y_mm,
                z_mm,
            }),
        }),
        mount_from_camera_covariance: diagonal(6, 1e-6),
        residuals: residuals(18, 2),
        ..registration::SolveHandEyeResponse::default()
    }
}

fn tool_tip(off_mm: f64) -> registration::SolveToolTipResponse {
    registration::SolveToolTipResponse {
        tip: Some(common::Point {
            x_mm: TIP_IN_FLANGE.x + off_mm,
            y_mm: TIP_IN_FLANGE.y,
            z_mm: TIP_IN_FLANGE.z,
        }),
        tip_covariance_mm2: diagonal(3, 0.03),
        residuals: residuals(16, 0),
        ..registration::SolveToolTipResponse::default()
    }
}

impl Bench {
    async fn save(&mut self, result: Saved, valid_for_s: f64) -> Result<String, Status> {
        let request = proto::SaveCalibrationRequest {
            label: "before the list of today".to_owned(),
            operator: "engineer".to_owned(),
            valid_for_s,
            result: Some(result),
        };
        let answer = self.calibrations.save_calibration(request).await?;
        Ok(answer.into_inner().calibration.unwrap().calibration_id)
    }

    async fn activate(&mut self, calibration_id: &str) -> Result<proto::Calibration, Status> {
        let request = proto::ActivateCalibrationRequest {
            calibration_id: calibration_id.to_owned(),
            operator: "engineer".to_owned(),
        };
        let answer = self.calibrations.activate_calibration(request).await?;
        Ok(answer.into_inner().calibration.unwrap())
    }

    async fn revoke(&mut self, calibration_id: &str) {
        let request = proto::RevokeCalibrationRequest {
            calibration_id: calibration_id.to_owned(),
            operator: "engineer".to_owned(),
            because: "the stand was bumped".to_owned(),
        };
        self.calibrations.revoke_calibration(request).await.unwrap();
    }

    async fn calibration(&mut self, calibration_id: &str) -> proto::Calibration {
        let request = proto::GetCalibrationRequest {
            calibration_id: calibration_id.to_owned(),
        };
        let answer = self.calibrations.get_calibration(request).await.unwrap();
        answer.into_inner().calibration.unwrap()
    }

    /// A hand-eye calibration in force.
    async fn calibrated(&mut self) -> String {
        let id = self.save(Saved::HandEye(hand_eye()), 0.0).await.unwrap();
        self.activate(&id).await.unwrap();
        id
    }

    async fn state(&mut self, case_id: &str) -> CaseState {
        self.get(case_id).await.case.unwrap().state()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_saved_calibration_is_kept_whole_and_is_not_in_force_by_itself() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let id = bench.save(Saved::HandEye(hand_eye()), 0.0).await.unwrap();
    let saved = bench.calibration(&id).await;
    assert!(!saved.in_force);
    assert_eq!(saved.state(), CalibrationState::Valid);
    assert_eq!(saved.valid_until_ms - saved.saved_at_ms, 90 * 86_400_000);
    assert_eq!(
        saved.result,
        Some(proto::calibration::Result::HandEye(hand_eye()))
    );
    // Each axis is off by a thousandth of a millimetre and of a radian over 350 mm.
    let expected_mm = (3e-6f64 + 2e-6 * 350.0 * 350.0).sqrt();
    assert!(
        (saved.deviation_mm - expected_mm).abs() < 1e-9,
        "{}",
        saved.deviation_mm
    );
    assert_eq!(
        bench.get(&case_id).await.case.unwrap().approved_digest,
        digest
    );

    bench.kill().await;
    bench.restart(|_| {}).await;
    assert_eq!(bench.calibration(&id).await, saved);
    let listed = bench
        .calibrations
        .list_calibrations(proto::ListCalibrationsRequest {});
    let listed = listed.await.unwrap().into_inner().calibrations;
    let ids: Vec<_> = listed
        .iter()
        .map(|one| (one.calibration_id.as_str(), one.in_force))
        .collect();
    assert_eq!(
        ids,
        [
            ("configured-hand-eye", true),
            ("configured-tool-tip", true),
            (id.as_str(), false)
        ]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_calibration_put_in_force_voids_the_approval_and_moves_the_bites() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let id = bench.calibrated().await;
    assert!(bench.calibration(&id).await.in_force);
    assert!(!bench.calibration("configured-hand-eye").await.in_force);
    assert_eq!(bench.state(&case_id).await, CaseState::Planned);
    assert_eq!(
        reason(bench.start(&case_id, &digest).await),
        "APPROVAL_VOID"
    );

    bench.plan(&case_id).await.unwrap();
    let digest = bench.get(&case_id).await.case.unwrap().plan_digest;
    bench.approve(&case_id, &digest).await.unwrap();
    let procedure = bench.start(&case_id, &digest).await.unwrap();
    bench.reaches(&procedure, ProcedureState::Completed).await;
    let bitten = bench.world.bitten_at.lock().unwrap()[0];
    let [x, y, z] = super::fakes::computing::CENTERS[0];
    let configured = super::bench::in_base([x, y, z]);
    assert!(
        (bitten.x - configured.x - CAMERA_OFF_MM).abs() < 1e-6,
        "{bitten} {configured}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn going_back_to_the_configured_calibration_is_possible_and_again_another_one() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    bench.calibrated().await;
    bench.activate("configured-hand-eye").await.unwrap();
    // Nothing else changed since, so that what was approved is what is in force.
    assert_eq!(bench.state(&case_id).await, CaseState::Approved);
    assert_eq!(bench.get(&case_id).await.case.unwrap().plan_digest, digest);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_revoked_calibration_refuses_everything_until_another_is_in_force() {
    let mut bench = Bench::new().await;
    let id = bench.calibrated().await;
    let (case_id, digest) = bench.approved().await;
    bench.revoke(&id).await;
    let revoked = bench.calibration(&id).await;
    assert_eq!(revoked.state(), CalibrationState::Revoked);
    assert!(revoked.in_force && revoked.revoked_because == "the stand was bumped");

    let expired = "CALIBRATION_EXPIRED";
    assert_eq!(reason(bench.plan(&case_id).await), expired);
    assert_eq!(reason(bench.approve(&case_id, &digest).await), expired);
    assert_eq!(reason(bench.activate(&id).await), expired);
    let refusal = bench.start(&case_id, &digest).await.unwrap_err();
    assert!(refusal.message().contains(&id), "{refusal}");
    assert_eq!(reason::<()>(Err(refusal)), expired);

    bench.activate("configured-hand-eye").await.unwrap();
    bench.plan(&case_id).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_calibration_revoked_in_the_middle_interrupts_before_the_next_bite() {
    let mut bench = Bench::new().await;
    let id = bench.calibrated().await;
    bench.world.hold("RETRACT FORCEPS");
    let procedure = bench.started().await;
    bench.world.arrived("RETRACT FORCEPS", 1).await;
    bench.revoke(&id).await;
    bench.world.let_go();
    let interrupted = bench.reaches(&procedure, ProcedureState::Interrupted).await;
    assert_eq!(interrupted.reason, "CALIBRATION_EXPIRED");
    assert_eq!(bench.world.bitten_at.lock().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_configured_calibration_past_its_day_refuses_planning_and_says_since_when() {
    let expired = |config: &mut Config| {
        let section = config.calibration.as_mut().unwrap();
        section.valid_until = Some("2024-02-29".to_owned());
    };
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    bench.kill().await;
    bench.restart(expired).await;
    let refusal = bench.plan(&case_id).await.unwrap_err();
    assert!(
        refusal
            .message()
            .contains("configured-hand-eye expired at 2024-02-29T23:59:59Z"),
        "{refusal}"
    );
    let started = bench.start(&case_id, &digest).await;
    assert_eq!(reason(started), "CALIBRATION_EXPIRED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tip_that_the_arm_does_not_carry_is_not_put_in_force() {
    let mut bench = Bench::new().await;
    let other = bench
        .save(Saved::ToolTip(tool_tip(0.5)), 0.0)
        .await
        .unwrap();
    assert_eq!(reason(bench.activate(&other).await), "TOOL_NOT_IN_USE");
    let same = bench
        .save(Saved::ToolTip(tool_tip(0.0)), 0.0)
        .await
        .unwrap();
    let activated = bench.activate(&same).await.unwrap();
    assert_eq!(activated.kind(), CalibrationKind::ToolTip);
    assert!(activated.in_force);
    assert!((activated.deviation_mm - 0.3).abs() < 1e-12);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_calibration_that_carries_no_answer_is_refused_with_field_and_limit() {
    let mut bench = Bench::new().await;
    let mut few = hand_eye();
    few.residuals = residuals(9, 5);
    let mut unsure = hand_eye();
    unsure.mount_from_camera_covariance.pop();
    let mut metres = tool_tip(0.0);
    metres.tip_covariance_mm2[1] = 1.0;
    for (result, field) in [
        (Saved::HandEye(few), "hand_eye.residuals"),
        (
            Saved::HandEye(unsure),
            "hand_eye.mount_from_camera_covariance",
        ),
        (Saved::ToolTip(metres), "tool_tip.tip_covariance_mm2"),
    ] {
        let refusal = bench.save(result, 0.0).await.unwrap_err();
        let violations = arthro_bootstrap::status::violations(&refusal);
        assert_eq!(violations[0].0, field);
    }
    let endless = bench.save(Saved::HandEye(hand_eye()), f64::INFINITY).await;
    let violations = arthro_bootstrap::status::violations(&endless.unwrap_err());
    assert_eq!(violations[0].0, "valid_for_s");
    let unknown = bench.activate("none").await;
    assert_eq!(reason(unknown), "UNKNOWN_CALIBRATION");
}
