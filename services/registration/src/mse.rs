//! Eq. 15 of the paper: mean squared closest-point distance after registration.
//!
//! It pairs every view point with its nearest model point; the nearest nine tenths of the pairs count, since the rest
//! may be stray points. A closest-point residual, not a target error: a pose turned by half can score as well as the right one.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Similarity};
use rayon::prelude::*;

use crate::surface::{Matching, Surface};

/// Share of the pairs, the nearest ones, that count.
pub const MATCHED_SHARE: f64 = 0.9;

/// Eq. 15 in mm2 of the camera frame; 0 for an empty view.
pub fn mean_squared_error(
    model: &Surface,
    view: &[Point3],
    ct_from_camera: &Similarity<Ct, Camera>,
) -> f64 {
    let mut squares: Vec<f64> = view
        .par_iter()
        .with_min_len(256)
        .map(|point| {
            model
                .foot(&(*ct_from_camera * *point), Matching::Exact)
                .distance2
        })
        .collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate((squares.len() as f64 * MATCHED_SHARE).ceil() as usize);
    let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    mean / ct_from_camera.scale.powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_stray_points_does_not_count() {
        let sheet = |z: f64| -> Vec<Point3> {
            (0..400)
                .map(|i| Point3::new(f64::from(i % 20), f64::from(i / 20), z))
                .collect()
        };
        let model = Surface::new(&sheet(0.0), 400);
        let mut view = sheet(0.5);
        for stray in view.iter_mut().take(39) {
            stray.z = 80.0;
        }
        let mse = mean_squared_error(&model, &view, &Similarity::identity());
        assert!((mse - 0.25).abs() < 1e-9, "{mse}");
        let doubled = Similarity::<Camera, Ct>::new(
            2.0,
            arthro_geometry::Rotation::identity(),
            arthro_geometry::Vector3::zeros(),
        );
        let far: Vec<Point3> = view.iter().map(|p| doubled * *p).collect();
        let mse = mean_squared_error(&model, &far, &doubled.inverse());
        assert!((mse - 1.0).abs() < 1e-9, "{mse}");
    }
}
