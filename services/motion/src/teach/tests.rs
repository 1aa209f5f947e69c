use std::f64::consts::FRAC_PI_2;

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::nalgebra::{SMatrix, SVector, Unit};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::rcm::portal::about_shaft;
use crate::rcm::{Coordinates, Portal};

const QUARTER_DEGREE_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// A bench with a portal, a tool as configured and as it truly is, and lines that are known to `noise_mm`.
struct Bench {
    chance: ChaCha8Rng,
    portal: Portal,
    configured: Rigid<Flange, Tool>,
    truth: Rigid<Flange, Tool>,
    noise_mm: f64,
}

impl Bench {
    fn new(seed: u64, noise_mm: f64) -> Self {
        let configured = Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        );
        let mut bench = Self {
            chance: ChaCha8Rng::seed_from_u64(seed),
            portal: Portal::from(Point3::new(620.0, 110.0, 240.0)),
            configured,
            truth: configured,
            noise_mm,
        };
        bench.truth = bench.leaning(QUARTER_DEGREE_RAD);
        bench
    }

    /// The tool with a shaft that leans by this from the drawing, about the flange.
    fn leaning(&mut self, angle_rad: f64) -> Rigid<Flange, Tool> {
        let about = self.chance.random_range(0.0..std::f64::consts::TAU);
        let axis = Vector3::new(about.cos(), about.sin(), 0.0);
        let turn = Rotation::from_scaled_axis(axis * angle_rad);
        let leant = turn * self.configured.translation_mm();
        Rigid::new(turn * self.configured.rotation(), leant)
    }

    fn normal(&mut self) -> f64 {
        let (a, b): (f64, f64) = (self.chance.random(), self.chance.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos() * self.noise_mm
    }

    /// A tool whose shaft passes the portal but for the noise, turned about it by up to `tilt_rad` each way.
    fn tool(
        &mut self,
        tilt_rad: f64,
        depths_mm: std::ops::RangeInclusive<f64>,
    ) -> Rigid<Base, Tool> {
        let mut within = |limit: f64| self.chance.random_range(-limit..=limit);
        let tilt = Rotation::from_euler_angles(0.0, within(tilt_rad), within(tilt_rad));
        let roll_rad = within(1.5);
        let direction = Unit::new_normalize(tilt * self.portal.reference_axis().into_inner());
        let depth_mm = self.chance.random_range(depths_mm);
        let at = Coordinates {
            direction,
            roll_rad,
            depth_mm,
        };
        let pose = self.portal.pose(&at);
        let off = pose.direction(&Vector3::new(0.0, self.normal(), self.normal()));
        Rigid::new(pose.rotation(), pose.translation_mm() + off)
    }

    /// What the arm says of the flange for so many poses.
    fn flanges(&mut self, count: usize, tilt_rad: f64, slide_mm: f64) -> Vec<Rigid<Base, Flange>> {
        let flange_from_tool = self.truth;
        (0..count)
            .map(|_| self.tool(tilt_rad, 10.0..=10.0 + slide_mm) * flange_from_tool.inverse())
            .collect()
    }
}

fn squared<const N: usize>(error: &SVector<f64, N>, covariance: &SMatrix<f64, N, N>) -> f64 {
    error.dot(&covariance.cholesky().unwrap().solve(error))
}

#[test]
fn a_portal_is_where_the_lines_meet_and_its_covariance_is_honest() {
    let (mut sum, runs) = (0.0, 400);
    let mut estimated = 0.0;
    for seed in 0..runs {
        let mut bench = Bench::new(seed, 0.3);
        let poses: Vec<_> = (0..8).map(|_| bench.tool(0.5, -40.0..=40.0)).collect();
        let stated = Demands {
            line_noise_mm: Some(0.3),
            ..portal::DEMANDS
        };
        let found = portal::solve(&poses, &stated).unwrap();
        let error = found.portal - bench.portal.point;
        sum += squared(&error, &found.covariance_mm2.unwrap());
        let found = portal::solve(&poses, &portal::DEMANDS).unwrap();
        estimated += squared(&error, &found.covariance_mm2.unwrap());
        assert!(found.axis.dot(&bench.portal.reference_axis()) > 0.9);
    }
    // Three numbers each: 3 if the covariance is what the errors are; less where the residuals widen it.
    let mean = sum / runs as f64;
    println!("portal, mean squared error by its covariance: {mean:.2} stated");
    assert!((2.3..3.3).contains(&mean), "{mean}");
    // With 13 numbers left over an estimated variance makes it 3 * 13 / 11.
    let mean = estimated / runs as f64;
    assert!((2.8..4.3).contains(&mean), "{mean}");
}

