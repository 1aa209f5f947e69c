//! One point-to-plane step: Gauss-Newton over rotation, translation and scale, Tukey's weights, scale clamped.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::{SMatrix, SVector};
use arthro_geometry::{Rotation, Similarity, Vector3};

use super::{Pairs, ScaleRange};
use crate::sampling::median;
use crate::surface::Surface;

/// Residuals beyond this many standard deviations weigh nothing (Tukey's constant).
const TUKEY: f64 = 4.685;

/// Residuals of this many neighbouring points err alike (voxel stairs, sensor patches) and count as one.
const NEIGHBOURS_ALIKE: f64 = 25.0;

type Jacobian = SVector<f64, 7>;

/// The pose after one step; the residuals' standard deviation is taken as no less than `least_deviation_mm`.
///
/// `None` if the pairs do not determine it.
pub(super) fn step(
    model: &Surface,
    pairs: &Pairs,
    ct_from_camera: &Similarity<Ct, Camera>,
    scale: ScaleRange,
    least_deviation_mm: f64,
) -> Option<Similarity<Ct, Camera>> {
    let centre =
        pairs.carried.iter().map(|p| p.coords).sum::<Vector3>() / pairs.carried.len() as f64;
    let rows: Vec<(Jacobian, f64)> = pairs
        .kept()
        .map(|(index, foot)| {
            let normal = model.normals[foot.index];
            let arm = pairs.carried[index].coords - centre;
            let turn = arm.cross(&normal);
            let row = Jacobian::from([
                turn.x,
                turn.y,
                turn.z,
                normal.x,
                normal.y,
                normal.z,
                arm.dot(&normal),
            ]);
            (
                row,
                normal.dot(&(pairs.carried[index] - model.points[foot.index])),
            )
        })
        .collect();

    let mut sizes: Vec<f64> = rows.iter().map(|(_, residual)| residual.abs()).collect();
    let deviation_mm = (1.4826 * median(&mut sizes)).max(least_deviation_mm);
    let reach = TUKEY * deviation_mm;
    let mut normal_matrix = SMatrix::<f64, 7, 7>::zeros();
    let mut gradient = Jacobian::zeros();
    for (row, residual) in &rows {
        let inside = 1.0 - (residual / reach).powi(2);
        if inside > 0.0 {
            let weight = inside * inside;
            normal_matrix.ger(weight, row, row, 1.0);
            gradient.axpy(weight * residual, row, 1.0);
        }
    }
    // What is known of the scale beforehand counts like one more residual: a small view trades it against arc length.
    let (expected, spread) = scale.expectation();
    if spread > 0.0 {
        let weight = NEIGHBOURS_ALIKE * (deviation_mm / spread).powi(2);
        normal_matrix[(6, 6)] += weight;
        gradient[6] += weight * (ct_from_camera.scale.ln() + expected);
    }
    // A whiff of damping, in mm2 of the weighted sum, keeps a direction that nothing holds from running away.
    normal_matrix += SMatrix::<f64, 7, 7>::identity() * (1e-6 * normal_matrix.trace());

    let free = normal_matrix.cholesky()?.solve(&-gradient);
    let wanted = ct_from_camera.scale * free[6].exp();
    let allowed = 1.0 / scale.clamp(1.0 / wanted);
    let delta = if (allowed / wanted - 1.0).abs() < 1e-12 {
        free
    } else {
        held_at(
            (allowed / ct_from_camera.scale).ln(),
            &normal_matrix,
            &gradient,
        )?
    };

    let turn = Rotation::from_scaled_axis(delta.fixed_rows::<3>(0).into_owned());
    let shift: Vector3 = delta.fixed_rows::<3>(3).into_owned();
    let stretch = delta[6].exp();
    // q' = c + e^k R (q - c) + d
    let step = Similarity::<Ct, Ct>::new(stretch, turn, centre + shift - turn * centre * stretch);
    Some(step * *ct_from_camera)
}

/// The step with its logarithm of scale held at `stretch`: the other six are solved for.
fn held_at(
    stretch: f64,
    normal_matrix: &SMatrix<f64, 7, 7>,
    gradient: &Jacobian,
) -> Option<Jacobian> {
    let six = normal_matrix.fixed_view::<6, 6>(0, 0).into_owned();
    let right = -(gradient.fixed_rows::<6>(0) + normal_matrix.fixed_view::<6, 1>(0, 6) * stretch);
    let solved = six.cholesky()?.solve(&right);
    let mut delta = Jacobian::zeros();
    delta.fixed_rows_mut::<6>(0).copy_from(&solved);
    delta[6] = stretch;
    Some(delta)
}
