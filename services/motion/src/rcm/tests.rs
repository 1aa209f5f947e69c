use std::f64::consts::PI;

use proptest::prelude::*;

use super::*;

fn direction() -> impl Strategy<Value = Vector3> {
    (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64).prop_filter_map("no direction", |(x, y, z)| {
        Vector3::new(x, y, z).try_normalize(0.05)
    })
}

fn pose() -> impl Strategy<Value = Rigid<Base, Tool>> {
    (
        direction(),
        -3.0..3.0f64,
        prop::array::uniform3(-800.0..800.0f64),
    )
        .prop_map(|(axis, angle, tip)| {
            Rigid::new(Rotation::from_scaled_axis(axis * angle), Vector3::from(tip))
        })
}

/// A pose whose shaft passes the portal at some depth, and the portal.
fn through_portal() -> impl Strategy<Value = (Rigid<Base, Tool>, Point3)> {
    (pose(), -100.0..100.0f64)
        .prop_map(|(pose, depth_mm)| (pose, pose.origin() - shaft(&pose) * depth_mm))
}

#[test]
fn parallel_directions_need_no_turn() {
    let turn = Turn::between(&Vector3::x(), &Vector3::x());
    assert_eq!(turn.angle_rad, 0.0);
    assert!((turn.part(1.0) * Vector3::y() - Vector3::y()).norm() < 1e-15);
}

#[test]
fn antiparallel_directions_are_turned_about_a_perpendicular_axis() {
    for from in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, -0.8)] {
        let turn = Turn::between(&from, &-from);
        assert!((turn.angle_rad - PI).abs() < 1e-12);
        assert!(turn.axis.dot(&from).abs() < 1e-12);
        assert!((turn.part(1.0) * from + from).norm() < 1e-12);
    }
}

#[test]
fn a_path_that_regains_the_portal_begins_where_the_tool_is() {
    let base_from_tool = Rigid::new(
        Rotation::from_euler_angles(0.1, 0.2, 0.3),
        Vector3::new(700.0, 0.4, 265.0),
    );
    let portal = Point3::new(705.0, 1.0, 265.0);
    let path = RcmPath::along(&base_from_tool, portal, 40.0, Regain::Portal);
    assert!((path.pose(0.0).origin() - base_from_tool.origin()).norm() < 1e-9);
    assert!(Placement::of(&path.pose(0.3), &portal).deviation_mm() < 1e-12);
}

proptest! {
    #[test]
    fn a_turn_takes_one_direction_onto_the_other_without_twist(from in direction(), to in direction()) {
        let turn = Turn::between(&from, &to);
        prop_assert!((turn.part(1.0) * from - to).norm() < 1e-12);
        prop_assert!(turn.axis.dot(&from).abs() < 1e-12);
        prop_assert!((turn.angle_rad - from.dot(&to).clamp(-1.0, 1.0).acos()).abs() < 1e-6);
    }

    #[test]
    fn the_shaft_passes_the_portal_all_along_a_pivot(
        (pose, portal) in through_portal(), aim in prop::array::uniform3(-80.0..80.0f64), s in 0.0..=1.0f64,
    ) {
        let aim = portal + Vector3::from(aim);
        prop_assume!((aim - portal).norm() > 1.0);
        let path = RcmPath::pivot(&pose, portal, aim).unwrap();
        let before = Placement::of(&pose, &portal);
        let at = Placement::of(&path.pose(s), &portal);
        prop_assert!(at.deviation_mm() < 1e-9, "{}", at.deviation_mm());
        prop_assert!((at.depth_mm - before.depth_mm).abs() < 1e-9);
        let missed = (aim - portal).normalize() - shaft(&path.pose(1.0));
        prop_assert!(missed.norm() < 1e-12);
    }

    #[test]
    fn the_shaft_passes_the_portal_all_along_an_insertion(
        (pose, portal) in through_portal(), depth_mm in -80.0..80.0f64, s in 0.0..=1.0f64,
    ) {
        let path = RcmPath::along(&pose, portal, depth_mm, Regain::Portal);
        prop_assert!(Placement::of(&path.pose(s), &portal).deviation_mm() < 1e-9);
        prop_assert!((Placement::of(&path.pose(1.0), &portal).depth_mm - depth_mm).abs() < 1e-9);
        prop_assert!(path.pose(s).rotation().angle_to(&pose.rotation()) < 1e-7);
    }

    #[test]
    fn a_path_keeps_its_word_about_its_own_deviation(
        pose in pose(), offset in prop::array::uniform3(-1.0..1.0f64), s in 0.0..=1.0f64,
    ) {
        let portal = pose.origin() + Vector3::from(offset);
        let path = RcmPath::along(&pose, portal, 30.0, Regain::Portal);
        let deviation_mm = Placement::of(&path.pose(s), &portal).deviation_mm();
        prop_assert!((deviation_mm - path.planned_deviation_mm(s)).abs() < 1e-9);
    }
}
