//! Landmarks touched with the simulated arm: what `VerifyTarget` measures is what the referee knows.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use arthro_geometry::frame::{Ct, ForcepsBase};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use arthro_proto::common::v1::{self as common, Arm, Authorization, OperationState};
use arthro_proto::gateway::v1 as gateway;
use arthro_proto::motion::v1::{self as motion, move_request};
use arthro_proto::registration::v1 as registration;
use arthro_simulator::referee::score::Believed;
use arthro_simulator::scenario::{Scenario, Spec};
use arthro_tests::Cell;
use arthro_tests::command::number;
use serde_json::Value;

/// Fiducials about where the tip begins, forceps arm's base, mm.
const FIDUCIALS: [(&str, [f64; 3]); 4] = [
    ("first", [0.0, 0.0, 0.0]),
    ("second", [-25.0, 0.0, 0.0]),
    ("third", [0.0, 0.0, 25.0]),
    ("fourth", [-25.0, 0.0, 25.0]),
];
/// A wrong hand-eye calibration is this far off, mm.
const CAMERA_OFF_MM: f64 = 3.0;

/// A cell with a plan that waits for approval, and the commanded forceps arm in it.
struct Touching {
    cell: Cell,
    scenario: Scenario,
    case: String,
    digest: String,
    fencing_token: u64,
    start: common::Pose,
    moves: u32,
}

impl Touching {
    async fn new() -> Self {
        let cell = Cell::up().await;
        let (case, digest) = cell.planned_case().await;
        let mut arms = cell.motion().await;
        let request = motion::AcquireLeaseRequest {
            holder: "verification".to_owned(),
            ttl_s: 60.0,
        };
        let lease = arms.acquire_lease(request).await.expect("a lease");
        let request = motion::WatchStateRequest { period_s: 0.0 };
        let mut states = arms
            .watch_state(request)
            .await
            .expect("states")
            .into_inner();
        let state = states.message().await.expect("a state").expect("a state");
        let forceps = state.arms.iter().find(|state| state.arm() == Arm::Forceps);
        // The cell of `arthro up` follows from its seed alone.
        let spec = Spec {
            seed: 1,
            ..Spec::default()
        };
        Self {
            scenario: Scenario::phantom(spec).expect("the phantom is a case"),
            case,
            digest,
            fencing_token: lease.into_inner().lease.expect("a lease").fencing_token,
            start: forceps
                .and_then(|state| state.base_from_tool)
                .expect("a pose"),
            moves: 0,
            cell,
        }
    }

    /// Where the gateway has ct by registration and the drawn hand-eye.
    async fn base_from_ct(&self) -> Similarity<ForcepsBase, Ct> {
        let request = gateway::GetCaseRequest {
            case_id: self.case.clone(),
        };
        let case = self.cell.cases().await.get_case(request).await;
        let found = case.expect("the case").into_inner().registration;
        let found = found
            .and_then(|result| result.camera_from_ct)
            .expect("a pose");
        let rotation = found.rotation.expect("a rotation");
        let translation = found.translation.expect("a translation");
        let camera_from_ct = Similarity::new(
            found.scale,
            Rotation::from_quaternion(Quaternion::new(
                rotation.w, rotation.x, rotation.y, rotation.z,
            )),
            point(&translation).coords,
        );
        Similarity::from(self.scenario.system_view().forceps_base_from_camera) * camera_from_ct
    }

    /// How far the registration has a place of ct from where it truly is.
    fn miss(&self, base_from_ct: Similarity<ForcepsBase, Ct>, place: &Point3) -> Vector3 {
        let believed = Believed {
            base_from_ct,
            tip_in_flange: self.scenario.system_view().flange_from_tool.origin(),
            base_from_flange: Rotation::identity(),
        };
        self.scenario.miss(place, &believed)
    }

    /// Brings the tip straight there.
    async fn go(&mut self, tip: &Point3) {
        self.moves += 1;
        let pose = common::Pose {
            translation: Some(common::Point {
                x_mm: tip.x,
                y_mm: tip.y,
                z_mm: tip.z,
            }),
            ..self.start
        };
        let request = motion::MoveRequest {
            authorization: Some(Authorization {
                fencing_token: self.fencing_token,
                operation_id: format!("verification-{}", self.moves),
            }),
            arm: Arm::Forceps.into(),
            motion: Some(move_request::Motion::Free(motion::FreeMove {
                base_from_tool: Some(pose),
                speed_mm_s: 0.0,
            })),
        };
        let moving = self.cell.motion().await.r#move(request).await;
        let mut moving = moving.expect("the move is taken").into_inner();
        let mut state = OperationState::Unspecified;
        while let Some(message) = moving.message().await.expect("the move goes on") {
            state = message.operation.expect("an operation").state();
        }
        assert_eq!(state, OperationState::Done);
    }

