//! What holds of every score, whatever the bites are.

use std::sync::OnceLock;

use arthro_geometry::{Point3, Rotation, Vector3, phantom};
use arthro_planning::evaluation::order::BiteAccount;
use arthro_planning::jaw::Bite;
use proptest::prelude::*;

use super::case::{Case, band_contour};

fn the_band() -> &'static Case {
    static CASE: OnceLock<Case> = OnceLock::new();
    CASE.get_or_init(|| Case::band(0.5))
}

/// Bites anywhere on the crescent, in its axes, that point anywhere.
fn bites(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Bite>> {
    let bite = (
        -1.8..1.8f64,
        8.0..22.0f64,
        -2.0..3.0f64,
        -3.1..3.1f64,
        -0.4..0.1f64,
    );
    let bite = bite.prop_map(|(angle_rad, radius_mm, height_mm, yaw_rad, slope)| {
        let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
        let axis = Vector3::new(yaw_rad.cos(), yaw_rad.sin(), slope);
        Bite::of_axis(Point3::new(x, y, height_mm), &axis, &Vector3::z()).unwrap()
    });
    proptest::collection::vec(bite, count)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_bite_more_never_covers_less_and_leaves_the_accounts_before_it(bites in bites(1..8)) {
        let mut before = the_band().evaluate(&[]);
        for count in 1..=bites.len() {
            let after = the_band().evaluate(&bites[..count]);
            prop_assert!(after.region_covered_percent >= before.region_covered_percent);
            prop_assert!(after.lesion_covered_percent >= before.lesion_covered_percent);
            prop_assert!(after.removed_mm3 >= before.removed_mm3);
            prop_assert!(after.left_mm3 <= before.left_mm3);
            prop_assert_eq!(&after.accounts[..count - 1], &before.accounts[..]);
            before = after;
        }
    }

    #[test]
    fn what_is_removed_adds_up(bites in bites(0..12)) {
        let all = the_band().evaluate(&bites);
        let sum = |part: fn(&BiteAccount) -> f64| all.accounts.iter().map(part).sum::<f64>();
        let region_mm3 = sum(|account| account.region_mm3);
        prop_assert!((region_mm3 - (all.region_mm3 - all.left_mm3)).abs() < 1e-9);
        prop_assert!((sum(|account| account.outside_mm3) - all.outside_removed_mm3).abs() < 1e-9);
        prop_assert!((region_mm3 + all.outside_removed_mm3 - all.removed_mm3).abs() < 1e-9);
        let share = 100.0 * region_mm3 / all.region_mm3;
        prop_assert!((share - all.region_covered_percent).abs() < 1e-9);
        prop_assert!(all.healthy_removed_mm3 <= all.removed_mm3);
        prop_assert!(all.accounts.iter().all(|account| (0.0..1.0 + 1e-9).contains(&account.throat_share)));
    }

    #[test]
    fn the_order_changes_who_takes_what_but_not_what_is_taken(
        (bites, shuffled) in bites(2..10).prop_flat_map(|bites| (Just(bites.clone()), Just(bites).prop_shuffle()))
    ) {
        let one = the_band().evaluate(&bites);
        let mut other = the_band().evaluate(&shuffled);
        prop_assert!((one.predicted_seconds - other.predicted_seconds).abs() < 1e-9);
        other.predicted_seconds = one.predicted_seconds;
        other.accounts.clone_from(&one.accounts);
        other.infeasible.clone_from(&one.infeasible);
        prop_assert_eq!(other, one);
    }

    #[test]
    fn the_same_bites_have_the_same_score(bites in bites(0..10)) {
        prop_assert_eq!(the_band().evaluate(&bites), the_band().evaluate(&bites));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_joint_that_lies_elsewhere_has_the_same_score(
        turn in (-3.0..3.0f64, -3.0..3.0f64, -3.0..3.0f64),
        shift in (-200.0..200.0f64, -200.0..200.0f64, -200.0..200.0f64),
    ) {
        let rotation = Rotation::from_scaled_axis(Vector3::new(turn.0, turn.1, turn.2));
        let shift = Vector3::new(shift.0, shift.1, shift.2);
        let carry = |point: &Point3| rotation * *point + shift;
        let mut model = phantom::mesh();
        let here = Case::band(0.5);
        for vertex in &mut model.vertices {
            *vertex = carry(vertex);
        }
        let contour: Vec<Point3> = band_contour().iter().map(carry).collect();
        let there = Case::new(&model, &contour, &[], &carry(&phantom::PORTAL_ANTEROLATERAL), 0.5);
        // The bites are given in ct and carried with the joint.
        let bites = here.papers_bites().into_iter().map(|bite| {
            let in_ct = bite.carried(&here.crescent.ct_from_meniscal);
            let moved = Bite {
                center: carry(&in_ct.center),
                approach: rotation * in_ct.approach,
                opening: rotation * in_ct.opening,
                contour_point: carry(&in_ct.contour_point),
            };
            moved.carried(&there.crescent.ct_from_meniscal.inverse())
        });
        let there = there.evaluate(&bites.collect::<Vec<_>>());
        let here = here.evaluate(&here.papers_bites());
        prop_assert!((there.region_covered_percent - here.region_covered_percent).abs() < 0.5);
        prop_assert!((there.outside_removed_mm3 - here.outside_removed_mm3).abs() < 3.0);
        prop_assert!((there.rim_min_mm - here.rim_min_mm).abs() < 0.11);
        prop_assert!((there.rim_mean_mm - here.rim_mean_mm).abs() < 0.02);
        prop_assert!((there.edge_turns.rms_rad - here.edge_turns.rms_rad).abs() < 0.05);
        prop_assert!((there.predicted_seconds - here.predicted_seconds).abs() < 0.1);
        for (a, b) in there.accounts.iter().zip(&here.accounts) {
            prop_assert!((a.throat_share - b.throat_share).abs() < 0.1);
        }
    }
}
