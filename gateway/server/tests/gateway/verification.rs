//! Acceptance of a registration, touched landmarks, and predicted errors of bites.

use arthro_gateway::config::Config;
use arthro_geometry::Vector3;
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::{CaseState, ErrorPart, VerificationVerdict};
use arthro_proto::registration::v1::Verdict;
use tonic::Status;

use super::bench::{Bench, in_base, reason};

/// Landmarks in ct that span a plane.
const LANDMARKS: [(&str, [f64; 3]); 3] = [
    ("anterior horn", [40.0, 40.0, 50.0]),
    ("posterior horn", [60.0, 42.0, 50.0]),
    ("notch", [50.0, 60.0, 55.0]),
];

impl Bench {
    /// Stands the forceps' tip `off_mm` above a place of ct and touches it there.
    async fn touch(
        &mut self,
        case_id: &str,
        (landmark, [x_mm, y_mm, z_mm]): (&str, [f64; 3]),
        off_mm: f64,
    ) -> Result<proto::VerifyTargetResponse, Status> {
        let tip = in_base([x_mm, y_mm, z_mm]) + Vector3::z() * off_mm;
        self.world.arms.lock().unwrap()[0].tip = tip;
        let request = proto::VerifyTargetRequest {
            case_id: case_id.to_owned(),
            landmark: landmark.to_owned(),
            point: Some(common::Point { x_mm, y_mm, z_mm }),
            operator: "operator".to_owned(),
        };
        Ok(self.cases.verify_target(request).await?.into_inner())
    }

    /// Touches all landmarks, each as far off.
    async fn touch_all(&mut self, case_id: &str, off_mm: f64) -> proto::Verification {
        let mut verification = None;
        for landmark in LANDMARKS {
            let answer = self.touch(case_id, landmark, off_mm).await.unwrap();
            verification = answer.verification;
        }
        verification.unwrap()
    }

    async fn verification(&mut self, case_id: &str) -> proto::Verification {
        self.get(case_id).await.verification.unwrap()
    }

    async fn registered(&mut self, verdict: Verdict) -> String {
        *self.world.verdict.lock().unwrap() = verdict;
        let case_id = self.case().await;
        self.upload(&case_id).await;
        self.register(&case_id).await;
        case_id
    }
}

