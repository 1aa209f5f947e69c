use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Point3, Rotation, Vector3};
use proptest::prelude::*;

use super::*;
use crate::kinematics::dh::Dh;
use crate::kinematics::joint_limits::JointLimits;
use crate::kinematics::model::Model;
use crate::rcm::{Placement, RcmPath, shaft};

const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

/// The shaft along the flange's axis: then its roll is that of joint 6 alone.
fn arm(limits: JointLimits) -> ToolArm {
    leaning(limits, 0.0)
}

/// The shaft leaning from the flange's axis.
fn leaning(limits: JointLimits, lean_rad: f64) -> ToolArm {
    let rotation = Rotation::from_axis_angle(&Vector3::y_axis(), lean_rad - FRAC_PI_2);
    let tool = Rigid::new(rotation, rotation * Vector3::x() * 310.0);
    ToolArm::new(Model::ur5().with_limits(limits), tool)
}

/// A pivot by 20 degrees to one side, 30 mm in.
fn pivot(arm: &ToolArm, side: f64) -> (RcmPath, Point3) {
    let pose = arm.base_from_tool(&START);
    let portal = pose.origin() - shaft(&pose) * 30.0;
    let sideways = pose.direction(&Vector3::y()) * (side * 20_f64.to_radians().tan());
    let aim = portal + (shaft(&pose) + sideways) * 30.0;
    (RcmPath::pivot(&pose, portal, aim).unwrap(), portal)
}

/// The joints at the end of a path with the roll fixed; a jump to another branch is where a limit ends it.
fn fixed(arm: &ToolArm, path: &RcmPath) -> Result<Joints, Unreachable> {
    (1..=100).try_fold(START, |before, step| {
        let joints = arm.joints(&path.pose(f64::from(step) / 100.0), &before)?;
        if largest_difference(&joints, &before).1 > JUMP_RAD {
            return Err(Unreachable::JointLimit);
        }
        Ok(joints)
    })
}

#[test]
fn where_a_fixed_roll_meets_a_joint_limit_a_free_one_passes() {
    // Of a shaft along the flange's axis the roll is that of joint 6; of one that leans all joints take part.
    for (lean_rad, joint, side) in [
        (0.0, 5, -1.0),
        (0.4, 4, -1.0),
        (0.8, 0, -1.0),
        (0.8, 4, 1.0),
    ] {
        passes_with_half_the_travel(lean_rad, joint, side);
    }
}

/// A pivot in which a joint lacks half of what it needs with the roll fixed.
fn passes_with_half_the_travel(lean_rad: f64, joint: usize, side: f64) {
    let free = leaning(JointLimits::default(), lean_rad);
    let (path, portal) = pivot(&free, side);
    let end = fixed(&free, &path).unwrap();
    let mut limits = JointLimits::default();
    let middle = 0.5 * (end[joint] + START[joint]);
    if end[joint] > START[joint] {
        limits.max_rad[joint] = middle;
    } else {
        limits.min_rad[joint] = middle;
    }
    let stiff = leaning(limits, lean_rad);
    assert_eq!(fixed(&stiff, &path), Err(Unreachable::JointLimit));
    let search = Search {
        comfort: Comfort {
            joint_limit_rad: 0.05,
            ..Comfort::default()
        },
        ..Search::default()
    };
    let profile = search.profile(&stiff, |s| path.pose(s), &START).unwrap();
    assert!(profile.margin() > 0.0, "{profile:?}");
    assert_eq!(profile.roll_rad(0.0), 0.0);
    let mut before = START;
    for step in 0..=1000 {
        let s = f64::from(step) / 1000.0;
        let pose = rolled(&path.pose(s), profile.roll_rad(s));
        let joints = stiff.joints(&pose, &before).unwrap();
        assert!(largest_difference(&joints, &before).1 < 0.02);
        let there = stiff.base_from_tool(&joints);
        assert!(Placement::of(&there, &portal).deviation_mm() < 1e-6);
        assert!((there.origin() - path.pose(s).origin()).norm() < 1e-6);
        before = joints;
    }
}

