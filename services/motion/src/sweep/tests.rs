use std::f64::consts::{FRAC_PI_2, PI};

use arthro_geometry::{Rigid, Rotation, Vector3};
use proptest::prelude::*;

use super::*;
use crate::bodies::{ArmShape, ToolShape};
use crate::clearance::{Clearance, Side};
use crate::free_way::FreeWay;
use crate::kinematics::model::Model;
use crate::workspace::{Part, Plane};

const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

fn arm() -> ToolArm {
    ToolArm::new(
        Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    )
}

/// Two arms a metre apart, face to face.
fn clearance() -> Clearance {
    let arm = arm();
    let shape = ArmShape::new(&arm, ToolShape::default());
    let base = Rigid::new(
        Rotation::from_axis_angle(&Vector3::z_axis(), PI),
        Vector3::new(1000.0, 0.0, 0.0),
    );
    Clearance::new((arm, shape), (arm, shape), base)
}

fn turned(start: &Joints, by: &Joints) -> Way {
    let end = std::array::from_fn(|i| start[i] + by[i]);
    Way::Outside(Box::new(
        FreeWay::joints(arm(), start, &end, 0.5, &Limits::default()).unwrap(),
    ))
}

fn way(side: Side, start: &Joints, by: &Joints) -> Sweep {
    let arm = arm();
    let limits = Limits::default();
    let [forceps, arthroscope] = Berth::beside(clearance());
    let berth = match side {
        Side::Forceps => forceps,
        Side::Arthroscope => arthroscope,
    };
    let walker = Walker {
        arm: &arm,
        limits: &limits,
        berth: &berth,
        plane_room_mm: 0.0,
    };
    walker.sweep(&turned(start, by), start).unwrap()
}

#[test]
fn a_way_through_the_other_arm_is_refused_where_it_comes_too_near() {
    let other = clearance().bodies(Side::Arthroscope, &START);
    let keep = Keep::of(&Limits::default());
    let start = std::array::from_fn(|i| START[i] + [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0][i]);
    let away = way(Side::Forceps, &start, &[-0.2, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(away.keeps_clear_of(&other, &keep), Ok(()));
    let through = way(Side::Forceps, &start, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let refusal = through.keeps_clear_of(&other, &keep).unwrap_err();
    assert_eq!(refusal.reason(), "ARMS_TOO_NEAR");
    let Error::ArmsTooNear { percent, mm, .. } = refusal else {
        panic!("{refusal}")
    };
    assert!(
        (10.0..90.0).contains(&percent) && mm < 20.0,
        "{percent} {mm}"
    );
}

#[test]
fn a_way_that_crosses_the_way_of_a_moving_arm_is_refused_even_if_they_would_not_meet() {
    let keep = Keep::of(&Limits::default());
    let crossing: Joints = [0.6, 0.0, 0.0, 0.0, 0.0, 0.0];
    let theirs = way(Side::Arthroscope, &START, &crossing);
    let own = way(Side::Forceps, &START, &crossing);
    let refusal = own.keeps_clear_of_sweep(&theirs, &keep).unwrap_err();
    assert_eq!(refusal.reason(), "ARM_BUSY_NEARBY");
    let away: Joints = [-0.6, 0.0, 0.0, 0.0, 0.0, 0.0];
    let start = std::array::from_fn(|i| START[i] + 2.0 * away[i]);
    let own = way(Side::Forceps, &start, &away);
    assert_eq!(own.keeps_clear_of_sweep(&theirs, &keep), Ok(()));
}

#[test]
fn a_way_beyond_a_plane_is_refused_with_the_place() {
    let arm = arm();
    let tip_mm = arm.base_from_tool(&START).origin().y;
    let limits = Limits {
        planes: vec![Plane {
            name: "wall".to_owned(),
            normal: [0.0, -1.0, 0.0],
            offset_mm: -tip_mm - 100.0,
            keeps: vec![Part::Tip],
        }],
        ..Limits::default()
    };
    let [berth, _] = Berth::beside(clearance());
    let walker = Walker {
        arm: &arm,
        limits: &limits,
        berth: &berth,
        plane_room_mm: 0.0,
    };
    let plan = turned(&START, &[0.6, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let refusal = walker.sweep(&plan, &START).unwrap_err();
    assert_eq!(refusal.reason(), "WORKSPACE");
    assert!(refusal.to_string().contains("plane wall"), "{refusal}");
    let back = turned(&START, &[-0.6, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(walker.sweep(&back, &START).is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn leaving_out_samples_never_hides_a_place_that_is_too_near(
        by in proptest::array::uniform6(-0.6..0.6f64),
        their_by in proptest::array::uniform6(-0.6..0.6f64),
    ) {
        let keep = Keep::of(&Limits::default());
        let own = way(Side::Forceps, &START, &by);
        let theirs = way(Side::Arthroscope, &START, &their_by);
        let near = |one: &Sample, other: &Sample| {
            let slack_mm = one.slack_mm + other.slack_mm;
            keep.missed(&one.bodies.nearest(&other.bodies).less(slack_mm)).is_some()
        };
        let any_pair = own
            .coarse
            .iter()
            .any(|one| theirs.coarse.iter().any(|other| near(one, other)));
        prop_assert_eq!(own.keeps_clear_of_sweep(&theirs, &keep).is_err(), any_pair);
        let standing = theirs.fine[0].clone();
        let still = Sample { slack_mm: 0.0, ..standing };
        let any = own.fine.iter().any(|one| near(one, &still));
        prop_assert_eq!(own.keeps_clear_of(&still.bodies, &keep).is_err(), any);
    }

    #[test]
    fn between_two_samples_no_body_is_farther_from_one_of_them_than_its_slack(
        by in proptest::array::uniform6(-0.6..0.6f64), share in 0.0..1.0f64
    ) {
        let own = way(Side::Forceps, &START, &by);
        let joints = std::array::from_fn(|i| START[i] + by[i] * share);
        let there = clearance().bodies(Side::Forceps, &joints);
        let covers = |sample: &Sample| sample.bodies.moved_mm(&there) <= sample.slack_mm + 0.01;
        prop_assert!(own.fine.iter().any(covers));
    }
}
