//! Shah, "Solving the Robot-World/Hand-Eye Calibration Problem Using the Kronecker Product", 2013: both unknowns of
//! `A X = Z B` at once, without pairing poses.

use arthro_geometry::Rotation;
use arthro_geometry::nalgebra::{
    Isometry3, Matrix3, Matrix6, SMatrix, SVector, Translation3, Vector6,
};

use super::nearest_rotation;

/// `X` and `Z` of `A X = Z B`; `None` when the poses do not determine them.
pub fn solve(poses: &[(Isometry3<f64>, Isometry3<f64>)]) -> Option<[Isometry3<f64>; 2]> {
    let mut kronecker = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in poses {
        let (a, b) = (matrix(&a.rotation), matrix(&b.rotation));
        kronecker += b.kronecker(&a);
    }
    let svd = kronecker.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let largest = svd.singular_values.imax();
    let z = rotation(&u.column(largest).into_owned())?;
    let x = rotation(&v_t.row(largest).transpose())?;
    let mut information = Matrix6::zeros();
    let mut moment = Vector6::zeros();
    for (a, b) in poses {
        // [R_a, -I] [t_x; t_z] = R_z t_b - t_a
        let mut by = SMatrix::<f64, 3, 6>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&matrix(&a.rotation));
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-Matrix3::identity());
        let displacement = z * b.translation.vector - a.translation.vector;
        information += by.transpose() * by;
        moment += by.transpose() * displacement;
    }
    let translations = information.cholesky()?.solve(&moment);
    let pose = |first: usize, rotation: Rotation| {
        let translation = translations.fixed_rows::<3>(first).into_owned();
        Isometry3::from_parts(Translation3::from(translation), rotation)
    };
    Some([pose(0, x), pose(3, z)])
}

fn matrix(rotation: &Rotation) -> Matrix3<f64> {
    rotation.to_rotation_matrix().into_inner()
}

/// The rotation that a singular vector stands for, column by column; its sign is the one of a right-handed frame.
fn rotation(vector: &SVector<f64, 9>) -> Option<Rotation> {
    let matrix = Matrix3::from_column_slice(vector.as_slice());
    nearest_rotation(&(matrix * matrix.determinant().signum()))
}
