//! How far a set of poses turns: what makes a calibration determinate, whatever its residual says.

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Rotation, Vector3};

/// The turning of a set of poses against each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Largest turn between any two poses, rad.
    pub widest_rad: f64,
    /// Largest part of any turn across the main axis, rad: 0 when all turns share one axis.
    pub across_rad: f64,
}

impl Span {
    /// Of these rotations.
    pub fn of(rotations: &[Rotation]) -> Self {
        let turns = || {
            rotations.iter().enumerate().flat_map(|(index, first)| {
                rotations[index + 1..]
                    .iter()
                    .map(move |second| (first.inverse() * second).scaled_axis())
            })
        };
        let scatter: Matrix3<f64> = turns().map(|turn| turn * turn.transpose()).sum();
        let eigen = SymmetricEigen::new(scatter);
        let main: Vector3 = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imax())
            .into_owned();
        let across = |turn: Vector3| (turn - main * main.dot(&turn)).norm();
        Self {
            widest_rad: turns().map(|turn| turn.norm()).fold(0.0, f64::max),
            across_rad: turns().map(across).fold(0.0, f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_about_one_axis_have_nothing_across_it() {
        let axis = Vector3::new(1.0, 2.0, -0.5).normalize();
        let turned = |angle: f64| Rotation::from_scaled_axis(axis * angle);
        let span = Span::of(&[0.0, 0.3, 0.7].map(turned));
        assert!((span.widest_rad - 0.7).abs() < 1e-12);
        assert!(span.across_rad < 1e-12, "{span:?}");
    }

    #[test]
    fn turns_about_two_axes_span_both() {
        let span = Span::of(&[
            Rotation::identity(),
            Rotation::from_scaled_axis(Vector3::x() * 0.8),
            Rotation::from_scaled_axis(Vector3::y() * 0.4),
        ]);
        assert!(span.across_rad > 0.3, "{span:?}");
    }

    #[test]
    fn a_single_pose_spans_nothing() {
        let span = Span::of(&[Rotation::identity()]);
        assert_eq!((span.widest_rad, span.across_rad), (0.0, 0.0));
    }
}
