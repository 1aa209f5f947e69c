//! The normal of a surface at a pixel, from the pixels around.
//!
//! The plane n·p = 1 is linear in inverse depth, m·ray = 1 / z, and that is where a stereo camera's noise is the same
//! everywhere: least squares there is the best fit, weighted by the law, and gives the normal's uncertainty with it.

use arthro_geometry::Vector3;
use arthro_geometry::nalgebra::{Matrix3, Vector2};

use super::{Patch, SIGNIFICANT, UNKNOWN_NORMAL_RAD};

/// Neighbouring pixels whose depths differ by more than this fraction lie on different surfaces.
const JUMP: f64 = 0.01;
/// Fewest pixels that a normal is fitted to.
const MIN_NEIGHBOURS: usize = 5;
/// Least determinant of the fit in pixels; neighbours in one line have 0, five around a corner 5 or more.
const MIN_DETERMINANT: f64 = 0.5;

impl Patch<'_> {
    /// Normal of the plane through the pixels around, towards the camera, and its uncertainty.
    pub(super) fn normal(
        &self,
        column: i64,
        row: i64,
        depth_mm: f64,
        reach: i64,
    ) -> Option<(Vector3, f64)> {
        let middle = (row * self.width + column) as usize;
        let (ray, sigma_mm) = (self.rays[middle], self.sigmas_mm[middle]);
        let step_mm = (JUMP * depth_mm).max(SIGNIFICANT * sigma_mm);
        // In pixels from the middle, so that the numbers are of one size; the middle has weight 1.
        let focal = Vector2::new(self.lens.intrinsics().fx_px, self.lens.intrinsics().fy_px);
        let weight = |depth_mm: f64, sigma_mm: f64| (depth_mm * depth_mm / sigma_mm).powi(2);
        let whole = weight(depth_mm, sigma_mm);
        let (mut squares, mut right, mut count) = (Matrix3::zeros(), Vector3::zeros(), 0);
        for y in row - reach..=row + reach {
            for x in column - reach..=column + reach {
                let Some(other_mm) = self.depth_mm(x, y) else {
                    continue;
                };
                if (other_mm - depth_mm).abs() >= step_mm {
                    continue;
                }
                let place = (y * self.width + x) as usize;
                let aside = (self.rays[place] - ray).component_mul(&focal).push(1.0);
                let weighted = aside * (weight(other_mm, self.sigmas_mm[place]) / whole);
                squares += weighted * aside.transpose();
                right += weighted / other_mm;
                count += 1;
            }
        }
        if count < MIN_NEIGHBOURS || squares.determinant() < MIN_DETERMINANT {
            return None;
        }
        let inverse = squares.try_inverse()?;
        let back = Matrix3::from_columns(&[
            Vector3::new(focal.x, 0.0, -focal.x * ray.x),
            Vector3::new(0.0, focal.y, -focal.y * ray.y),
            Vector3::z(),
        ]);
        let plane = back * inverse * right;
        let normal = -plane.normalize();
        let across = Matrix3::identity() - normal * normal.transpose();
        let covariance = back * inverse * back.transpose() / whole;
        let sigma_rad = (across * covariance * across).trace().sqrt() / plane.norm();
        (plane.dot(&ray.push(1.0)) > 0.0).then_some((normal, sigma_rad.min(UNKNOWN_NORMAL_RAD)))
    }
}
