//! The shaft's line by spinning in a bushing and by two pivots.

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::calibration::gate::Reason;
use arthro_registration::calibration::noise::PoseNoise;
use arthro_registration::calibration::shaft_axis::of_two_pivots;
use arthro_registration::calibration::shaft_axis::spin::{Options, solve};
use arthro_registration::calibration::tool_tip;
use proptest::prelude::{ProptestConfig, any, prop_assert, proptest};

use super::world::{Dice, noise};
use super::{fields, reasons};

/// A shaft in a bushing.
struct Bushing {
    along: Unit<Vector3>,
    point: Point3,
    rest: Unit<Vector3>,
    rest_point: Point3,
}

impl Bushing {
    /// The shaft leans a few degrees from the flange's z and runs some millimetres beside its middle.
    fn drawn(dice: &mut Dice) -> Self {
        Self {
            along: Unit::new_normalize(Vector3::z() + dice.normals(0.05)),
            point: Point3::from(dice.normals(4.0)),
            rest: Unit::new_normalize(dice.direction()),
            rest_point: Point3::from(dice.direction() * 600.0),
        }
    }

    /// The flange after a turn and a slide in the bushing.
    fn pose(&self, turn_rad: f64, slid_mm: f64) -> Rigid<Base, Flange> {
        let upright = Rotation::rotation_between(&self.along, &self.rest).unwrap();
        let rotation = Rotation::from_axis_angle(&self.rest, turn_rad) * upright;
        let there = self.rest_point + self.rest.into_inner() * slid_mm;
        Rigid::new(rotation, there.coords - rotation * self.point.coords)
    }

