//! Park and Martin, "Robot Sensor Calibration: Solving AX=XB on the Euclidean Group", 1994: rotation first, from the
//! logarithms of the motions, then translation.

use arthro_geometry::Vector3;
use arthro_geometry::nalgebra::{Isometry3, Matrix3, Translation3};

use super::{MotionPair, nearest_rotation};

/// `X` of `a X = X b`; `None` when the motions do not determine it.
pub fn solve(pairs: &[MotionPair]) -> Option<Isometry3<f64>> {
    // The logarithms are the rotation vectors: alpha = R beta, so R maximises the trace of R M.
    let moment: Matrix3<f64> = pairs
        .iter()
        .map(|pair| pair.a.rotation.scaled_axis() * pair.b.rotation.scaled_axis().transpose())
        .sum();
    let rotation = nearest_rotation(&moment)?;
    let mut information = Matrix3::zeros();
    let mut moment = Vector3::zeros();
    for pair in pairs {
        // (R_a - I) t = R t_b - t_a
        let by = pair.a.rotation.to_rotation_matrix().into_inner() - Matrix3::identity();
        let displacement = rotation * pair.b.translation.vector - pair.a.translation.vector;
        information += by.transpose() * by;
        moment += by.transpose() * displacement;
    }
    let translation = information.cholesky()?.solve(&moment);
    Some(Isometry3::from_parts(
        Translation3::from(translation),
        rotation,
    ))
}
