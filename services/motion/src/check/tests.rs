use std::f64::consts::FRAC_PI_2;

use arthro_geometry::{Rotation, Vector3};

use super::*;
use crate::bodies::{ArmShape, ToolShape};

fn dry_run() -> DryRun {
    let arm = ToolArm::new(
        crate::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    );
    DryRun {
        arm,
        limits: Limits::default(),
        neutral_joints_rad: [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
        portal: Point3::new(700.0, 0.0, 265.0).into(),
        period_s: 0.008,
        method: Method::Rcm,
        roll: Choice::Keep,
        berth: Berth::apart(ArmShape::new(&arm, ToolShape::default())),
    }
}

#[test]
fn targets_in_the_knee_are_reached_with_margins() {
    for (x, y, z) in [
        (740.0, 0.0, 250.0),
        (745.0, 20.0, 255.0),
        (755.0, -15.0, 248.0),
    ] {
        let checked = dry_run().check(&Point3::new(x, y, z));
        let margins = checked.outcome.unwrap();
        assert!(margins.margins.joint_limit_rad > 0.3, "{margins:?}");
        assert!(margins.margins.rcm_between_samples_mm < 0.01, "{margins:?}");
        assert!(checked.depth_mm > 40.0);
    }
}

#[test]
fn targets_that_cannot_be_reached_say_why() {
    let reason = |target| {
        let checked = dry_run().check(&target);
        checked.outcome.unwrap_err().reason().to_owned()
    };
    assert_eq!(reason(Point3::new(800.0, 0.0, 250.0)), "TOO_DEEP");
    assert_eq!(reason(Point3::new(660.0, 0.0, 265.0)), "TURN_TOO_WIDE");
    let mut far = dry_run();
    far.portal = Point3::new(1300.0, 0.0, 265.0).into();
    let checked = far.check(&Point3::new(1340.0, 0.0, 250.0));
    assert_eq!(checked.outcome.unwrap_err().reason(), "OUT_OF_REACH");
}

#[test]
fn a_way_tells_which_limit_it_comes_nearest_to() {
    let way = |target| dry_run().check(&target).outcome.unwrap();
    // 79 of 80 mm deep.
    let (room, word) = way(Point3::new(778.0, 0.0, 255.0)).least_room();
    assert_eq!(word, "DEPTH");
    assert!((0.0..0.2).contains(&room), "{room}");
    let mut leaning = dry_run();
    leaning.portal.axis = Some(Vector3::x_axis());
    leaning.limits.cone_max_rad = 0.35;
    let target = Point3::new(740.0, 14.0, 265.0);
    let way = leaning.check(&target).outcome.unwrap();
    assert_eq!(way.least_room().1, "CONE");
    assert!((way.cone_rad - (0.35 - 14_f64.atan2(40.0))).abs() < 1e-9);
    leaning.limits.cone_max_rad = 0.3;
    let refusal = leaning.check(&target).outcome.unwrap_err();
    assert_eq!(refusal.reason(), "CONE");
    assert_eq!(
        refusal.to_string(),
        "the shaft would lean 0.337 rad from the portal's axis; limit 0.300 rad"
    );
}

#[test]
fn the_worst_target_is_the_one_without_a_way_or_with_the_least_room() {
    let near = Point3::new(740.0, 0.0, 260.0);
    let deep = Point3::new(778.0, 0.0, 255.0);
    let beyond = Point3::new(800.0, 0.0, 250.0);
    let worst =
        |targets: &[Point3]| Checked::worst(&dry_run().check_all(targets, Order::Any)).unwrap();
    assert_eq!(worst(&[near, deep, near]), 1);
    assert_eq!(worst(&[deep, near, beyond]), 2);
    assert_eq!(Checked::worst(&[]), None);
}

#[test]
fn targets_as_listed_are_approached_from_where_the_one_before_left_the_arm() {
    let targets = [
        Point3::new(745.0, 20.0, 255.0),
        Point3::new(745.0, -20.0, 255.0),
        Point3::new(740.0, 0.0, 285.0),
        Point3::new(745.0, 20.0, 255.0),
    ];
    let listed = dry_run().check_all(&targets, Order::AsListed);
    let apart = dry_run().check_all(&targets, Order::Any);
    let s = |checked: &Checked| checked.outcome.as_ref().unwrap().duration_s;
    // The second lies on the other side of the first: farther from there than from the neutral pose.
    assert!(
        s(&listed[1]) > s(&apart[1]),
        "{} {}",
        s(&listed[1]),
        s(&apart[1])
    );
    assert!(listed.iter().all(|checked| checked.outcome.is_ok()));
    // One without a way leaves the arm where it was.
    let with_hole = [targets[0], Point3::new(900.0, 0.0, 265.0), targets[1]];
    let with_hole = dry_run().check_all(&with_hole, Order::AsListed);
    assert!(with_hole[1].outcome.is_err());
    assert!((s(&with_hole[2]) - s(&listed[1])).abs() < 1e-9);
}

#[test]
fn the_papers_way_is_on_the_portal_when_corrected_and_beside_it_as_printed() {
    let target = Point3::new(740.0, 20.0, 275.0);
    let mut paper = dry_run();
    paper.method = Method::Paper(Formula::Corrected);
    let way = paper.check(&target).outcome.unwrap();
    assert!(way.margins.rcm_at_samples_mm < 1e-6, "{way:?}");
    paper.method = Method::Paper(Formula::AsPrinted);
    match paper.check(&target).outcome {
        Err(Error::RcmDeviation { deviation_mm, .. }) => assert!(deviation_mm > 4.0),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_free_roll_reaches_targets_that_a_kept_one_does_not() {
    let target = Point3::new(745.0, 40.0, 255.0);
    let mut free = dry_run();
    let start = free.neutral_joints_rad;
    let margin = |dry_run: &DryRun| {
        let way = dry_run.check(&target).outcome;
        way.map(|way| way.margins.joint_limit_rad)
    };
    // Of a shaft along the flange's axis joint 6 alone bears the roll: it gets half of what the pivot asks for.
    let mut limits = *free.arm.model().limits();
    let (least, most) = (start[5] - 0.05, start[5] + 0.05);
    (limits.min_rad[5], limits.max_rad[5]) = (least, most);
    let model = free.arm.model().with_limits(limits);
    free.arm = ToolArm::new(model, free.arm.flange_from_tool());
    assert_eq!(margin(&free).unwrap_err().reason(), "JOINT_LIMIT");
    free.roll = Choice::Free;
    assert!(margin(&free).unwrap() > 0.0);
    // As listed it comes back out and goes in again.
    let listed = free.check_all(&[target, target], Order::AsListed);
    assert!(
        listed.iter().all(|checked| checked.outcome.is_ok()),
        "{listed:?}"
    );
}
