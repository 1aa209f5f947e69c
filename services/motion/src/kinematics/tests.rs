use std::f64::consts::{PI, TAU};

use arthro_geometry::nalgebra::{Matrix4, UnitQuaternion, Vector6};
use proptest::prelude::*;

use super::dh::Dh;
use super::model::Make;
use super::*;

mod calibrated;
mod nominal;

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

    /// About standard normal: the sum of twelve.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    /// A table off the drawing by 0.5 mm and 1 mrad (standard deviation of each number).
    fn calibration(&mut self, make: Make) -> Dh {
        let mut column = |sigma: f64| std::array::from_fn(|_| sigma * self.normal());
        Dh::nominal(&make.links()).plus(&Dh {
            theta_rad: column(1e-3),
            a_mm: column(0.5),
            d_mm: column(0.5),
            alpha_rad: column(1e-3),
        })
    }
}

/// The product of the six standard Denavit-Hartenberg matrices, written as the textbook has them.
fn textbook(dh: &Dh, joints: &Joints) -> Matrix4<f64> {
    (0..6).fold(Matrix4::identity(), |product, i| {
        let (s, c) = (joints[i] + dh.theta_rad[i]).sin_cos();
        let (sa, ca) = dh.alpha_rad[i].sin_cos();
        let (a, d) = (dh.a_mm[i], dh.d_mm[i]);
        #[rustfmt::skip]
        let link = Matrix4::new(
            c, -s * ca, s * sa, a * c,
            s, c * ca, -c * sa, a * s,
            0.0, sa, ca, d,
            0.0, 0.0, 0.0, 1.0,
        );
        product * link
    })
}

fn models() -> [Model; 4] {
    let mut sweep = Sweep(11);
    [Make::Ur5, Make::Ur5e]
        .map(|make| {
            let calibrated = Model::from(make).calibrated(&sweep.calibration(make));
            [make.into(), calibrated.unwrap()]
        })
        .concat()
        .try_into()
        .unwrap()
}

/// How far joints are from a pose, mm and rad.
fn residual(model: &Model, joints: &Joints, wanted: &FlangePose) -> (f64, f64) {
    let reached = model.forward(joints);
    assert!(reached.faces(wanted), "{joints:?}");
    let (shift_mm, turn_rad) = reached.error_to(wanted);
    (shift_mm.norm(), turn_rad.norm())
}

fn joints() -> impl Strategy<Value = Joints> {
    prop::array::uniform6(-PI..PI)
}

/// The numbers of one table by which it is off the drawing, in standard deviations.
fn deviations() -> impl Strategy<Value = [[f64; 6]; 4]> {
    prop::array::uniform4(prop::array::uniform6(-3.0..3.0f64))
}

#[test]
fn forward_agrees_with_the_textbook() {
    let mut sweep = Sweep(7);
    for model in models() {
        for _ in 0..1000 {
            let joints = sweep.joints();
            let wanted = textbook(&model.dh(), &joints);
            let reached = model.base_from_flange(&joints);
            let difference = reached.isometry().to_homogeneous() - wanted;
            assert!(difference.amax() < 1e-11, "{joints:?}: {difference}");
        }
    }
}

#[test]
fn manipulability_and_distances_tell_the_three_singularities() {
    let mut sweep = Sweep(5);
    for model in models() {
        for _ in 0..1000 {
            let joints = sweep.joints();
            let determinant = model.jacobian(&joints).determinant().abs();
            let told = model.manipulability_mm3(&joints);
            assert!((told - determinant).abs() < 1e-5, "{told} {determinant}");
        }
    }
    let model = Model::ur5();
    let ready = [0.3, -1.2, 1.4, 0.2, 1.1, 0.9];
    let with = |joint: usize, angle: f64| {
        let mut joints = ready;
        joints[joint] = angle;
        joints
    };
    for (joints, tell) in [
        (with(4, PI - 0.01), 0),
        (with(4, -TAU + 0.01), 0),
        (with(2, 0.01), 1),
        (with(2, -PI + 0.01), 1),
    ] {
        let near = model.singularities(&joints);
        let told = [near.wrist_rad, near.elbow_rad][tell];
        assert!((told - 0.01).abs() < 1e-12, "{near:?}");
        let share = model.manipulability_mm3(&joints) / model.manipulability_mm3(&ready);
        assert!(share < 0.02, "{share}");
    }
    // The last bend above the shoulder: its distance to the axis of joint 1 is then d4 alone.
    let mut above = ready;
    let links = model.links();
    above[1] = -PI / 2.0;
    above[2] = 0.5;
    above[3] =
        (-links.a3_mm * (above[1] + above[2]).cos() / links.d5_mm).asin() - above[1] - above[2];
    if above[3].is_finite() {
        assert!(model.singularities(&above).shoulder_mm < 1e-9);
    }
}

