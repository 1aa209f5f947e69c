//! Moves that choose the roll about the shaft.

use super::*;
use crate::kinematics::joint_limits::JointLimits;

/// A tool whose shaft leans from the flange's axis, and the pivot of its tip about a portal 30 mm behind it.
fn leaning_pivot(limits: JointLimits, lean_rad: f64) -> (ToolArm, RcmPath) {
    let rotation = Rotation::from_axis_angle(&Vector3::y_axis(), lean_rad - FRAC_PI_2);
    let tool = Rigid::new(rotation, rotation * Vector3::x() * 310.0);
    let arm = ToolArm::new(Model::ur5().with_limits(limits), tool);
    let pose = arm.base_from_tool(&START);
    let portal = pose.origin() - shaft(&pose) * 30.0;
    let sideways = pose.direction(&Vector3::y()) * 20_f64.to_radians().tan();
    let aim = portal + (shaft(&pose) - sideways) * 30.0;
    (arm, RcmPath::pivot(&pose, portal, aim).unwrap())
}

/// Travel of which the pivot with its roll kept needs twice as much of one joint.
fn half_the_travel(lean_rad: f64, joint: usize) -> JointLimits {
    let (arm, path) = leaning_pivot(JointLimits::default(), lean_rad);
    let kept = Trajectory::plan(arm, path, &START, &Limits::default(), FULL, PERIOD_S).unwrap();
    let end = kept.end()[joint];
    let middle = 0.5 * (end + START[joint]);
    let mut limits = JointLimits::default();
    if end > START[joint] {
        limits.max_rad[joint] = middle;
    } else {
        limits.min_rad[joint] = middle;
    }
    limits
}

#[test]
fn a_free_roll_passes_where_a_kept_one_meets_a_joint_limit() {
    for (lean_rad, joint) in [(0.0, 5), (0.4, 4), (0.8, 0)] {
        let limits = half_the_travel(lean_rad, joint);
        let (arm, path) = leaning_pivot(limits, lean_rad);
        let portal = path.portal();
        let kept = Trajectory::plan(
            arm,
            path.clone(),
            &START,
            &Limits::default(),
            FULL,
            PERIOD_S,
        );
        assert_eq!(kept.unwrap_err().reason(), "JOINT_LIMIT");
        let unrolled = path.clone();
        let free = Trajectory::plan_rolling(arm, path, &START, &Limits::default(), FULL, PERIOD_S)
            .unwrap();
        assert!(free.margins().joint_limit_rad > 0.0, "{:?}", free.margins());
        let mut before = START;
        let mut middle_mm = 0.0_f64;
        for tick in 1..=(free.duration_s() / PERIOD_S).ceil() as usize {
            let time_s = tick as f64 * PERIOD_S;
            let joints = free.sample(time_s, &before).unwrap();
            let (_, step_rad) = largest_difference(&joints, &before);
            let limit_rad_s = Limits::default().joint_speed_rad_s * SPEED_TOLERANCE;
            assert!(step_rad / PERIOD_S <= limit_rad_s);
            let there = arm.base_from_tool(&joints);
            assert!(Placement::of(&there, &portal).deviation_mm() <= RCM_AT_SAMPLES_MM);
            let wanted = unrolled.pose(free.fraction(time_s));
            assert!((there.origin() - wanted.origin()).norm() < 1e-6);
            let middle: Joints = std::array::from_fn(|i| 0.5 * (joints[i] + before[i]));
            let middle = Placement::of(&arm.base_from_tool(&middle), &portal);
            middle_mm = middle_mm.max(middle.deviation_mm());
            before = joints;
        }
        assert!(middle_mm <= RCM_BETWEEN_SAMPLES_MM, "{middle_mm}");
        assert_eq!(before, free.end());
    }
}

#[test]
fn what_no_roll_takes_is_refused_with_where_it_ends() {
    let mut limits = JointLimits::default();
    for (joint, angle) in START.iter().enumerate().take(2) {
        limits.min_rad[joint] = angle - 1e-3;
        limits.max_rad[joint] = angle + 1e-3;
    }
    let (arm, path) = leaning_pivot(limits, 0.4);
    let refusal = Trajectory::plan_rolling(arm, path, &START, &Limits::default(), FULL, PERIOD_S);
    let refusal = refusal.unwrap_err();
    assert_eq!(refusal.reason(), "NO_ROLL");
    assert!(refusal.to_string().contains("% of the path"), "{refusal}");
}

#[test]
fn a_free_roll_does_not_widen_the_turn() {
    let (arm, path) = leaning_pivot(JointLimits::default(), 0.4);
    let pose = path.pose(0.0);
    let back = RcmPath::pivot(&pose, path.portal(), path.portal() - shaft(&pose) * 30.0).unwrap();
    let refusal = Trajectory::plan_rolling(arm, back, &START, &Limits::default(), FULL, PERIOD_S);
    assert_eq!(refusal.unwrap_err().reason(), "TURN_TOO_WIDE");
}
