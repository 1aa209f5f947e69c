//! What holds whatever the numbers are.

use arthro_geometry::{Point3, Rotation, Vector3, phantom};
use arthro_planning::jaw::Bite;
use arthro_planning::plan::Request;
use proptest::prelude::*;

use crate::world::{papers_case, plan, score, tear_case};

fn bite_near_the_phantom() -> impl Strategy<Value = Bite> {
    (51.0..57.0f64, 42.0..68.0f64, 32.0..68.0f64).prop_map(|(x, y, z)| {
        let center = Point3::new(x, y, z);
        let portal = phantom::PORTAL_ANTEROLATERAL;
        Bite::through(&portal, center, &phantom::SUPERIOR, center).unwrap()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn one_more_bite_never_covers_less_nor_leaves_more(
        bites in proptest::collection::vec(bite_near_the_phantom(), 1..8)
    ) {
        let request = papers_case();
        let mut before = score(&request, &[]);
        for count in 1..=bites.len() {
            let after = score(&request, &bites[..count]);
            prop_assert!(after.lesion_covered_percent >= before.lesion_covered_percent);
            prop_assert!(after.region_covered_percent >= before.region_covered_percent);
            prop_assert!(after.healthy_removed_mm3 >= before.healthy_removed_mm3);
            prop_assert!(after.outside_removed_mm3 >= before.outside_removed_mm3);
            let bitten = before.healthy_removed_mm3 > 0.0;
            prop_assert!(!bitten || after.rim_min_mm <= before.rim_min_mm + 1e-9);
            before = after;
        }
    }

    #[test]
    fn a_meniscus_that_lies_elsewhere_has_the_same_plan(
        turn in (-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64),
        shift in (-200.0..200.0f64, -200.0..200.0f64, -200.0..200.0f64),
    ) {
        // A box along other axes would be another box.
        let mut request = Request { target_box: None, ..tear_case() };
        let expected = plan(&request).unwrap();

        let rotation = Rotation::from_scaled_axis(Vector3::new(turn.0, turn.1, turn.2));
        let shift = Vector3::new(shift.0, shift.1, shift.2);
        let carry = |point: &mut Point3| *point = rotation * *point + shift;
        request.model.vertices.iter_mut().for_each(carry);
        request.lesion.iter_mut().for_each(carry);
        request.portals.iter_mut().for_each(carry);
        let moved = plan(&request).unwrap();
        prop_assert_eq!(moved.bites.len(), expected.bites.len());
        for (planned, other) in moved.bites.iter().zip(expected.bites) {
            let mut center = other.bite.center;
            carry(&mut center);
            prop_assert!((planned.bite.center - center).norm() < request.voxel_mm);
        }
        let (a, b) = (moved.evaluation, expected.evaluation);
        prop_assert!((a.lesion_covered_percent - b.lesion_covered_percent).abs() < 1.0);
        prop_assert!((a.healthy_removed_mm3 - b.healthy_removed_mm3).abs() < 3.0);
    }
}
