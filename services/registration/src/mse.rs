//! Eq. 15 of the paper: mean squared closest-point distance after registration.
//!
//! It pairs every view point with its nearest place on the model's surface; the nearest nine tenths of the pairs count,
//! since the rest may be strays. A residual, not a target error: a pose turned by half can score as well as the right one.

use crate::evidence::residuals_mm;
use crate::problem::{Pose, Problem};
use crate::view::Seen;

/// Share of the pairs, the nearest ones, that count.
const MATCHED_SHARE: f64 = 0.9;

/// Eq. 15 over `seen`, mm2 of the model; 0 for an empty view.
pub fn mean_squared_error(problem: &Problem, seen: &Seen, pose: &Pose) -> f64 {
    trimmed_mean_square(residuals_mm(problem, seen, pose))
}

/// Mean square of the nearest nine tenths.
pub fn trimmed_mean_square(mut residuals_mm: Vec<f64>) -> f64 {
    residuals_mm.sort_by(f64::total_cmp);
    residuals_mm.truncate((residuals_mm.len() as f64 * MATCHED_SHARE).ceil() as usize);
    residuals_mm.iter().map(|r| r * r).sum::<f64>() / residuals_mm.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_stray_points_does_not_count() {
        let mut residuals = vec![0.5; 400];
        residuals[..40].fill(80.0);
        assert_eq!(trimmed_mean_square(residuals.clone()), 0.25);
        residuals[40] = 80.0;
        assert!(trimmed_mean_square(residuals) > 10.0);
    }
}
