//! Combined moves, dry runs and teaching over the API.

use super::*;

#[tokio::test]
async fn a_combined_move_turns_rolls_and_inserts_at_once() {
    let mut cell = Cell::new().await;
    let wanted = Wanted::Rcm(proto::RcmMove {
        target: Some(proto::rcm_move::Target::Aim(target(745.0, 15.0, 255.0))),
        depth_mm: 30.0,
        roll_rad: Some(0.4),
        ..proto::RcmMove::default()
    });
    let messages: Vec<_> = cell.begin(wanted).await.unwrap().collect().await;
    let last = messages.last().unwrap().as_ref().unwrap();
    let operation = last.operation.as_ref().unwrap();
    assert_eq!(operation.state(), common::OperationState::Done);
    let state = last.state.as_ref().unwrap();
    assert!(state.inside);
    assert!((state.depth_mm - 30.0).abs() < 1e-3, "{}", state.depth_mm);
    assert!(
        last.rcm_deviation_max_mm < 0.01,
        "{}",
        last.rcm_deviation_max_mm
    );
}

#[tokio::test]
async fn a_combined_move_beyond_depth_cone_or_sense_is_refused() {
    let mut cell = Cell::new().await;
    let rcm = |depth_mm, to: common::Point| {
        Wanted::Rcm(proto::RcmMove {
            target: Some(proto::rcm_move::Target::Aim(to)),
            depth_mm,
            ..proto::RcmMove::default()
        })
    };
    let ahead = target(745.0, 0.0, 265.0);
    let refusal = cell.begin(rcm(99.0, ahead)).await.err().unwrap();
    assert_eq!(status::reason(&refusal).as_deref(), Some("TOO_DEEP"));
    let (field, _) = &cell.violations(rcm(f64::NAN, ahead)).await[0];
    assert_eq!(field, "rcm.depth_mm");
    let (field, _) = &cell.violations(rcm(-101.0, ahead)).await[0];
    assert_eq!(field, "rcm.depth_mm");
    let direction = Wanted::Rcm(proto::RcmMove {
        target: Some(proto::rcm_move::Target::Direction(common::Direction {
            x: 0.5,
            y: 0.0,
            z: 0.0,
        })),
        ..proto::RcmMove::default()
    });
    let (field, fault) = &cell.violations(direction).await[0];
    assert_eq!(field, "rcm.direction");
    assert!(fault.contains("has length 0.5"), "{fault}");

    let request = proto::SetPortalRequest {
        authorization: cell.by(),
        arm: common::Arm::Forceps.into(),
        portal: Some(PORTAL),
        axis: Some(common::Direction {
            x: 1.0,
            y: 0.0,
            z: 0.0,
        }),
    };
    cell.motion.set_portal(Request::new(request)).await.unwrap();
    let request = Request::new(proto::GetCellRequest {});
    let told = cell.motion.get_cell(request).await.unwrap().into_inner();
    assert_eq!(told.arms[0].portal_axis.unwrap().x, 1.0);
    let refusal = cell
        .begin(rcm(20.0, target(705.0, 45.0, 265.0)))
        .await
        .err()
        .unwrap();
    assert_eq!(status::reason(&refusal).as_deref(), Some("CONE"));
}

#[tokio::test]
async fn a_portal_inside_the_base_is_refused() {
    let mut cell = Cell::new().await;
    let request = proto::SetPortalRequest {
        authorization: cell.by(),
        arm: common::Arm::Forceps.into(),
        portal: Some(target(50.0, 50.0, 400.0)),
        axis: None,
    };
    let refusal = cell
        .motion
        .set_portal(Request::new(request))
        .await
        .unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("PORTAL_IN_BASE"));
}

#[tokio::test]
async fn a_dry_run_tells_margins_and_the_worst_target() {
    let cell = Cell::new().await;
    let request = proto::CheckMotionRequest {
        arm: common::Arm::Forceps.into(),
        targets: vec![
            target(740.0, 0.0, 260.0),
            target(778.0, 0.0, 255.0),
            target(745.0, 20.0, 255.0),
        ],
        order: proto::CheckOrder::AsListed.into(),
        ..proto::CheckMotionRequest::default()
    };
    let checked = cell
        .motion
        .check_motion(Request::new(request))
        .await
        .unwrap();
    let checked = checked.into_inner();
    assert_eq!(checked.worst_target, 1);
    let margins = checked.checks[1].margins.as_ref().unwrap();
    assert_eq!(margins.worst, "DEPTH");
    assert!(margins.room < 0.2 && margins.wrist_rad > 0.1);

    let request = proto::CheckMotionRequest {
        arm: common::Arm::Forceps.into(),
        targets: vec![target(740.0, 20.0, 275.0)],
        method: proto::ReachMethod::PaperAsPrinted.into(),
        ..proto::CheckMotionRequest::default()
    };
    let checked = cell
        .motion
        .check_motion(Request::new(request))
        .await
        .unwrap();
    let check = &checked.into_inner().checks[0];
    assert_eq!(check.reason, "RCM_DEVIATION");
    assert!(check.rcm_deviation_mm > 4.0);
}

