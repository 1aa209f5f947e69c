//! The tip by pivoting.

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::calibration::gate::Reason;
use arthro_registration::calibration::noise::PoseNoise;
use arthro_registration::calibration::tool_tip::{Options, solve};
use proptest::prelude::{ProptestConfig, any, prop_assert, proptest};

use super::world::{Dice, noise, quantile};
use super::{fields, reasons};

/// An instrument of 450 mm whose tip rests in a divot.
pub struct Pivot {
    pub tip: Point3,
    pub divot: Point3,
    turn: Rotation,
}

impl Pivot {
    pub fn drawn(dice: &mut Dice) -> Self {
        Self {
            tip: Point3::from(Vector3::z() * 450.0 + dice.normals(10.0)),
            divot: Point3::from(dice.direction() * dice.within(300.0, 800.0)),
            turn: Rotation::from_scaled_axis(dice.direction() * dice.within(0.0, 3.0)),
        }
    }

    /// About any point of the flange.
    pub fn through(tip: Point3) -> Self {
        Self {
            tip,
            divot: Point3::new(500.0, 100.0, 200.0),
            turn: Rotation::identity(),
        }
    }

    /// The flange when the tool leans up to `lean_deg` and is turned about its shaft.
    pub fn pose(&self, dice: &mut Dice, lean_deg: f64) -> Rigid<Base, Flange> {
        let aside = dice.within(0.0, std::f64::consts::TAU);
        let lean =
            Vector3::new(aside.cos(), aside.sin(), 0.0) * dice.within(0.0, lean_deg.to_radians());
        let roll = Vector3::z() * dice.within(-0.8, 0.8);
        let rotation =
            self.turn * Rotation::from_scaled_axis(lean) * Rotation::from_scaled_axis(roll);
        Rigid::new(rotation, self.divot.coords - rotation * self.tip.coords)
    }

