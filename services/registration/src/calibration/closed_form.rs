//! The classical closed forms that a joint refinement starts from, each as published.

pub mod daniilidis;
pub mod park;
pub mod shah;

use arthro_geometry::Rotation;
use arthro_geometry::nalgebra::{Isometry3, Matrix3, Rotation3};

/// A pair of relative motions of the two bodies that a rigid link couples: `a X = X b`.
#[derive(Clone, Copy, Debug)]
pub struct MotionPair {
    /// Motion of the body that `X` maps into.
    pub a: Isometry3<f64>,
    /// The same motion, of the body that `X` maps from.
    pub b: Isometry3<f64>,
}

/// The rotation nearest to a matrix.
pub(super) fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Rotation> {
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut upright = Matrix3::identity();
    upright[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = Rotation3::from_matrix_unchecked(u * upright * v_t);
    Some(Rotation::from_rotation_matrix(&rotation))
}
