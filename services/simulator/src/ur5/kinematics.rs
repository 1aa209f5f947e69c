//! Geometry of the simulated arm: forward kinematics from the Denavit-Hartenberg table, inverse kinematics by damped
//! least squares. Written for the simulator alone: it shares nothing with the services that it checks. Metres.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix6, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};

/// One angle, speed or acceleration per joint: base, shoulder, elbow, wrist 1, 2, 3.
pub type Joints = [f64; 6];

/// Denavit-Hartenberg parameters of an arm, standard convention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dh {
    /// Link offsets, m.
    pub d_m: Joints,
    /// Link lengths, m.
    pub a_m: Joints,
    /// Link twists, rad.
    pub alpha_rad: Joints,
    /// What a calibrated arm adds to its joint angles, rad.
    pub theta_rad: Joints,
}

const ALPHA_RAD: Joints = [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0];

/// The UR5 as drawn (CB3).
pub const UR5: Dh = Dh {
    d_m: [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823],
    a_m: [0.0, -0.425, -0.39225, 0.0, 0.0, 0.0],
    alpha_rad: ALPHA_RAD,
    theta_rad: [0.0; 6],
};

/// The UR5e as drawn (e-Series).
pub const UR5E: Dh = Dh {
    d_m: [0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
    a_m: [0.0, -0.425, -0.3922, 0.0, 0.0, 0.0],
    alpha_rad: ALPHA_RAD,
    theta_rad: [0.0; 6],
};

/// A solution must reproduce its pose this well.
const IK_TOLERANCE: f64 = 1e-10;
const IK_ITERATIONS: usize = 60;
/// Largest change of one joint in one iteration.
const IK_STEP_RAD: f64 = 0.5;

impl Dh {
    /// Base from flange.
    pub fn flange(&self, joints: &Joints) -> Isometry3<f64> {
        (0..6).fold(Isometry3::identity(), |base_from_link, joint| {
            base_from_link * self.link(joint, joints[joint])
        })
    }

    /// Joint speeds to the twist (linear, angular) of a point fixed to the flange, in base axes.
    pub fn jacobian(&self, joints: &Joints, flange_from_point: &Isometry3<f64>) -> Matrix6<f64> {
        let mut axes = [(Vector3::zeros(), Vector3::z()); 6];
        let mut base_from_link = Isometry3::identity();
        for joint in 0..6 {
            axes[joint] = (
                base_from_link.translation.vector,
                base_from_link * Vector3::z(),
            );
            base_from_link *= self.link(joint, joints[joint]);
        }
        let point = (base_from_link * flange_from_point).translation.vector;
        let mut jacobian = Matrix6::zeros();
        for (joint, (origin, axis)) in axes.iter().enumerate() {
            jacobian
                .fixed_view_mut::<3, 1>(0, joint)
                .copy_from(&axis.cross(&(point - origin)));
            jacobian.fixed_view_mut::<3, 1>(3, joint).copy_from(axis);
        }
        jacobian
    }

    /// The joint positions near `seed` that put a point fixed to the flange at `base_from_point`; `None` when the search
    /// does not converge, which out of reach and at singularities it does not.
    pub fn inverse(
        &self,
        base_from_point: &Isometry3<f64>,
        flange_from_point: &Isometry3<f64>,
        seed: &Joints,
    ) -> Option<Joints> {
        let mut joints = *seed;
        let mut damping = 1e-9;
        let mut error = twist_between(&(self.flange(&joints) * flange_from_point), base_from_point);
        for _ in 0..IK_ITERATIONS {
            if error.norm() < IK_TOLERANCE {
                return Some(joints);
            }
            let jacobian = self.jacobian(&joints, flange_from_point);
            let normal = jacobian * jacobian.transpose() + Matrix6::identity() * damping;
            let mut step = jacobian.transpose() * normal.cholesky()?.solve(&error);
            let largest = step.amax();
            if largest > IK_STEP_RAD {
                step *= IK_STEP_RAD / largest;
            }
            let mut moved = joints;
            moved
                .iter_mut()
                .zip(step.iter())
                .for_each(|(joint, change)| *joint += change);
            let error_moved =
                twist_between(&(self.flange(&moved) * flange_from_point), base_from_point);
            // Levenberg-Marquardt: trust the linear model more after every success, less after every failure.
            if error_moved.norm() < error.norm() {
                (joints, error) = (moved, error_moved);
                damping = (damping * 0.1).max(1e-12);
            } else {
                damping = (damping * 100.0).min(1e3);
            }
        }
        (error.norm() < IK_TOLERANCE * 10.0).then_some(joints)
    }

    pub(super) fn link(&self, joint: usize, angle_rad: f64) -> Isometry3<f64> {
        let turned =
            Rotation3::from_axis_angle(&Vector3::z_axis(), angle_rad + self.theta_rad[joint]);
        let offset =
            Translation3::from(turned * Vector3::new(self.a_m[joint], 0.0, self.d_m[joint]));
        let twisted = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha_rad[joint]);
        Isometry3::from_parts(
            offset,
            UnitQuaternion::from_rotation_matrix(&turned) * twisted,
        )
    }
}