fn required(config: &mut Config) {
    config.verification.required = true;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_doubtful_registration_needs_a_surgeon_and_keeps_what_they_took_upon_themselves() {
    let mut bench = Bench::new().await;
    let case_id = bench.registered(Verdict::Review).await;
    let refusal = bench.accept(&case_id).await.unwrap_err();
    assert!(refusal.message().contains("OVERLAP_LOW"), "{refusal}");
    assert_eq!(reason::<()>(Err(refusal)), "SURGEON_NEEDED");

    let case = bench.accept_as(&case_id, "Dr. Adams").await.unwrap();
    assert_eq!(case.state(), CaseState::Accepted);
    let acceptance = case.acceptance.unwrap();
    assert_eq!(
        (acceptance.accepted_by.as_str(), acceptance.role.as_str()),
        ("Dr. Adams", "surgeon")
    );
    assert_eq!(acceptance.verdict(), Verdict::Review);
    assert_eq!(acceptance.reasons, ["OVERLAP_LOW"]);
    assert!(acceptance.accepted_at_ms > 0);

    bench.kill().await;
    bench.restart(|_| {}).await;
    let case = bench.get(&case_id).await.case.unwrap();
    assert_eq!(case.acceptance.unwrap(), acceptance);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_operator_accepts_a_registration_without_doubt_and_a_surgeon_none_that_is_rejected() {
    let mut bench = Bench::new().await;
    let case_id = bench.registered(Verdict::Accept).await;
    let case = bench.accept(&case_id).await.unwrap();
    assert_eq!(case.acceptance.unwrap().role, "operator");
    let case_id = bench.registered(Verdict::Reject).await;
    let accepted = bench.accept_as(&case_id, "Dr. Adams").await;
    assert_eq!(reason(accepted), "REGISTRATION_REJECTED");
}

#[tokio::test(flavor = "multi_thread")]
async fn three_landmarks_where_they_should_be_verify_a_case() {
    let mut bench = Bench::with(required).await;
    let (case_id, digest) = bench.planned().await;
    assert_eq!(
        bench.verification(&case_id).await.verdict(),
        VerificationVerdict::Absent
    );
    assert_eq!(
        reason(bench.approve(&case_id, &digest).await),
        "NOT_VERIFIED"
    );

    let first = bench.touch(&case_id, LANDMARKS[0], 0.5).await.unwrap();
    assert!((first.touch.unwrap().distance_mm - 0.5).abs() < 1e-9);
    assert_eq!(
        first.verification.unwrap().verdict(),
        VerificationVerdict::Pending
    );
    assert_eq!(
        reason(bench.approve(&case_id, &digest).await),
        "NOT_VERIFIED"
    );

    let verification = bench.touch_all(&case_id, 0.5).await;
    assert_eq!(verification.verdict(), VerificationVerdict::Passed);
    assert_eq!(verification.touches.len(), 3);
    assert!((verification.tre_rms_mm - 0.5).abs() < 1e-9);
    bench.approve(&case_id, &digest).await.unwrap();
    bench.start(&case_id, &digest).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn landmarks_above_the_limit_block_approval_until_the_wrong_touch_is_taken_back() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    let verification = bench.touch_all(&case_id, 1.6).await;
    assert_eq!(verification.verdict(), VerificationVerdict::Failed);
    let refusal = bench.approve(&case_id, &digest).await.unwrap_err();
    assert!(refusal.message().contains("1.60 mm off"), "{refusal}");
    assert_eq!(reason::<()>(Err(refusal)), "VERIFICATION_FAILED");

    for (landmark, _) in &LANDMARKS[..2] {
        let request = proto::RemoveTouchRequest {
            case_id: case_id.clone(),
            landmark: (*landmark).to_owned(),
            operator: "operator".to_owned(),
        };
        bench.cases.remove_touch(request.clone()).await.unwrap();
        let again = bench.cases.remove_touch(request).await;
        assert_eq!(reason(again), "UNKNOWN_LANDMARK");
    }
    // One is left, and it still speaks against the registration; touched again, it does not.
    assert_eq!(
        reason(bench.approve(&case_id, &digest).await),
        "VERIFICATION_FAILED"
    );
    bench.touch(&case_id, LANDMARKS[2], 0.2).await.unwrap();
    bench.approve(&case_id, &digest).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_landmark_found_off_after_the_approval_blocks_the_start() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    bench.touch(&case_id, LANDMARKS[0], 4.0).await.unwrap();
    assert_eq!(
        reason(bench.start(&case_id, &digest).await),
        "VERIFICATION_FAILED"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn touches_outlive_a_restart_and_are_void_with_another_registration_or_calibration() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.planned().await;
    let before = bench.touch_all(&case_id, 0.5).await;
    bench.kill().await;
    bench.restart(|_| {}).await;
    assert_eq!(bench.verification(&case_id).await, before);

    bench.kill().await;
    bench
        .restart(|config| {
            let section = config.calibration.as_mut().unwrap();
            section.forceps_base_from_camera.translation_mm[0] += 0.01;
        })
        .await;
    assert_eq!(
        bench.verification(&case_id).await.verdict(),
        VerificationVerdict::Absent
    );
    bench.touch_all(&case_id, 0.5).await;
    bench.register(&case_id).await;
    assert_eq!(
        bench.verification(&case_id).await.verdict(),
        VerificationVerdict::Absent
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn the_tip_of_an_arm_that_moves_or_is_away_is_not_read() {
    let mut bench = Bench::new().await;
    let (case_id, _) = bench.planned().await;
    bench.world.arms.lock().unwrap()[0].drift_mm = 0.06;
    let moving = bench.touch(&case_id, LANDMARKS[0], 0.0).await;
    assert_eq!(reason(moving), "ARM_MOVING");
    bench.world.arms.lock().unwrap()[0].drift_mm = 0.0;
    bench.world.arms.lock().unwrap()[0].connected = false;
    let away = bench.touch(&case_id, LANDMARKS[0], 0.0).await;
    assert_eq!(reason(away), "NOT_CONNECTED");
    assert_eq!(
        bench.verification(&case_id).await.verdict(),
        VerificationVerdict::Absent
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_touch_without_a_registration_name_or_place_is_refused() {
    let mut bench = Bench::new().await;
    let case_id = bench.case().await;
    bench.upload(&case_id).await;
    let early = bench.touch(&case_id, LANDMARKS[0], 0.0).await;
    assert_eq!(reason(early), "NOT_REGISTERED");
    let refusal = bench
        .cases
        .verify_target(proto::VerifyTargetRequest::default())
        .await
        .unwrap_err();
    let fields: Vec<_> = arthro_bootstrap::status::violations(&refusal)
        .into_iter()
        .map(|(field, _)| field)
        .collect();
    assert_eq!(fields, ["case_id", "landmark", "point", "operator"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_says_how_far_its_bites_may_be_off_and_what_is_not_known() {
    let mut bench = Bench::with(|config| {
        config.error_budget.arm_accuracy_mm = 0.3;
        config.error_budget.bite_limit_mm = 0.45;
        let mut covariance = vec![0.0; 36];
        covariance[35] = 0.16;
        config.calibration.as_mut().unwrap().hand_eye_covariance = Some(covariance);
    })
    .await;
    let (case_id, _) = bench.planned().await;
    let errors = bench.get(&case_id).await.predicted_errors.unwrap();
    assert_eq!(errors.bites.len(), 3);
    let unknown: Vec<_> = errors.unknown().collect();
    assert_eq!(unknown, [ErrorPart::Registration, ErrorPart::ToolTip]);
    for bite in &errors.bites {
        assert!((bite.hand_eye_mm - 0.4).abs() < 1e-9 && (bite.arm_mm - 0.3).abs() < 1e-9);
        assert!((bite.rms_mm - 0.5).abs() < 1e-9);
        assert_eq!(
            (bite.dominant(), bite.above_limit),
            (ErrorPart::HandEye, true)
        );
    }
}