    fn measured(
        &self,
        dice: &mut Dice,
        count: usize,
        half_turn_rad: f64,
        arm: PoseNoise,
    ) -> Vec<Rigid<Base, Flange>> {
        (0..count)
            .map(|_| {
                let (turn, slide) = (
                    dice.within(-half_turn_rad, half_turn_rad),
                    dice.within(-40.0, 40.0),
                );
                dice.measured(&self.pose(turn, slide), arm)
            })
            .collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    #[test]
    fn without_noise_the_line_is_found_exactly(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let bushing = Bushing::drawn(dice);
        let poses: Vec<_> = (0..12)
            .map(|_| bushing.pose(dice.within(-1.5, 1.5), dice.within(-40.0, 40.0)))
            .collect();
        let axis = solve(&poses, &Options::default()).unwrap().axis;
        prop_assert!(axis.direction_in_flange.angle(&bushing.along) < 1e-9);
        prop_assert!(axis.distance_mm(&bushing.point) < 1e-8);
    }
}

#[test]
fn the_covariance_of_a_spin_is_that_of_its_errors() {
    let dice = &mut Dice::new(31);
    let arm = noise(0.1, 0.03);
    let options = Options {
        arm_noise: Some(arm),
        ..Options::default()
    };
    let (mut directions, mut points, trials) = (0.0, 0.0, 150);
    for _ in 0..trials {
        let bushing = Bushing::drawn(dice);
        let axis = solve(&bushing.measured(dice, 20, 1.5, arm), &options)
            .unwrap()
            .axis;
        let lean = bushing.along.into_inner() - axis.direction_in_flange.into_inner();
        directions += lean.norm_squared() / axis.direction_deviation_rad().powi(2);
        let foot = axis.point_in_flange;
        let beside = bushing.point
            - foot
            - bushing.along.into_inner() * bushing.along.dot(&(bushing.point - foot));
        points += beside.norm_squared() / axis.point_deviation_mm().powi(2);
    }
    for mean in [directions, points].map(|sum| sum / f64::from(trials)) {
        assert!((0.75..1.3).contains(&mean), "{directions} {points}");
    }
}

#[test]
fn every_gate_of_a_spin_refuses() {
    let dice = &mut Dice::new(32);
    let bushing = Bushing::drawn(dice);
    let quiet = noise(0.05, 0.01);
    let few = bushing.measured(dice, 6, 1.5, quiet);
    assert_eq!(
        reasons(solve(&few, &Options::default())),
        [Reason::TooFewPoses]
    );
    let narrow = bushing.measured(dice, 20, 0.2, quiet);
    assert_eq!(
        reasons(solve(&narrow, &Options::default())),
        [Reason::SpanTooSmall]
    );
    let shaky = bushing.measured(dice, 20, 0.5, noise(0.1, 1.5));
    assert_eq!(
        reasons(solve(&shaky, &Options::default())),
        [Reason::ResidualTooLarge, Reason::UncertaintyTooLarge]
    );
    // A pivot is no spin: its shaft does not keep to one line.
    let pivot = super::tool_tip::Pivot::drawn(dice);
    let leaning: Vec<_> = (0..20).map(|_| pivot.pose(dice, 35.0)).collect();
    let refused = reasons(solve(&leaning, &Options::default()));
    assert!(refused.contains(&Reason::ResidualTooLarge), "{refused:?}");
    let options = Options {
        towards_tip: Vector3::zeros(),
        ..Options::default()
    };
    assert_eq!(fields(solve(&few, &options)), ["towards_tip"]);
}

#[test]
fn a_pose_with_the_shaft_out_of_its_bushing_is_found_and_named() {
    let dice = &mut Dice::new(33);
    let bushing = Bushing::drawn(dice);
    let mut poses = bushing.measured(dice, 20, 1.5, noise(0.1, 0.03));
    poses[6] = Rigid::new(Rotation::identity(), dice.direction() * 10.0) * poses[6];
    let found = solve(&poses, &Options::default()).unwrap();
    let rejected: Vec<usize> = (0..20)
        .filter(|index| found.residuals[*index].is_rejected)
        .collect();
    assert_eq!(rejected, [6]);
}

/// A pivot about a point of the shaft.
fn pivoted(dice: &mut Dice, point: Point3) -> tool_tip::ToolTip {
    let poses: Vec<Rigid<Base, Flange>> = (0..20)
        .map(|_| {
            let turn = Rotation::from_scaled_axis(dice.direction() * dice.within(0.0, 0.5));
            let exact = Rigid::new(turn, Vector3::new(500.0, 0.0, 100.0) - turn * point.coords);
            dice.measured(&exact, noise(0.05, 0.005))
        })
        .collect();
    tool_tip::solve(&poses, &tool_tip::Options::default()).unwrap()
}

#[test]
fn two_pivots_give_the_shaft_and_with_it_the_tool() {
    let dice = &mut Dice::new(34);
    let along = Unit::new_normalize(Vector3::new(0.03, -0.02, 1.0));
    let tip = Point3::new(4.0, 2.0, 312.0);
    let (low, high) = (
        pivoted(dice, tip),
        pivoted(dice, tip - along.into_inner() * 180.0),
    );
    let axis = of_two_pivots(&low, &high, 0.01).unwrap();
    let lean = axis.direction_in_flange.angle(&along);
    assert!(
        lean < 3.0 * axis.direction_deviation_rad() && lean < 0.002,
        "{lean}"
    );
    assert!(axis.distance_mm(&low.tip_in_flange) < 1e-9);

    let drawn: Rigid<Flange, Tool> = Rigid::new(
        Rotation::from_scaled_axis(Vector3::y() * -std::f64::consts::FRAC_PI_2),
        Vector3::z() * 310.0,
    );
    let tool = axis.flange_from_tool(&low.tip_in_flange, &drawn).unwrap();
    assert!((tool.direction(&Vector3::x()) - axis.direction_in_flange.into_inner()).norm() < 1e-12);
    assert!(tool.rotation().angle_to(&drawn.rotation()) < 0.05);
    assert_eq!(tool.origin(), low.tip_in_flange);

    let near = pivoted(dice, tip - along.into_inner() * 20.0);
    assert_eq!(
        reasons(of_two_pivots(&low, &near, 0.01)),
        [Reason::BaselineTooShort]
    );
    assert_eq!(
        reasons(of_two_pivots(&low, &high, 1e-7)),
        [Reason::UncertaintyTooLarge]
    );
}