#[tokio::test]
async fn a_portal_is_taught_from_where_the_arm_is_and_other_poses() {
    use arthro_proto::motion::v1::teaching_service_server::TeachingService as _;
    let cell = Cell::new().await;
    let now = || proto::TaughtPose {
        pose: Some(proto::taught_pose::Pose::Now(proto::TaughtNow {})),
    };
    let neutral = cell.motion.arms[0].neutral_joints_rad;
    let arm = cell.motion.arms[0].handle.options().arm;
    let at = arm.base_from_tool(&neutral);
    let point = at.origin() + crate::rcm::shaft(&at) * 40.0;
    let aim = point + arthro_geometry::Vector3::new(30.0, 25.0, 5.0);
    let turned = crate::rcm::RcmPath::pivot(&at, point, aim)
        .unwrap()
        .pose(1.0);
    let joints_rad = arm.joints(&turned, &neutral).unwrap().to_vec();
    let other = proto::TaughtPose {
        pose: Some(proto::taught_pose::Pose::Joints(proto::TaughtJoints {
            joints_rad,
        })),
    };
    let request = |poses| {
        Request::new(proto::SolvePortalRequest {
            arm: common::Arm::Forceps.into(),
            poses,
            ..proto::SolvePortalRequest::default()
        })
    };
    let found = cell
        .motion
        .solve_portal(request(vec![now(), other]))
        .await
        .unwrap();
    let found = found.into_inner();
    let portal = found.portal.unwrap();
    assert!((portal.x_mm - point.x).abs() < 1e-6 && (portal.z_mm - point.z).abs() < 1e-6);
    assert!(found.portal_covariance_mm2.is_empty());
    assert_eq!(found.lines.len(), 2);
    let refusal = cell
        .motion
        .solve_portal(request(vec![now(), now()]))
        .await
        .unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("LINES_PARALLEL"));
    let refusal = cell
        .motion
        .solve_portal(request(vec![now()]))
        .await
        .unwrap_err();
    assert_eq!(refusal.code(), Code::InvalidArgument);
}

#[tokio::test]
async fn a_free_roll_is_asked_for_and_goes_without_a_roll_of_the_callers() {
    let mut cell = Cell::new().await;
    let rcm = |roll_rad, roll_choice: i32| {
        Wanted::Rcm(proto::RcmMove {
            target: Some(proto::rcm_move::Target::Aim(target(745.0, 15.0, 255.0))),
            depth_mm: 10.0,
            roll_rad,
            roll_choice,
            ..proto::RcmMove::default()
        })
    };
    let free = proto::RollChoice::Free.into();
    let violations = cell.violations(rcm(Some(0.4), free)).await;
    let (field, fault) = &violations[0];
    assert_eq!(field, "rcm.roll_rad");
    assert!(fault.contains("ROLL_CHOICE_FREE"), "{fault}");
    let (field, _) = &cell.violations(rcm(None, 3)).await[0];
    assert_eq!(field, "rcm.roll_choice");
    let messages: Vec<_> = cell.begin(rcm(None, free)).await.unwrap().collect().await;
    let last = messages.last().unwrap().as_ref().unwrap();
    let operation = last.operation.as_ref().unwrap();
    assert_eq!(operation.state(), common::OperationState::Done);
    let state = last.state.as_ref().unwrap();
    assert!((state.depth_mm - 10.0).abs() < 1e-3, "{}", state.depth_mm);
    assert!(last.rcm_deviation_max_mm < 0.01);

    let mut request = proto::CheckMotionRequest {
        arm: common::Arm::Forceps.into(),
        targets: vec![target(740.0, 0.0, 260.0)],
        roll_choice: free,
        ..proto::CheckMotionRequest::default()
    };
    let checked = cell
        .motion
        .check_motion(Request::new(request.clone()))
        .await;
    assert!(checked.unwrap().into_inner().checks[0].reachable);
    request.method = proto::ReachMethod::Paper.into();
    let refusal = cell.motion.check_motion(Request::new(request)).await;
    let violations = status::violations(&refusal.unwrap_err());
    assert_eq!(violations[0].0, "roll_choice");
}

#[test]
fn without_a_choice_the_roll_is_kept_or_goes_where_the_move_says() {
    use crate::plan::{Move, Roll};
    let read = |roll_rad, choice: proto::RollChoice| {
        let wanted = Wanted::Rcm(proto::RcmMove {
            roll_rad,
            roll_choice: choice.into(),
            ..proto::RcmMove::default()
        });
        let limits = crate::limits::Limits::default();
        match fields::Fields::default().motion(Some(&wanted), &limits) {
            Some(Move::Rcm { roll, .. }) => roll,
            other => panic!("{other:?}"),
        }
    };
    for choice in [proto::RollChoice::Unspecified, proto::RollChoice::Keep] {
        assert_eq!(read(None, choice), Roll::Kept);
        assert_eq!(read(Some(0.4), choice), Roll::To(0.4));
    }
    assert_eq!(read(None, proto::RollChoice::Free), Roll::Free);
}
