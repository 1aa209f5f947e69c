//! The pose of a board from its corners.

use arthro_geometry::frame::{Board, Camera};
use arthro_geometry::nalgebra::Vector6;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_registration::calibration::board::{Corner, solve};
use arthro_registration::calibration::gate::Reason;
use proptest::prelude::{any, prop_assert, proptest};

use super::world::{Dice, LENS, board_in_view, seen_corners};
use super::{fields, reasons};

fn error(found: &Rigid<Camera, Board>, truth: &Rigid<Camera, Board>) -> Vector6<f64> {
    let turn: Vector3 = (truth.rotation() * found.rotation().inverse()).scaled_axis();
    let shift = truth.translation_mm() - found.translation_mm();
    Vector6::from_iterator(turn.iter().chain(shift.iter()).copied())
}

proptest! {
    #[test]
    fn a_board_seen_without_noise_is_found_exactly(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let truth = board_in_view(dice, 60.0);
        let found = solve(&seen_corners(dice, &truth, 0.0), &LENS, None).unwrap();
        let off = error(&found.camera_from_board, &truth).norm();
        prop_assert!(off < 1e-8, "{off}");
        prop_assert!(found.residual_px < 1e-9);
    }
}

#[test]
fn the_covariance_of_a_board_is_that_of_its_errors() {
    let dice = &mut Dice::new(3);
    let trials = 400;
    let sum: f64 = (0..trials)
        .map(|_| {
            let truth = board_in_view(dice, 40.0);
            let found = solve(&seen_corners(dice, &truth, 0.3), &LENS, Some(0.3)).unwrap();
            let off = error(&found.camera_from_board, &truth);
            off.dot(&(found.covariance.try_inverse().unwrap() * off))
        })
        .sum();
    // Six degrees of freedom; the mean of 400 has a deviation of 0.17.
    let mean = sum / f64::from(trials);
    assert!((5.2..7.2).contains(&mean), "{mean}");
}

#[test]
fn the_noise_of_corners_is_estimated_when_it_is_not_stated() {
    let dice = &mut Dice::new(4);
    let truth = board_in_view(dice, 40.0);
    let corners = seen_corners(dice, &truth, 0.3);
    let stated = solve(&corners, &LENS, Some(0.3)).unwrap().covariance;
    let estimated = solve(&corners, &LENS, None).unwrap().covariance;
    let ratio = (estimated.trace() / stated.trace()).sqrt();
    assert!((0.75..1.25).contains(&ratio), "{ratio}");
}

#[test]
fn bad_corners_are_refused() {
    let dice = &mut Dice::new(5);
    let truth = Rigid::new(Rotation::identity(), Vector3::new(-60.0, -40.0, 400.0));
    let good = seen_corners(dice, &truth, 0.0);
    assert_eq!(fields(solve(&good[..5], &LENS, None)), ["corners"]);
    let mut broken = good.clone();
    broken[3].seen_px[1] = f64::NAN;
    assert_eq!(
        fields(solve(&broken, &LENS, Some(0.0))),
        ["corners[3].seen_px", "corner_noise_px"]
    );
    let line: Vec<Corner> = good[..9].to_vec();
    assert_eq!(reasons(solve(&line, &LENS, None)), [Reason::Undetermined]);
}