#[test]
fn two_lines_give_a_portal_but_no_noise() {
    let mut bench = Bench::new(1, 0.0);
    let poses = vec![bench.tool(0.6, 0.0..=40.0), bench.tool(0.6, 0.0..=40.0)];
    let found = portal::solve(&poses, &portal::DEMANDS).unwrap();
    assert!((found.portal - bench.portal.point).norm() < 1e-6);
    assert!(found.covariance_mm2.is_none());
}

#[test]
fn parallel_lines_give_no_portal() {
    let mut bench = Bench::new(2, 0.1);
    let poses: Vec<_> = (0..6).map(|_| bench.tool(0.05, 0.0..=40.0)).collect();
    let refusal = portal::solve(&poses, &portal::DEMANDS).unwrap_err();
    assert_eq!(refusal.reason(), "LINES_PARALLEL");
    assert!(
        refusal.to_string().contains("must differ by 0.174 rad"),
        "{refusal}"
    );
}

#[test]
fn a_line_that_contradicts_the_rest_is_named() {
    let mut bench = Bench::new(3, 0.2);
    let mut poses: Vec<_> = (0..8).map(|_| bench.tool(0.5, 0.0..=40.0)).collect();
    let wrong = poses[5];
    let aside = wrong.direction(&Vector3::new(0.0, 4.0, 3.0));
    poses[5] = Rigid::new(wrong.rotation(), wrong.translation_mm() + aside);
    let refusal = portal::solve(&poses, &portal::DEMANDS).unwrap_err();
    assert!(
        matches!(refusal, Refusal::Outlier { pose: 5, .. }),
        "{refusal}"
    );
}

#[test]
fn lines_that_do_not_meet_are_refused() {
    let mut bench = Bench::new(4, 6.0);
    let poses: Vec<_> = (0..12).map(|_| bench.tool(0.5, 0.0..=40.0)).collect();
    let refusal = portal::solve(&poses, &portal::DEMANDS).unwrap_err();
    assert_eq!(refusal.reason(), "RESIDUAL_TOO_LARGE");
}

/// A quarter of a degree is a millimetre 240 mm from the flange; the calibration takes it away.
#[test]
fn a_shaft_off_its_drawing_is_found_with_an_honest_covariance() {
    let (mut sum, runs) = (0.0, 300);
    let (mut before_mm, mut after_mm, mut direction_rad) = (0.0, 0.0, 0.0);
    for seed in 0..runs {
        let mut bench = Bench::new(seed, 0.1);
        let poses = bench.flanges(20, 0.4, 90.0);
        let stated = Demands {
            line_noise_mm: Some(0.1),
            ..shaft::DEMANDS
        };
        let found = shaft::solve(&poses, &bench.configured, &stated).unwrap();
        // The unknowns' error: turns and shifts across the line found, then the portal.
        let line = found.flange_from_tool;
        let across = [0, 1].map(|column| found.across.column(column).into_owned());
        let along = bench.truth.direction(&Vector3::x());
        let off = bench.truth.origin() - found.point_in_flange;
        let shift = off - along * along.dot(&off);
        let portal = bench.portal.point - found.portal;
        let error = SVector::<f64, 7>::from([
            across[0].dot(&along),
            across[1].dot(&along),
            across[0].dot(&shift),
            across[1].dot(&shift),
            portal.x,
            portal.y,
            portal.z,
        ]);
        sum += squared(&error, &found.covariance);
        direction_rad += error[0].hypot(error[1]).powi(2);
        // With the portal 70 mm short of the tip, 240 mm from the flange.
        let tool = bench.portal.pose(&Coordinates {
            direction: bench.portal.reference_axis(),
            roll_rad: 0.3,
            depth_mm: 70.0,
        });
        let flange = tool * bench.truth.inverse();
        let miss_mm = |mounted: &Rigid<Flange, Tool>| {
            crate::rcm::Placement::of(&(flange * *mounted), &bench.portal.point).deviation_mm()
        };
        before_mm += miss_mm(&bench.configured).powi(2);
        after_mm += miss_mm(&line).powi(2);
    }
    let rms = |sum: f64| (sum / runs as f64).sqrt();
    println!(
        "shaft: mean squared error by its covariance {:.2} of 7; beside the portal {:.3} mm before, {:.3} mm after; \
         direction off by {:.4} degrees",
        sum / runs as f64,
        rms(before_mm),
        rms(after_mm),
        rms(direction_rad).to_degrees()
    );
    let mean = sum / runs as f64;
    assert!((5.8..7.7).contains(&mean), "{mean}");
    assert!((rms(before_mm) - 1.05).abs() < 0.03, "{}", rms(before_mm));
    assert!(rms(after_mm) < 0.1, "{}", rms(after_mm));
}

