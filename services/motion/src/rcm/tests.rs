use std::f64::consts::PI;

use proptest::prelude::*;

use arthro_geometry::nalgebra::Unit;

use super::path::Destination;
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

    #[test]
    fn coordinates_say_where_a_tool_is(
        (pose, point) in through_portal(), axis in prop::option::of(direction()),
    ) {
        let portal = Portal { point, axis: axis.map(Unit::new_normalize) };
        prop_assume!(shaft(&pose).dot(&portal.reference_axis()) > -0.999);
        let again = portal.pose(&portal.coordinates(&pose));
        prop_assert!((again.origin() - pose.origin()).norm() < 1e-9);
        prop_assert!(again.rotation().angle_to(&pose.rotation()) < 1e-7);
    }

    #[test]
    fn a_closed_loop_of_pivots_brings_the_roll_back(
        (pose, portal) in through_portal(), aims in prop::collection::vec(direction(), 2..6),
    ) {
        let axis = Portal::from(portal).reference_axis();
        let first = portal + shaft(&pose) * 50.0;
        let aims = aims.into_iter().map(|aim| portal + aim * 50.0).chain([first]);
        prop_assume!(shaft(&pose).dot(&axis) > -0.99);
        let mut at = pose;
        for aim in aims {
            prop_assume!((aim - portal).normalize().dot(&axis) > -0.99);
            at = RcmPath::pivot(&at, portal, aim).unwrap().pose(1.0);
        }
        prop_assert!((at.origin() - pose.origin()).norm() < 1e-9);
        prop_assert!(at.rotation().angle_to(&pose.rotation()) < 1e-7);
    }

    #[test]
    fn a_combined_path_stays_on_the_portal_and_ends_where_asked(
        (pose, point) in through_portal(), axis in prop::option::of(direction()), to in direction(),
        depth_mm in -80.0..80.0f64, roll_rad in -3.0..3.0f64, s in 0.0..=1.0f64,
    ) {
        let portal = Portal { point, axis: axis.map(Unit::new_normalize) };
        let reference = portal.reference_axis();
        prop_assume!(shaft(&pose).dot(&reference) > -0.999 && to.dot(&reference) > -0.999);
        let end = Destination {
            direction: Some(Unit::new_normalize(to)),
            depth_mm: Some(depth_mm),
            roll_rad: Some(roll_rad),
        };
        let path = RcmPath::to(&pose, portal, &end, Regain::Portal);
        prop_assert!((path.pose(0.0).origin() - pose.origin()).norm() < 1e-9);
        prop_assert!(path.pose(0.0).rotation().angle_to(&pose.rotation()) < 1e-7);
        let at = Placement::of(&path.pose(s), &point);
        prop_assert!(at.deviation_mm() < 1e-9, "{}", at.deviation_mm());
        prop_assert!((at.depth_mm - path.depth_mm(s)).abs() < 1e-9);
        let reached = portal.coordinates(&path.pose(1.0));
        prop_assert!((reached.direction.into_inner() - to).norm() < 1e-9);
        prop_assert!((reached.depth_mm - depth_mm).abs() < 1e-9);
        prop_assert!(portal::wrap(reached.roll_rad - roll_rad).abs() < 1e-9);
    }

    #[test]
    fn the_way_between_two_shafts_in_a_cone_stays_in_it(
        axis in direction(), a in direction(), b in direction(), s in 0.0..=1.0f64,
    ) {
        let portal = Portal { point: Point3::new(700.0, 0.0, 200.0), axis: Some(Unit::new_normalize(axis)) };
        let lean = |direction: &Vector3| portal.lean_rad(direction).unwrap();
        let widest = lean(&a).max(lean(&b));
        prop_assume!(widest < PI / 2.0);
        prop_assert!(lean(&(Turn::between(&a, &b).part(s) * a)) <= widest + 1e-9);
    }
}

/// A shaft turned with the least twist has rolled by the solid angle of the loop that it went.
#[test]
fn a_closed_loop_of_least_twist_rolls_the_shaft() {
    let corners = [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::x()];
    let mut rotation = Rotation::identity();
    for pair in corners.windows(2) {
        rotation = Turn::between(&pair[0], &pair[1]).part(1.0) * rotation;
    }
    assert!((rotation.angle() - PI / 2.0).abs() < 1e-12);
}

#[test]
fn roll_is_counted_from_the_tool_that_stands_upright_on_the_axis() {
    let portal = Portal::new(Point3::new(600.0, 300.0, 200.0), None).unwrap();
    let outward = Vector3::new(600.0, 300.0, 0.0).normalize();
    let pose = portal.pose(&Coordinates {
        direction: Unit::new_normalize(outward),
        roll_rad: 0.0,
        depth_mm: 20.0,
    });
    assert!((pose.direction(&Vector3::z()) - Vector3::z()).norm() < 1e-12);
    assert!((pose.origin() - (portal.point + outward * 20.0)).norm() < 1e-9);
}

#[test]
fn a_portal_inside_the_base_is_refused() {
    let refusal = Portal::new(Point3::new(100.0, -100.0, 500.0), None).unwrap_err();
    assert_eq!(refusal.reason(), "PORTAL_IN_BASE");
    assert!(Portal::new(Point3::new(f64::NAN, 0.0, 0.0), None).is_err());
    assert!(Portal::new(Point3::new(150.0, 50.0, 0.0), None).is_ok());
}

/// Poses of 0 and `angle` degrees to the axis, at two depths.
fn two_poses(degrees: f64, from_mm: f64, to_mm: f64) -> (Portal, straight::Straight) {
    let portal = Portal::from(Point3::new(700.0, 0.0, 265.0));
    let at = |angle: f64, depth_mm| {
        portal.pose(&Coordinates {
            direction: Unit::new_normalize(Vector3::new(angle.cos(), angle.sin(), 0.0)),
            roll_rad: 0.0,
            depth_mm,
        })
    };
    let line = straight::Straight {
        from: at(0.0, from_mm),
        to: at(degrees.to_radians(), to_mm),
    };
    (portal, line)
}

#[test]
fn a_straight_move_between_poses_on_the_portal_leaves_it() {
    for (degrees, from_mm, to_mm, leaves_mm) in [
        (10.0, 30.0, 30.0, 0.003),
        (30.0, 60.0, 60.0, 0.137),
        (10.0, 30.0, 60.0, 1.307),
        (30.0, 30.0, 60.0, 3.887),
        (30.0, 10.0, 60.0, 6.472),
        (30.0, 0.0, 60.0, 7.766),
    ] {
        let (portal, line) = two_poses(degrees, from_mm, to_mm);
        let found = line.deviation_mm(&portal.point, 2000);
        assert!(
            (found - leaves_mm).abs() < 1e-3,
            "{degrees} {from_mm} {found}"
        );
        let path = RcmPath::to(
            &line.from,
            portal,
            &Destination {
                direction: Some(portal.coordinates(&line.to).direction),
                depth_mm: Some(to_mm),
                roll_rad: None,
            },
            Regain::Portal,
        );
        for step in 0..=100 {
            let pose = path.pose(f64::from(step) / 100.0);
            assert!(Placement::of(&pose, &portal.point).deviation_mm() < 1e-12 * 1e3);
        }
    }
}
