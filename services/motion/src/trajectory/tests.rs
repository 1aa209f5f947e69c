use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use proptest::prelude::*;

use super::*;
use crate::rcm::{Regain, shaft};

const PERIOD_S: f64 = 0.008;
const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

fn arm() -> ToolArm {
    ToolArm::new(
        crate::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    )
}

const FULL: Speeds = Speeds {
    tip_mm_s: 20.0,
    turn_rad_s: 0.25,
};

/// Joints with the tip at `depth_mm` on the axis of the start pose, and the portal.
fn at_depth(depth_mm: f64) -> (Joints, Point3) {
    let pose = arm().base_from_tool(&START);
    let portal = pose.origin() + shaft(&pose) * 80.0;
    let at = Rigid::new(pose.rotation(), (portal + shaft(&pose) * depth_mm).coords);
    (arm().joints(&at, &START).unwrap(), portal)
}

fn pivot(depth_mm: f64, tilt: Vector3) -> Result<Trajectory, Error> {
    let (joints, portal) = at_depth(depth_mm);
    let pose = arm().base_from_tool(&joints);
    let aim = portal + Rotation::from_scaled_axis(tilt) * shaft(&pose) * 50.0;
    let path = RcmPath::pivot(&pose, portal, aim).unwrap();
    Trajectory::plan(arm(), path, &joints, &Limits::default(), FULL, PERIOD_S)
}

#[test]
fn a_pivot_of_thirty_degrees_keeps_the_shaft_on_the_portal() {
    for depth_mm in [-5.0, 40.0] {
        for axis in [Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()] {
            let trajectory = pivot(depth_mm, axis * 30_f64.to_radians()).unwrap();
            let margins = trajectory.margins();
            assert!(margins.rcm_at_samples_mm <= 1e-9, "{margins:?}");
            assert!(margins.rcm_between_samples_mm <= 0.002, "{margins:?}");
            assert!(margins.joint_speed_rad_s <= 1.0, "{margins:?}");
            assert!(trajectory.duration_s() > 30_f64.to_radians() / 0.25);
        }
    }
}

#[test]
fn an_insertion_ends_at_its_depth_and_keeps_its_speed() {
    let (joints, portal) = at_depth(-5.0);
    let path = RcmPath::along(&arm().base_from_tool(&joints), portal, 60.0, Regain::Portal);
    let trajectory =
        Trajectory::plan(arm(), path, &joints, &Limits::default(), FULL, PERIOD_S).unwrap();
    let mut before = joints;
    let mut tip = arm().base_from_tool(&before).origin();
    for sample in 1..=(trajectory.duration_s() / PERIOD_S).ceil() as usize {
        before = trajectory
            .sample(sample as f64 * PERIOD_S, &before)
            .unwrap();
        let next = arm().base_from_tool(&before).origin();
        assert!((next - tip).norm() / PERIOD_S <= 20.0 * (1.0 + 1e-6));
        tip = next;
    }
    let placement = Placement::of(&arm().base_from_tool(&before), &portal);
    assert!((placement.depth_mm - 60.0).abs() < 1e-9);
    assert!(trajectory.margins().rcm_between_samples_mm < 0.001);
}

#[test]
fn a_path_of_no_length_is_done_at_once() {
    let (joints, portal) = at_depth(10.0);
    let pose = arm().base_from_tool(&joints);
    let path = RcmPath::along(
        &pose,
        portal,
        Placement::of(&pose, &portal).depth_mm,
        Regain::Nothing,
    );
    let trajectory =
        Trajectory::plan(arm(), path, &joints, &Limits::default(), FULL, PERIOD_S).unwrap();
    assert_eq!(trajectory.duration_s(), 0.0);
    assert_eq!(trajectory.fraction(0.0), 1.0);
}

#[test]
fn a_path_beyond_the_reach_is_refused() {
    let (joints, portal) = at_depth(-5.0);
    let pose = arm().base_from_tool(&joints);
    let path = RcmPath::along(&pose, portal, 900.0, Regain::Portal);
    let refusal = Trajectory::plan(arm(), path, &joints, &Limits::default(), FULL, PERIOD_S);
    assert_eq!(refusal.unwrap_err().reason(), "OUT_OF_REACH");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn every_pivot_in_the_cone_is_smooth_and_on_the_portal(
        depth_mm in -5.0..60.0f64, tilt in prop::array::uniform3(-0.5..0.5f64),
    ) {
        let margins = pivot(depth_mm, Vector3::from(tilt).cap_magnitude(0.5)).unwrap().margins();
        prop_assert!(margins.rcm_at_samples_mm <= RCM_AT_SAMPLES_MM);
        prop_assert!(margins.rcm_between_samples_mm <= RCM_BETWEEN_SAMPLES_MM);
        prop_assert!(margins.joint_speed_rad_s <= 1.02);
    }
}