#[test]
fn a_pose_that_is_no_number_or_out_of_reach_has_no_solution() {
    for model in models() {
        let nearest = |x_mm: f64, z_mm: f64| {
            let pose = FlangePose {
                rotation: arthro_geometry::nalgebra::Matrix3::identity(),
                origin_mm: Vector3::new(x_mm, 0.0, z_mm),
            };
            model.inverse(&pose, &[0.1; 6]).as_slice().len()
        };
        assert_eq!(nearest(1200.0, 300.0), 0);
        assert_eq!(nearest(0.0, 400.0), 0);
        assert_eq!(nearest(f64::NAN, 300.0), 0);
        assert_eq!(nearest(400.0, f64::INFINITY), 0);
        assert!(nearest(400.0, 300.0) > 0);
    }
}

#[test]
fn a_tool_is_brought_to_a_pose_within_the_travel_or_it_is_said_why_not() {
    let flange_from_tool = Rigid::new(
        UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -1.5, 0.1)),
        Vector3::new(3.0, -8.0, 310.0),
    );
    for model in models() {
        let arm = ToolArm::new(model, flange_from_tool);
        let joints = [5.0, -1.2, 1.4, -4.0, 1.1, 6.1];
        let pose = arm.base_from_tool(&joints);
        let found = arm.joints(&pose, &joints).unwrap();
        assert!(largest_difference(&found, &joints).1 < 1e-9, "{found:?}");
        // Beyond a full turn the nearest turn within the limits is taken.
        let found = arm
            .joints(&pose, &[5.0, -1.2, 1.4, -4.0, 1.1, 8.0])
            .unwrap();
        assert!(arm.limit_margin_rad(&found) >= 0.0);
        // Without the turns of the elbow and of joint 1 that reach it there is no way.
        let mut limits = *model.limits();
        limits.max_rad[2] = 0.1;
        limits.min_rad[2] = -0.1;
        let stiff = ToolArm::new(model.with_limits(limits), flange_from_tool);
        assert_eq!(stiff.joints(&pose, &joints), Err(Unreachable::JointLimit));
        let far = Rigid::new(pose.rotation(), Vector3::new(1500.0, 0.0, 0.0));
        assert_eq!(arm.joints(&far, &joints), Err(Unreachable::OutOfReach));
        assert!(arm.joints(&pose, &[f64::NAN; 6]).is_err());
    }
}

proptest! {
    #[test]
    fn the_jacobian_is_the_derivative_of_the_forward_kinematics(
        joints in joints(), rates in prop::array::uniform6(-1.0..1.0f64),
        tip in prop::array::uniform3(-300.0..300.0f64),
    ) {
        let h = 1e-6;
        for model in models() {
            let arm = ToolArm::new(model, Rigid::new(UnitQuaternion::identity(), Vector3::from(tip)));
            let moved = |sign: f64| {
                arm.base_from_tool(&std::array::from_fn(|i| joints[i] + sign * h * rates[i]))
            };
            let (before, after) = (moved(-1.0), moved(1.0));
            let velocity = (after.origin() - before.origin()) / (2.0 * h);
            let turning = (after.rotation() * before.rotation().inverse()).scaled_axis() / (2.0 * h);
            let tip = arm.base_from_tool(&joints).origin();
            let twist = arm.jacobian_at(&joints, &tip) * Vector6::from(rates);
            prop_assert!((twist.fixed_rows::<3>(0) - velocity).norm() < 1e-4);
            prop_assert!((twist.fixed_rows::<3>(3) - turning).norm() < 1e-6);
        }
    }

    #[test]
    fn every_solution_of_a_drawn_arm_reaches_the_pose(joints in joints(), last in -7.0..7.0f64) {
        for make in [Make::Ur5, Make::Ur5e] {
            let model = Model::from(make);
            let wanted = model.forward(&joints);
            let solutions = model.inverse(&wanted, &[last; 6]);
            prop_assert!(!solutions.as_slice().is_empty());
            for solution in solutions.as_slice() {
                let (mm, rad) = residual(&model, solution, &wanted);
                prop_assert!(mm <= RESIDUAL_MAX && rad <= 1e-11, "{mm} mm, {rad} rad");
                prop_assert!(solution.iter().all(|angle| angle.abs() <= PI));
            }
        }
    }

    #[test]
    fn every_solution_of_a_calibrated_arm_reaches_the_pose(
        joints in joints(), deviations in deviations(),
    ) {
        for make in [Make::Ur5, Make::Ur5e] {
            let [theta, a, d, alpha] = deviations;
            let table = Dh::nominal(&make.links()).plus(&Dh {
                theta_rad: theta.map(|sigmas| 1e-3 * sigmas),
                a_mm: a.map(|sigmas| 0.5 * sigmas),
                d_mm: d.map(|sigmas| 0.5 * sigmas),
                alpha_rad: alpha.map(|sigmas| 1e-3 * sigmas),
            });
            let model = Model::from(make).calibrated(&table).unwrap();
            let wanted = model.forward(&joints);
            // As in a stream: the sample before is a little way off.
            let before = joints.map(|angle| angle + 0.01);
            let solutions = model.inverse(&wanted, &before);
            let nearest = solutions.nearest(&before, model.limits());
            prop_assert!(nearest.is_some() || joints[2].abs() > 3.1);
            for solution in solutions.as_slice() {
                let (mm, rad) = residual(&model, solution, &wanted);
                prop_assert!(mm <= RESIDUAL_MAX && rad <= RESIDUAL_MAX, "{mm} mm, {rad} rad");
            }
        }
    }
}