#[test]
fn a_calibrated_arm_is_walked_as_it_is() {
    let drawn = leaning(JointLimits::default(), 0.4);
    let off = Dh {
        theta_rad: [0.001, -0.001, 0.001, -0.001, 0.001, -0.001],
        a_mm: [0.5, -0.5, 0.5, -0.5, 0.5, -0.5],
        d_mm: [0.5, -0.5, 0.5, -0.5, 0.5, -0.5],
        alpha_rad: [-0.001, 0.001, -0.001, 0.001, -0.001, 0.001],
    };
    let table = drawn.model().dh().plus(&off);
    let model = Model::ur5().calibrated(&table).unwrap();
    let arm = ToolArm::new(model, drawn.flange_from_tool());
    let (path, portal) = pivot(&arm, 1.0);
    let profile = Search::default()
        .profile(&arm, |s| path.pose(s), &START)
        .unwrap();
    let end = arm.base_from_tool(&profile.end());
    let wanted = rolled(&path.pose(1.0), profile.roll_rad(1.0));
    assert!((end.origin() - wanted.origin()).norm() < 1e-6);
    assert!(Placement::of(&end, &portal).deviation_mm() < 1e-6);
    assert!(profile.margin() > 0.0, "{profile:?}");
}

#[test]
fn what_no_roll_takes_is_refused_by_name_and_place() {
    let free = arm(JointLimits::default());
    let (path, _) = pivot(&free, 1.0);
    let mut limits = JointLimits::default();
    // The shoulder may not move at all.
    for (joint, angle) in START.iter().enumerate().take(2) {
        limits.min_rad[joint] = angle - 1e-3;
        limits.max_rad[joint] = angle + 1e-3;
    }
    let no = Search::default()
        .profile(&arm(limits), |s| path.pose(s), &START)
        .unwrap_err();
    assert_eq!(no.reason(), "NO_ROLL");
    assert!(no.to_string().contains("beyond a joint limit"), "{no}");
    let elsewhere = START.map(|angle| angle + 1.0);
    let no = Search::default()
        .profile(&free, |s| path.pose(s), &elsewhere)
        .unwrap_err();
    assert_eq!(no, NoRoll::Start);
}

#[test]
fn a_path_with_room_is_not_rolled() {
    let free = arm(JointLimits::default());
    let (path, _) = pivot(&free, 0.3);
    let search = Search {
        comfort: Comfort {
            joint_limit_rad: 1e-3,
            wrist_rad: 1e-3,
            elbow_rad: 1e-3,
            shoulder_mm: 1e-3,
        },
        ..Search::default()
    };
    let profile = search.profile(&free, |s| path.pose(s), &START).unwrap();
    assert_eq!(profile.margin(), 1.0);
    for step in 0..=20 {
        assert_eq!(profile.roll_rad(f64::from(step) / 20.0), 0.0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_chosen_roll_never_has_less_margin_than_a_fixed_one_by_more_than_its_smoothing(
        off in prop::array::uniform6(-0.2..0.2f64), side in -1.0..1.0f64,
    ) {
        let free = arm(JointLimits::default());
        let start: Joints = std::array::from_fn(|i| START[i] + off[i]);
        let pose = free.base_from_tool(&start);
        let portal = pose.origin() - shaft(&pose) * 30.0;
        let aim = portal + (shaft(&pose) + pose.direction(&Vector3::y()) * (0.36 * side)) * 30.0;
        let path = RcmPath::pivot(&pose, portal, aim).unwrap();
        let comfort = Comfort::default();
        let mut before = start;
        let mut fixed = comfort.margin(&free, &start);
        for step in 1..=100 {
            before = free.joints(&path.pose(f64::from(step) / 100.0), &before).unwrap();
            fixed = fixed.min(comfort.margin(&free, &before));
        }
        let profile = Search::default().profile(&free, |s| path.pose(s), &start).unwrap();
        prop_assert!(profile.margin() >= fixed - 0.1, "{} {fixed}", profile.margin());
    }
}
