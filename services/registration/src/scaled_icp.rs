//! The paper's fine stage: iterative closest points with a clamped scale (Eq. 5-7).
//!
//! Pairs go from the model to the view, source to target, as the paper states them; a partial view then draws the scale
//! down to the clamp.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use nalgebra::{Matrix3, Rotation3};
use rayon::prelude::*;

use crate::model::Model;
use crate::neighbours::Neighbours;
use crate::pipeline::Iteration;
use crate::problem::{Pose, Problem};
use crate::scale::ScaleRange;

/// Iterations of the fine stage.
const ITERATIONS: u32 = 30;
/// Pairs farther apart than this do not count, units.
const GATE_UNITS: f64 = 3.0;

/// Eq. 5-7: every model point with its nearest view point, the closed form of the similarity, again and again.
pub fn refine(
    problem: &Problem,
    start: Pose,
    clamp: ScaleRange,
    state: &mut dyn FnMut(u32, Iteration),
) -> Pose {
    let Model {
        points: model,
        unit_mm,
        ..
    } = &problem.model;
    let view = &problem.view.dense.points;
    let tree = Neighbours::new(view);
    let mut view_from_ct = start.inverse();
    for iteration in 0..ITERATIONS {
        let gate_mm = GATE_UNITS * unit_mm * view_from_ct.scale;
        let pairs: Vec<(Point3, Point3)> = model
            .par_iter()
            .with_min_len(256)
            .filter_map(|point| {
                let near = tree.nearest_within(&(view_from_ct * *point), gate_mm * gate_mm)?;
                Some((*point, view[near.index]))
            })
            .collect();
        let squares = pairs
            .iter()
            .map(|(ct, camera)| (view_from_ct * *ct - camera).norm_squared());
        let mse_view_mm2 = squares.sum::<f64>() / pairs.len().max(1) as f64;
        state(
            iteration,
            Iteration {
                mse_mm2: mse_view_mm2 / view_from_ct.scale.powi(2),
                scale: view_from_ct.scale,
            },
        );
        match closed_form(&pairs, clamp) {
            Some(next) => {
                view_from_ct = Similarity::new(next.scale, next.rotation, next.translation_mm)
            }
            None => break,
        }
    }
    view_from_ct.inverse()
}

/// The similarity that best maps each pair's first point (ct) onto its second (camera), scale clamped: Eq. 5-7.
///
/// Umeyama 1991. `None` if the pairs do not span a plane.
pub fn closed_form(
    pairs: &[(Point3, Point3)],
    scale: ScaleRange,
) -> Option<Similarity<Camera, Ct>> {
    let count = pairs.len() as f64;
    let mean_ct = pairs.iter().map(|(ct, _)| ct.coords).sum::<Vector3>() / count;
    let mean_camera = pairs
        .iter()
        .map(|(_, camera)| camera.coords)
        .sum::<Vector3>()
        / count;
    let mut covariance = Matrix3::zeros();
    let mut variance = 0.0;
    for (ct, camera) in pairs {
        let (ct, camera) = (ct.coords - mean_ct, camera.coords - mean_camera);
        covariance += camera * ct.transpose();
        variance += ct.norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (u, v_transposed) = (svd.u?, svd.v_t?);
    if svd.singular_values[1] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    // A reflection fits a flat cloud as well as a rotation: the least axis gives way.
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    signs[svd.singular_values.imin()] = (u * v_transposed).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&signs) * v_transposed;
    let rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let scale = scale.clamp(svd.singular_values.dot(&signs) / variance);
    Some(Similarity::new(
        scale,
        rotation,
        mean_camera - rotation * mean_ct * scale,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_closed_form_recovers_a_known_similarity(
            scale in 0.5..2.0f64,
            axis in prop::array::uniform3(-3.0..3.0f64),
            shift in prop::array::uniform3(-300.0..300.0f64),
            points in prop::collection::vec(prop::array::uniform3(-20.0..20.0f64), 6..30),
        ) {
            let truth = Similarity::<Camera, Ct>::new(
                scale, Rotation::from_scaled_axis(Vector3::from(axis)), Vector3::from(shift));
            let pairs: Vec<_> = points.iter().map(|p| Point3::from(*p)).map(|p| (p, truth * p)).collect();
            let found = closed_form(&pairs, ScaleRange { low: 0.1, high: 10.0 }).unwrap();
            prop_assert!((found.scale - truth.scale).abs() < 1e-9);
            prop_assert!(found.rotation.angle_to(&truth.rotation) < 1e-6);
            prop_assert!((found.translation_mm - truth.translation_mm).norm() < 1e-6);
        }
    }

    #[test]
    fn the_closed_form_keeps_the_scale_in_its_range() {
        let points = [
            [0.0, 0.0, 0.0],
            [9.0, 0.0, 0.0],
            [0.0, 7.0, 0.0],
            [1.0, 2.0, 5.0],
        ];
        let pairs: Vec<_> = points
            .iter()
            .map(|p| Point3::from(*p))
            .map(|p| (p, p * 2.0))
            .collect();
        let found = closed_form(
            &pairs,
            ScaleRange {
                low: 0.98,
                high: 1.02,
            },
        )
        .unwrap();
        assert_eq!(found.scale, 1.02);
    }

    #[test]
    fn pairs_on_a_line_have_no_closed_form() {
        let pairs: Vec<_> = (0..9)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .map(|p| (p, p))
            .collect();
        assert!(closed_form(&pairs, ScaleRange::only(1.0)).is_none());
    }
}