/// Linear and angular distance in base axes.
pub fn twist_between(from: &Isometry3<f64>, to: &Isometry3<f64>) -> Vector6<f64> {
    let linear = to.translation.vector - from.translation.vector;
    let angular = (to.rotation * from.rotation.inverse()).scaled_axis();
    Vector6::new(
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    )
}

/// `from` moved along a twist in base axes.
pub fn moved(from: &Isometry3<f64>, twist: &Vector6<f64>) -> Isometry3<f64> {
    let linear = Vector3::new(twist[0], twist[1], twist[2]);
    let angular = Vector3::new(twist[3], twist[4], twist[5]);
    Isometry3::from_parts(
        Translation3::from(from.translation.vector + linear),
        UnitQuaternion::new_normalize(
            (UnitQuaternion::from_scaled_axis(angular) * from.rotation).into_inner(),
        ),
    )
}

/// A pose as URScript writes it, position and rotation vector.
pub fn from_pose(pose: &Joints) -> Isometry3<f64> {
    let [x, y, z, rx, ry, rz] = *pose;
    Isometry3::new(Vector3::new(x, y, z), Vector3::new(rx, ry, rz))
}

/// As URScript writes it.
pub fn to_pose(isometry: &Isometry3<f64>) -> Joints {
    let position = isometry.translation.vector;
    let rotation = isometry.rotation.scaled_axis();
    [
        position.x, position.y, position.z, rotation.x, rotation.y, rotation.z,
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_straight_arm_reaches_what_its_table_says() {
        let pose = UR5.flange(&[0.0; 6]).translation.vector;
        let expected = Vector3::new(-0.425 - 0.39225, -0.10915 - 0.0823, 0.089159 - 0.09465);
        assert!((pose - expected).norm() < 1e-12, "{pose}");
    }

    #[test]
    fn a_pose_out_of_reach_has_no_solution() {
        let far = Isometry3::translation(1.2, 0.0, 0.3);
        assert_eq!(
            UR5.inverse(
                &far,
                &Isometry3::identity(),
                &[0.1, -1.2, 1.3, -1.0, -1.5, 0.2]
            ),
            None
        );
    }

    proptest! {
        #[test]
        fn the_solution_near_a_seed_reproduces_its_pose(
            bend in proptest::array::uniform6(-0.1..0.1f64),
            elbow in 0.5..2.5f64,
            wrist in 0.5..2.5f64,
        ) {
            let truth = [0.3, -1.4, elbow, -1.2, wrist, 0.7];
            let tool = Isometry3::new(Vector3::new(0.0, 0.0, 0.31), Vector3::new(0.0, -FRAC_PI_2, 0.0));
            let target = UR5.flange(&truth) * tool;
            let seed = std::array::from_fn(|joint| truth[joint] + bend[joint]);
            let found = UR5.inverse(&target, &tool, &seed).unwrap();
            prop_assert!(twist_between(&(UR5.flange(&found) * tool), &target).norm() < 1e-9);
            prop_assert!(found.iter().zip(truth).all(|(found, truth)| (found - truth).abs() < 1e-6));
        }

        #[test]
        fn the_jacobian_is_the_derivative_of_the_pose(joints in proptest::array::uniform6(-3.0..3.0f64), which in 0..6usize) {
            let tool = Isometry3::translation(0.02, -0.03, 0.3);
            let step = 1e-6;
            let mut ahead = joints;
            ahead[which] += step;
            let difference = twist_between(&(UR5.flange(&joints) * tool), &(UR5.flange(&ahead) * tool)) / step;
            prop_assert!((difference - UR5.jacobian(&joints, &tool).column(which)).norm() < 1e-5);
        }
    }
}