    fn measured(
        &self,
        dice: &mut Dice,
        count: usize,
        arm: PoseNoise,
        play_mm: f64,
    ) -> Vec<Rigid<Base, Flange>> {
        (0..count)
            .map(|_| {
                let pose = self.pose(dice, 35.0);
                let rattled = Rigid::new(
                    pose.rotation(),
                    pose.translation_mm() + dice.normals(play_mm),
                );
                dice.measured(&rattled, arm)
            })
            .collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    #[test]
    fn without_noise_the_tip_is_found_exactly(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let pivot = Pivot::drawn(dice);
        let poses: Vec<_> = (0..12).map(|_| pivot.pose(dice, 35.0)).collect();
        let found = solve(&poses, &Options::default()).unwrap();
        prop_assert!((found.tip_in_flange - pivot.tip).norm() < 1e-9);
        prop_assert!((found.divot_in_base - pivot.divot).norm() < 1e-9);
    }
}

#[test]
fn the_error_of_the_tip_falls_with_the_poses_and_the_covariance_says_how_far() {
    let arm = noise(0.5, 0.05);
    let options = Options {
        arm_noise: Some(arm),
        uncertainty_limit_mm: 5.0,
        ..Options::default()
    };
    let mut medians = Vec::new();
    for count in [12, 50] {
        let dice = &mut Dice::new(9);
        let (mut errors, mut squares, mut residuals) = (Vec::new(), 0.0, Vec::new());
        let trials = 150;
        for _ in 0..trials {
            let pivot = Pivot::drawn(dice);
            let found = solve(&pivot.measured(dice, count, arm, 0.1), &options).unwrap();
            let off = found.tip_in_flange - pivot.tip;
            errors.push(off.norm());
            squares += off.dot(&(found.tip_covariance_mm2.try_inverse().unwrap() * off));
            residuals.push(found.residual_rms_mm);
        }
        // Three degrees of freedom; the mean of 150 has a deviation of 0.2.
        let mean_square = squares / f64::from(trials);
        assert!((2.3..3.7).contains(&mean_square), "{count}: {mean_square}");
        println!(
            "{count} poses: tip error median/p95 {:.2}/{:.2} mm, residual {:.2} mm",
            quantile(&errors, 0.5),
            quantile(&errors, 0.95),
            quantile(&residuals, 0.5)
        );
        medians.push((quantile(&errors, 0.5), quantile(&residuals, 0.5)));
    }
    let [(few_mm, few_residual_mm), (many_mm, many_residual_mm)] = medians[..] else {
        panic!()
    };
    assert!(many_mm < 0.7 * few_mm, "{few_mm} {many_mm}");
    // The residual does not: it is no gate.
    assert!(many_residual_mm > 0.9 * few_residual_mm);
}

#[test]
fn a_tip_that_slipped_is_found_and_named() {
    for options in [
        Options::default(),
        Options {
            arm_noise: Some(noise(0.1, 0.01)),
            ..Options::default()
        },
    ] {
        let dice = &mut Dice::new(21);
        let pivot = Pivot::drawn(dice);
        let mut poses = pivot.measured(dice, 24, noise(0.1, 0.01), 0.1);
        let slip = Rigid::new(Rotation::identity(), Vector3::new(4.0, 0.0, 2.0));
        for index in [3, 15] {
            poses[index] = slip * poses[index];
        }
        let found = solve(&poses, &options).unwrap();
        let rejected: Vec<usize> = (0..24)
            .filter(|index| found.residuals[*index].is_rejected)
            .collect();
        assert_eq!(rejected, [3, 15]);
        assert!((found.tip_in_flange - pivot.tip).norm() < 0.4);
    }
}

#[test]
fn every_gate_of_a_pivot_refuses() {
    let dice = &mut Dice::new(22);
    let pivot = Pivot::drawn(dice);
    let quiet = noise(0.1, 0.01);
    let few = pivot.measured(dice, 9, quiet, 0.1);
    assert_eq!(
        reasons(solve(&few, &Options::default())),
        [Reason::TooFewPoses]
    );

    let upright: Vec<_> = (0..20)
        .map(|index| {
            let turn =
                pivot.turn * Rotation::from_scaled_axis(Vector3::z() * 0.1 * f64::from(index));
            Rigid::new(turn, pivot.divot.coords - turn * pivot.tip.coords)
        })
        .collect();
    assert_eq!(
        reasons(solve(&upright, &Options::default())),
        [Reason::AxesParallel]
    );

    let still: Vec<_> = (0..20)
        .map(|_| dice.measured(&upright[0], noise(5.0, 0.1)))
        .collect();
    assert_eq!(
        reasons(solve(&still, &Options::default())),
        [Reason::SpanTooSmall, Reason::AxesParallel]
    );

    let loose = pivot.measured(dice, 20, noise(4.0, 0.1), 0.1);
    let refused = reasons(solve(&loose, &Options::default()));
    assert_eq!(
        refused,
        [Reason::ResidualTooLarge, Reason::UncertaintyTooLarge]
    );

    let mut slipped = pivot.measured(dice, 20, quiet, 0.1);
    for (index, pose) in slipped.iter_mut().take(8).enumerate() {
        *pose = Rigid::new(
            Rotation::identity(),
            Vector3::y() * (10.0 + 5.0 * index as f64),
        ) * *pose;
    }
    let refused = reasons(solve(&slipped, &Options::default()));
    assert!(refused.contains(&Reason::TooManyOutliers), "{refused:?}");
}

#[test]
fn bad_input_of_a_pivot_is_refused_with_every_field_named() {
    let bad = Rigid::new(Rotation::identity(), Vector3::new(f64::INFINITY, 0.0, 0.0));
    let options = Options {
        arm_noise: Some(noise(0.1, 90.0)),
        divot_play_mm: -0.1,
        residual_limit_mm: f64::NAN,
        ..Options::default()
    };
    assert_eq!(
        fields(solve(&[bad], &options)),
        [
            "poses[0]",
            "arm_noise.rotation_rad",
            "divot_play_mm",
            "residual_limit_mm"
        ]
    );
}