    async fn touch(&self, landmark: &str, place: &Point3) -> Value {
        let at = format!("{},{},{}", place.x, place.y, place.z);
        let (case, flag) = (self.case.as_str(), format!("--at={at}"));
        let arguments = [
            "case",
            "verify",
            case,
            "--landmark",
            landmark,
            &flag,
            "--operator",
            "test",
        ];
        self.cell.done(&arguments).await
    }

    async fn approve(&self, digest: &str) -> (i32, String) {
        let case = self.case.as_str();
        let arguments = [
            "case",
            "approve",
            case,
            "--digest",
            digest,
            "--surgeon",
            "test",
        ];
        let answer = self.cell.command(&arguments).await;
        (answer.code, answer.reason().to_owned())
    }

    /// Puts a hand-eye calibration in force that has the camera beside where it is.
    async fn put_camera_beside(&self) {
        let drawn = self.scenario.system_view().forceps_base_from_camera;
        let rotation = drawn.rotation();
        let there = drawn.translation_mm() + Vector3::x() * CAMERA_OFF_MM;
        let result = registration::SolveHandEyeResponse {
            mount_from_camera: Some(common::Pose {
                rotation: Some(common::Quaternion {
                    w: rotation.w,
                    x: rotation.i,
                    y: rotation.j,
                    z: rotation.k,
                }),
                translation: Some(common::Point {
                    x_mm: there.x,
                    y_mm: there.y,
                    z_mm: there.z,
                }),
            }),
            mount_from_camera_covariance: vec![0.0; 36],
            residuals: vec![registration::CalibrationResidual::default(); 20],
            ..registration::SolveHandEyeResponse::default()
        };
        let request = gateway::SaveCalibrationRequest {
            label: "a stand that somebody moved".to_owned(),
            operator: "test".to_owned(),
            valid_for_s: 0.0,
            result: Some(gateway::save_calibration_request::Result::HandEye(result)),
        };
        let saved = self
            .cell
            .calibrations()
            .await
            .save_calibration(request)
            .await;
        let saved = saved.expect("it is kept").into_inner().calibration;
        let id = saved.expect("a calibration").calibration_id;
        let arguments = ["calibration", "activate", &id, "--operator", "test"];
        assert_eq!(self.cell.done(&arguments).await["in_force"], true);
    }
}

fn point(message: &common::Point) -> Point3 {
    Point3::new(message.x_mm, message.y_mm, message.z_mm)
}

#[tokio::test]
async fn touched_landmarks_measure_the_true_error_and_a_moved_camera_shows() {
    let mut touching = Touching::new().await;
    let base_from_ct = touching.base_from_ct().await;
    let start = point(&touching.start.translation.expect("a place"));
    let mut last = Value::Null;
    let mut places = Vec::new();
    for (landmark, off) in FIDUCIALS {
        let place = base_from_ct.inverse() * (start + Vector3::from(off));
        let miss = touching.miss(base_from_ct, &place);
        touching.go(&(base_from_ct * place - miss)).await;
        last = touching.touch(landmark, &place).await;
        let measured_mm = number(&last, "/distance_mm");
        assert!(
            (measured_mm - miss.norm()).abs() < 0.1,
            "{measured_mm} mm, truly {} mm",
            miss.norm()
        );
        places.push(place);
    }
    assert_eq!(last["verification"]["verdict"], "PASSED", "{last}");
    let digest = touching.digest.clone();
    assert_eq!(touching.approve(&digest).await.0, 0);

    touching.put_camera_beside().await;
    let shown = touching.cell.done(&["case", "show", &touching.case]).await;
    assert_eq!(shown["verification"]["verdict"], "ABSENT", "{shown}");
    assert_eq!(shown["case"]["approved_by"], "");
    let touched = touching.touch("fourth", &places[3]).await;
    assert!(
        number(&touched, "/distance_mm") > 0.5 * CAMERA_OFF_MM,
        "{touched}"
    );
    let digest = shown["case"]["plan_digest"].as_str().expect("a digest");
    let refused = touching.approve(digest).await;
    assert_eq!(refused, (3, "VERIFICATION_FAILED".to_owned()));
    touching.cell.teardown().await;
}
