//! How well a pose is measured, as standard deviations or a covariance.
//!
//! The error of a pose is six numbers: a rotation vector (rad), then a displacement (mm), both in the axes of the
//! frame that the pose maps into: the true rotation is `exp(rotation vector) * R`, the true translation
//! `t + displacement`.

use arthro_geometry::nalgebra::{Isometry3, Matrix3, Matrix6};
use arthro_geometry::{Point3, Vector3};

/// Covariance of a pose's error: rad2, rad mm and mm2.
pub type PoseCovariance = Matrix6<f64>;

/// Standard deviations of a measured pose, the same in every direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseNoise {
    /// About each axis, rad.
    pub rotation_rad: f64,
    /// Along each axis, mm.
    pub translation_mm: f64,
}

impl PoseNoise {
    /// As a covariance.
    pub fn covariance(&self) -> PoseCovariance {
        let rotation = Matrix3::identity() * self.rotation_rad.powi(2);
        let translation = Matrix3::identity() * self.translation_mm.powi(2);
        blocks(
            &rotation,
            &Matrix3::zeros(),
            &Matrix3::zeros(),
            &translation,
        )
    }
}

/// How far a point that a pose maps may be off: its covariance in the axes of the frame that the pose maps into, mm2.
///
/// A small error moves `R p + t` by the displacement plus rotation vector x `R p`.
pub fn point_covariance(
    pose: &Isometry3<f64>,
    covariance: &PoseCovariance,
    point: &Point3,
) -> Matrix3<f64> {
    let lever = (pose.rotation * point.coords).cross_matrix();
    let rotation = covariance.fixed_view::<3, 3>(0, 0);
    let mixed = covariance.fixed_view::<3, 3>(0, 3);
    let translation = covariance.fixed_view::<3, 3>(3, 3);
    let crossed = lever * mixed;
    translation - crossed - crossed.transpose() + lever * rotation * lever.transpose()
}

/// Covariance of the inverse of a pose.
pub(super) fn inverted(pose: &Isometry3<f64>, covariance: &PoseCovariance) -> PoseCovariance {
    let turned_back = pose.rotation.inverse().to_rotation_matrix().into_inner();
    let lever = pose.translation.vector.cross_matrix();
    let by = blocks(
        &-turned_back,
        &Matrix3::zeros(),
        &(-turned_back * lever),
        &-turned_back,
    );
    by * covariance * by.transpose()
}

/// Root of the summed variances: the expected distance from the truth, root mean square.
pub(super) fn deviation(covariance: &Matrix3<f64>) -> f64 {
    covariance.trace().max(0.0).sqrt()
}

/// Root mean square.
pub(super) fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0_u32, 0.0), |(count, sum), value| {
        (count + 1, sum + value * value)
    });
    (sum / f64::from(count.max(1))).sqrt()
}

/// A matrix of six by six from four of three by three.
pub(super) fn blocks(
    upper_left: &Matrix3<f64>,
    upper_right: &Matrix3<f64>,
    lower_left: &Matrix3<f64>,
    lower_right: &Matrix3<f64>,
) -> Matrix6<f64> {
    let mut whole = Matrix6::zeros();
    whole.fixed_view_mut::<3, 3>(0, 0).copy_from(upper_left);
    whole.fixed_view_mut::<3, 3>(0, 3).copy_from(upper_right);
    whole.fixed_view_mut::<3, 3>(3, 0).copy_from(lower_left);
    whole.fixed_view_mut::<3, 3>(3, 3).copy_from(lower_right);
    whole
}

/// A pose moved by an error.
pub(super) fn moved(
    pose: &Isometry3<f64>,
    rotation_rad: Vector3,
    displacement_mm: Vector3,
) -> Isometry3<f64> {
    let mut moved = *pose;
    moved.translation.vector += displacement_mm;
    moved.rotation = arthro_geometry::Rotation::new_normalize(
        (arthro_geometry::Rotation::from_scaled_axis(rotation_rad) * pose.rotation).into_inner(),
    );
    moved
}