#[test]
fn a_shaft_that_does_not_slide_tells_nothing_about_its_direction() {
    let mut bench = Bench::new(5, 0.05);
    let poses = bench.flanges(12, 0.4, 0.0);
    let refusal = shaft::solve(&poses, &bench.configured, &shaft::DEMANDS).unwrap_err();
    assert_eq!(refusal.reason(), "UNDETERMINED");
    assert!(
        refusal.to_string().contains("shaft's direction"),
        "{refusal}"
    );
    assert!(refusal.to_string().contains("slide"), "{refusal}");
}

#[test]
fn a_shaft_that_does_not_turn_tells_nothing_about_the_point() {
    let mut bench = Bench::new(6, 0.0);
    let poses = bench.flanges(12, 1e-4, 90.0);
    let refusal = shaft::solve(&poses, &bench.configured, &shaft::DEMANDS).unwrap_err();
    assert_eq!(refusal.reason(), "UNDETERMINED");
    assert!(refusal.to_string().contains("fixed point"), "{refusal}");
}

#[test]
fn a_pose_beside_the_point_is_named() {
    let mut bench = Bench::new(7, 0.1);
    let mut poses = bench.flanges(14, 0.4, 90.0);
    let wrong = poses[9];
    poses[9] = Rigid::new(
        wrong.rotation(),
        wrong.translation_mm() + Vector3::new(0.0, 3.0, 3.0),
    );
    let refusal = shaft::solve(&poses, &bench.configured, &shaft::DEMANDS).unwrap_err();
    assert!(
        matches!(refusal, Refusal::Outlier { pose: 9, .. }),
        "{refusal}"
    );
}

#[test]
fn a_direction_that_noise_hides_is_refused() {
    let mut bench = Bench::new(8, 1.0);
    let poses = bench.flanges(8, 0.4, 60.0);
    let refusal = shaft::solve(&poses, &bench.configured, &shaft::DEMANDS).unwrap_err();
    assert_eq!(refusal.reason(), "UNCERTAINTY_TOO_LARGE", "{refusal}");
}

#[test]
fn a_shaft_mounted_far_off_its_drawing_is_found() {
    let mut bench = Bench::new(9, 0.0);
    bench.truth = bench.leaning(0.2) * Rigid::new(about_shaft(0.1), Vector3::new(0.0, 4.0, -3.0));
    let poses = bench.flanges(5, 0.5, 90.0);
    let found = shaft::solve(&poses, &bench.configured, &shaft::DEMANDS).unwrap();
    let along = bench.truth.direction(&Vector3::x());
    assert!((found.direction_in_flange.into_inner() - along).norm() < 1e-7);
    assert!((found.portal - bench.portal.point).norm() < 1e-6);
}
