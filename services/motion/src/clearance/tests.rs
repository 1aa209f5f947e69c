use std::f64::consts::{FRAC_PI_2, PI};

use arthro_geometry::{Point3, Rotation, Vector3};
use proptest::prelude::*;

use super::*;
use crate::bodies::{Capsule, ToolShape};
use crate::kinematics::model::Model;

const FORCEPS: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];
const ARTHROSCOPE: Joints = [0.796, -1.456, -1.861, -3.148, -1.303, -1.522];

fn clearance(yaw_rad: f64, base_mm: [f64; 3]) -> Clearance {
    let arm = ToolArm::new(
        Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    );
    let shape = ArmShape::new(&arm, ToolShape::default());
    let base = Rigid::new(
        Rotation::from_axis_angle(&Vector3::z_axis(), yaw_rad),
        base_mm.into(),
    );
    Clearance::new((arm, shape), (arm, shape), base)
}

#[test]
fn arms_far_apart_are_as_far_apart_as_their_nearest_bodies() {
    let near = clearance(PI, [3000.0, 0.0, 0.0]).between(&FORCEPS, &FORCEPS);
    let far = clearance(PI, [3500.0, 0.0, 0.0]).between(&FORCEPS, &FORCEPS);
    assert!(near.others.mm > 1000.0, "{near:?}");
    // Both reach towards each other with their shafts.
    assert!(near.shafts.mm < near.others.mm);
    assert!((far.shafts.mm - near.shafts.mm - 500.0).abs() < 20.0);
}

#[test]
fn arms_on_one_place_overlap() {
    let nearest = clearance(0.0, [0.0; 3]).between(&FORCEPS, &FORCEPS);
    assert!(nearest.others.mm < -100.0, "{nearest:?}");
    assert!((nearest.shafts.mm + 3.5).abs() < 1e-9);
}

#[test]
fn an_arm_that_does_not_know_where_it_is_has_no_room() {
    let mut joints = FORCEPS;
    joints[1] = f64::NAN;
    let nearest = clearance(-FRAC_PI_2, [350.0, 750.0, 0.0]).between(&joints, &ARTHROSCOPE);
    assert!(nearest.others.mm < 0.0, "{nearest:?}");
    let keep = Keep::of(&Limits::default());
    assert!(keep.missed(&nearest).is_some());
}

#[test]
fn shafts_may_come_nearer_than_arms() {
    let keep = Keep::of(&Limits::default());
    let nearest = |shafts_mm, others_mm| Nearest {
        shafts: Distance {
            mm: shafts_mm,
            bodies: [Body::Shaft, Body::Shaft],
        },
        others: Distance {
            mm: others_mm,
            bodies: [Body::DriveUnit, Body::Shaft],
        },
    };
    assert_eq!(keep.missed(&nearest(1.5, 25.0)), None);
    assert_eq!(keep.missed(&nearest(0.9, 25.0)).unwrap().1, 1.0);
    let (distance, limit_mm) = keep.missed(&nearest(1.5, 19.0)).unwrap();
    assert_eq!((distance.mm, limit_mm), (19.0, 20.0));
    let eased = keep.eased(&nearest(1.5, 19.0), 1.0);
    assert_eq!((eased.shafts_mm, eased.others_mm), (0.5, 18.0));
}

fn joints() -> impl Strategy<Value = Joints> {
    proptest::array::uniform6(-PI..PI)
}

fn points(capsule: &Capsule) -> impl Iterator<Item = Point3> {
    let [from, to] = capsule.ends;
    (0..=40).map(move |step| from + (to - from) * (f64::from(step) / 40.0))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_two_places_of_two_arms_are_nearer_than_told(a in joints(), b in joints()) {
        let clearance = clearance(-FRAC_PI_2, [350.0, 750.0, 0.0]);
        let nearest = clearance.between(&a, &b);
        let told_mm = nearest.others.mm.min(nearest.shafts.mm);
        let (a, b) = (
            clearance.bodies(Side::Forceps, &a),
            clearance.bodies(Side::Arthroscope, &b),
        );
        let mut found_mm = f64::INFINITY;
        for (_, one) in a.iter() {
            for (_, other) in b.iter() {
                for p in points(one) {
                    for q in points(other) {
                        found_mm = found_mm.min((p - q).norm() - one.radius_mm - other.radius_mm);
                    }
                }
            }
        }
        prop_assert!(found_mm >= told_mm - 1e-9, "{found_mm} {nearest:?}");
        // Half a step along two links of less than 500 mm.
        prop_assert!(found_mm <= told_mm + 12.5, "{found_mm} {nearest:?}");
    }

    #[test]
    fn a_small_motion_changes_the_distance_by_no_more_than_the_bodies_moved(
        a in joints(), b in joints(), step in proptest::array::uniform6(-0.05..0.05f64)
    ) {
        let clearance = clearance(-FRAC_PI_2, [350.0, 750.0, 0.0]);
        let moved: Joints = std::array::from_fn(|i| a[i] + step[i]);
        let before = clearance.between(&a, &b);
        let after = clearance.between(&moved, &b);
        let bodies = clearance.bodies(Side::Forceps, &a);
        let way_mm = bodies.moved_mm(&clearance.bodies(Side::Forceps, &moved));
        prop_assert!((before.others.mm - after.others.mm).abs() <= way_mm + 1e-9);
        prop_assert!((before.shafts.mm - after.shafts.mm).abs() <= way_mm + 1e-9);
    }
}
