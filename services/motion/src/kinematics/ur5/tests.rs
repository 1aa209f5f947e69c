use arthro_geometry::nalgebra::{Matrix4, Vector6};
use proptest::prelude::*;

use super::*;
use crate::kinematics::{largest_difference, turn_between};

/// A small seeded generator, so that the sweep is the same everywhere.
struct Sweep(u64);

impl Sweep {
    fn unit(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn joints(&mut self) -> Joints {
        std::array::from_fn(|_| (self.unit() - 0.5) * TAU)
    }
}

fn same_angle(a: f64, b: f64) -> f64 {
    wrap(a - b).abs()
}

/// The product of the six standard Denavit-Hartenberg matrices, written as the textbook has them.
fn textbook(joints: &Joints) -> Matrix4<f64> {
    let d = [89.159, 0.0, 0.0, 109.15, 94.65, 82.3];
    let a = [0.0, -425.0, -392.25, 0.0, 0.0, 0.0];
    let alpha = [PI / 2.0, 0.0, 0.0, PI / 2.0, -PI / 2.0, 0.0];
    (0..6).fold(Matrix4::identity(), |product, i| {
        let (s, c) = joints[i].sin_cos();
        let (sa, ca) = f64::sin_cos(alpha[i]);
        product
            * Matrix4::new(
                c,
                -s * ca,
                s * sa,
                a[i] * c, //
                s,
                c * ca,
                -c * sa,
                a[i] * s, //
                0.0,
                sa,
                ca,
                d[i], //
                0.0,
                0.0,
                0.0,
                1.0,
            )
    })
}

fn residual(joints: &Joints, wanted: &Rigid<Base, Flange>) -> (f64, f64) {
    let reached = forward(joints);
    (
        (reached.origin() - wanted.origin()).norm(),
        turn_between(&reached, wanted),
    )
}

#[test]
fn forward_agrees_with_the_textbook() {
    let mut sweep = Sweep(7);
    for _ in 0..1000 {
        let joints = sweep.joints();
        let difference = forward(&joints).isometry().to_homogeneous() - textbook(&joints);
        assert!(difference.amax() < 1e-11, "{joints:?}: {difference}");
    }
}

#[test]
fn every_solution_reaches_the_pose_and_none_is_lost() {
    let mut sweep = Sweep(1);
    let (mut worst_mm, mut worst_rad) = (0.0_f64, 0.0_f64);
    for case in 0..100_000 {
        let mut joints = sweep.joints();
        // One pose in five is near a singularity of the wrist, the elbow or the shoulder.
        let tiny = 10_f64.powf(-12.0 * sweep.unit());
        match case % 15 {
            0 => joints[4] = tiny,
            1 => joints[4] = PI - tiny,
            2 => joints[2] = tiny,
            _ => {}
        }
        let wanted = forward(&joints);
        let solutions = inverse(&wanted, &joints);
        for solution in solutions.as_slice() {
            let (mm, rad) = residual(solution, &wanted);
            (worst_mm, worst_rad) = (worst_mm.max(mm), worst_rad.max(rad));
        }
        // Near a singularity the pose itself tells the joints only to about eps / sine.
        let p5 = wanted.origin() - wanted.direction(&Vector3::z()) * D6;
        let radius = p5.x.hypot(p5.y);
        let shoulder = ((radius - D4).max(0.0) * (radius + D4)).sqrt() / radius;
        let sine = joints[4].sin().abs().min(joints[2].sin().abs()) * shoulder;
        let tolerance = (1e-12 / sine.max(1e-16)).clamp(1e-6, 1.0);
        let kept = solutions
            .as_slice()
            .iter()
            .any(|solution| (0..6).all(|i| same_angle(solution[i], joints[i]) < tolerance));
        assert!(kept, "case {case}: {joints:?} lost in {solutions:?}");
    }
    assert!(worst_mm <= 1e-9, "worst residual {worst_mm} mm");
    assert!(worst_rad <= 1e-11, "worst residual {worst_rad} rad");
    eprintln!("worst residual {worst_mm:.1e} mm, {worst_rad:.1e} rad");
}

#[test]
fn a_pose_out_of_reach_has_no_solution() {
    let far = Rigid::new(
        Rotation3::identity().into(),
        Vector3::new(1200.0, 0.0, 300.0),
    );
    assert!(inverse(&far, &[0.0; 6]).as_slice().is_empty());
    let above_base = Rigid::new(Rotation3::identity().into(), Vector3::new(0.0, 0.0, 400.0));
    assert!(inverse(&above_base, &[0.0; 6]).as_slice().is_empty());
}

#[test]
fn a_singular_wrist_takes_joint_6_from_the_sample_before() {
    let mut joints = [0.3, -1.2, 1.4, 0.2, 0.0, 0.9];
    for q5 in [0.0, PI] {
        joints[4] = q5;
        let wanted = forward(&joints);
        let found = inverse(&wanted, &joints).nearest(&joints).unwrap();
        assert!(largest_difference(&found, &joints).1 < 1e-7, "{found:?}");
        assert!(residual(&found, &wanted).0 < 1e-9);
    }
}

#[test]
fn the_nearest_solution_stays_on_its_turn_and_within_the_limits() {
    let joints = [5.0, -1.2, 1.4, -4.0, 1.1, 6.1];
    let found = inverse(&forward(&joints), &joints)
        .nearest(&joints)
        .unwrap();
    assert!(largest_difference(&found, &joints).1 < 1e-9);
    let reference = [5.0, -1.2, 1.4, -4.0, 1.1, 8.0];
    let found = inverse(&forward(&joints), &reference)
        .nearest(&reference)
        .unwrap();
    assert!(limit_margin_rad(&found) >= 0.0);
}

/// The bar is 1.5 us on an idle core; the assertion leaves room for a loaded machine.
#[test]
fn all_solutions_of_a_pose_take_microseconds() {
    let mut sweep = Sweep(3);
    let poses: Vec<_> = (0..10_000).map(|_| forward(&sweep.joints())).collect();
    let best_us = (0..10)
        .map(|_| {
            let began = std::time::Instant::now();
            let found: usize = poses
                .iter()
                .map(|pose| inverse(pose, &[0.0; 6]).as_slice().len())
                .sum();
            assert!(found > 0);
            began.elapsed().as_secs_f64() * 1e6 / poses.len() as f64
        })
        .fold(f64::INFINITY, f64::min);
    eprintln!("inverse: {best_us:.2} us for all solutions");
    assert!(best_us < 30.0);
}

proptest! {
    #[test]
    fn the_jacobian_is_the_derivative_of_the_forward_kinematics(
        joints in prop::array::uniform6(-3.0..3.0f64), rates in prop::array::uniform6(-1.0..1.0f64),
    ) {
        let h = 1e-6;
        let moved = |sign: f64| forward(&std::array::from_fn(|i| joints[i] + sign * h * rates[i]));
        let (before, after) = (moved(-1.0), moved(1.0));
        let velocity = (after.origin() - before.origin()) / (2.0 * h);
        let turning = (after.rotation() * before.rotation().inverse()).scaled_axis() / (2.0 * h);
        let twist = jacobian(&joints) * Vector6::from(rates);
        prop_assert!((twist.fixed_rows::<3>(0) - velocity).norm() < 1e-4);
        prop_assert!((twist.fixed_rows::<3>(3) - turning).norm() < 1e-6);
    }
}
