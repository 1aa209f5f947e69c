//! The calibrations over a real connection.

use arthro_bootstrap::status;
use arthro_geometry::frame::{Base, Camera, Flange, Frame};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::registration::v1 as api;
use tonic::Code;

use super::tool_tip::Pivot;
use super::world::{Dice, EyeOnBase, board_in_view, noise};
use crate::service::client;

fn message<A: Frame, B: Frame>(pose: &Rigid<A, B>) -> Option<common::Pose> {
    let [x, y, z, w] = pose.rotation().coords.into();
    let [x_mm, y_mm, z_mm] = pose.translation_mm().into();
    Some(common::Pose {
        rotation: Some(common::Quaternion { w, x, y, z }),
        translation: Some(common::Point { x_mm, y_mm, z_mm }),
    })
}

fn pose<A: Frame, B: Frame>(message: &Option<common::Pose>) -> Rigid<A, B> {
    let pose = message.unwrap();
    let (rotation, translation) = (pose.rotation.unwrap(), pose.translation.unwrap());
    Rigid::new(
        Rotation::from_quaternion(Quaternion::new(
            rotation.w, rotation.x, rotation.y, rotation.z,
        )),
        Vector3::new(translation.x_mm, translation.y_mm, translation.z_mm),
    )
}

/// A calibration and the base_from_camera that is true.
fn hand_eye(count: usize) -> (api::SolveHandEyeRequest, Rigid<Base, Camera>) {
    let dice = &mut Dice::new(41);
    let cell = EyeOnBase::drawn(dice);
    let arm = noise(0.1, 0.01);
    let poses = (0..count).map(|_| {
        let seen = board_in_view(dice, 40.0);
        let station = cell.seen(dice, &seen, arm, 0.1);
        api::HandEyePose {
            base_from_flange: message(&station.base_from_flange),
            camera_from_board: message(&station.camera_from_board),
            camera_covariance: station.camera_covariance.unwrap().iter().copied().collect(),
        }
    });
    let request = api::SolveHandEyeRequest {
        mounting: api::CameraMounting::BesideArm.into(),
        poses: poses.collect(),
        arm_noise: Some(api::PoseNoise {
            rotation_rad: arm.rotation_rad,
            translation_mm: arm.translation_mm,
        }),
        ..Default::default()
    };
    (request, cell.base_from_camera)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_hand_eye_calibration_is_solved_with_its_evidence() {
    let (request, truth) = hand_eye(15);
    let answer = client()
        .await
        .solve_hand_eye(request)
        .await
        .unwrap()
        .into_inner();
    let found: Rigid<Base, Camera> = pose(&answer.mount_from_camera);
    let off = (found.translation_mm() - truth.translation_mm()).norm();
    assert!(off < 0.6, "{off}");
    assert_eq!(answer.mount_from_camera_covariance.len(), 36);
    assert_eq!(answer.residuals.len(), 15);
    assert!(answer.work_point_deviation_mm > 0.0 && answer.held_out_rms_mm > 0.0);
    for closed in [&answer.park, &answer.daniilidis, &answer.shah] {
        assert!(
            pose::<Base, Camera>(closed)
                .rotation()
                .angle_to(&truth.rotation())
                < 0.02
        );
    }
}

#[tokio::test]
async fn a_gate_that_is_not_passed_is_a_refusal_with_value_and_limit() {
    let (request, _) = hand_eye(7);
    let refusal = client().await.solve_hand_eye(request).await.unwrap_err();
    assert_eq!(refusal.code(), Code::FailedPrecondition);
    assert_eq!(status::reason(&refusal).as_deref(), Some("TOO_FEW_POSES"));
    assert_eq!(
        refusal.message(),
        "TOO_FEW_POSES: 7 poses are given, must be at least 10"
    );
}

#[tokio::test]
async fn bad_messages_are_refused_with_every_field_named() {
    let (mut request, _) = hand_eye(12);
    request.mounting = 0;
    request.poses[1].base_from_flange = None;
    request.poses[2].camera_covariance.pop();
    let turned = request.poses[3].camera_from_board.as_mut().unwrap();
    turned.rotation.as_mut().unwrap().w += 0.5;
    let refusal = client().await.solve_hand_eye(request).await.unwrap_err();
    assert_eq!(refusal.code(), Code::InvalidArgument);
    let fields: Vec<String> = status::violations(&refusal)
        .into_iter()
        .map(|(field, _)| field)
        .collect();
    assert_eq!(
        fields,
        [
            "mounting",
            "poses[1].base_from_flange",
            "poses[2].camera_covariance",
            "poses[3].camera_from_board.rotation",
        ]
    );
    let request = api::SolveToolTipRequest {
        spin_poses: vec![common::Pose::default()],
        higher_poses: vec![common::Pose::default()],
        ..Default::default()
    };
    let refusal = client().await.solve_tool_tip(request).await.unwrap_err();
    let fields: Vec<String> = status::violations(&refusal)
        .into_iter()
        .map(|(field, _)| field)
        .collect();
    assert_eq!(fields, ["spin_poses[0]", "higher_poses[0]", "higher_poses"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn tip_and_shaft_come_back_as_the_tool_of_a_configuration() {
    let dice = &mut Dice::new(42);
    let pivot = Pivot::drawn(dice);
    let poses: Vec<Rigid<Base, Flange>> = (0..14).map(|_| pivot.pose(dice, 35.0)).collect();
    let along = pivot.tip.coords.normalize();
    let higher = Pivot::through(pivot.tip - along * 150.0);
    let higher: Vec<Rigid<Base, Flange>> = (0..14).map(|_| higher.pose(dice, 35.0)).collect();
    let request = api::SolveToolTipRequest {
        poses: poses.iter().filter_map(message).collect(),
        higher_poses: higher.iter().filter_map(message).collect(),
        ..Default::default()
    };
    let answer = client()
        .await
        .solve_tool_tip(request.clone())
        .await
        .unwrap()
        .into_inner();
    let tip = answer.tip.unwrap();
    assert!((Vector3::new(tip.x_mm, tip.y_mm, tip.z_mm) - pivot.tip.coords).norm() < 1e-6);
    let shaft = answer.shaft.unwrap();
    let tool: Rigid<Flange, Base> = pose(&shaft.flange_from_tool);
    assert!((tool.direction(&Vector3::x()) - along).norm() < 1e-6);
    assert!(shaft.tip_off_line_mm < 1e-6);

    // The refusal says which poses it is about.
    let few = api::SolveToolTipRequest {
        higher_poses: request.higher_poses[..5].to_vec(),
        ..request
    };
    let refusal = client().await.solve_tool_tip(few).await.unwrap_err();
    assert!(
        refusal
            .message()
            .contains("higher_poses: 5 poses are given"),
        "{refusal}"
    );
}
