//! Lens distortion after Brown and Conrady, and its inverse, where it has one.
//!
//! The polynomial of OpenCV (`calib3d`, k1 k2 p1 p2 k3), on normalized coordinates x = (x, y), r = |x|, q = (p2, p1):
//!
//! ```text
//! D(x) = (1 + k1 r² + k2 r⁴ + k3 r⁶) x + r² q + 2 (q·x) x
//! ```
//!
//! D is the gradient of a potential, so its Jacobian is symmetric, with eigenvalues of at least
//! `min(1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶, 1 + k1 r² + k2 r⁴ + k3 r⁶) - 6 |q| r`. Where that is positive on a disc, the
//! potential is strictly convex there: D is one-to-one on the disc, and the image of a disc of radius R covers at least
//! the disc of radius `R (1 + k1 R² + k2 R⁴ + k3 R⁶) - 3 |q| R²`. Both are evaluated as bounds over intervals, so that
//! what is accepted can be inverted, and nothing has to be tried out pixel by pixel.

use arthro_geometry::nalgebra::{Matrix2, Vector2};

/// What the lens does to a normalized coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Nothing: a rectified image.
    None,
    /// The polynomial distorts: it takes a ray to where its pixel is. OpenCV's meaning.
    BrownConrady(Coefficients),
    /// The polynomial undistorts: it takes a pixel to its ray.
    InverseBrownConrady(Coefficients),
}

/// Coefficients of the polynomial, in OpenCV's order.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficients {
    /// Radial, second order.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
    /// Radial, sixth order.
    pub k3: f64,
}

/// The disc on which a polynomial is one-to-one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Extent {
    /// Its radius, normalized.
    pub(super) radius: f64,
    /// Radius of a disc that its image covers.
    pub(super) covered: f64,
}

/// Least local magnification: where a lens shrinks more, neighbouring rays share a pixel.
const MIN_STRETCH: f64 = 0.05;
/// Intervals to the radius that is asked for.
const INTERVALS: f64 = 512.0;
/// No ray leaves farther from the axis than this many times the radius of its pixel.
const MAX_EXPANSION: f64 = 8.0;
/// Newton converges in 3 to 6 steps.
const MAX_STEPS: usize = 50;
/// Halvings of a step before it is given up.
const MAX_HALVINGS: usize = 30;
/// An inverse is exact to this much, normalized: below 1e-9 px for any lens.
const TOLERANCE: f64 = 1e-13;

impl Coefficients {
    /// The coefficients by name.
    pub fn named(&self) -> [(&'static str, f64); 5] {
        [
            ("k1", self.k1),
            ("k2", self.k2),
            ("p1", self.p1),
            ("p2", self.p2),
            ("k3", self.k3),
        ]
    }

    /// The polynomial at `x`.
    pub fn map(&self, x: &Vector2<f64>) -> Vector2<f64> {
        let q = self.tangential();
        x * self.radial(x.norm_squared()) + q * x.norm_squared() + x * (2.0 * q.dot(x))
    }

    /// Where the polynomial takes to `target`, within `limit` of the axis, on whose disc it must be one-to-one.
    /// `None` if there is no such place.
    pub(super) fn inverse(&self, target: &Vector2<f64>, limit: f64) -> Option<Vector2<f64>> {
        let within = |x: Vector2<f64>| x * (limit / x.norm()).min(1.0);
        // 0 / 0 on the axis, where the polynomial changes nothing.
        if target.norm() == 0.0 {
            return Some(*target);
        }
        let mut x = within(*target);
        let mut residual = self.map(&x) - target;
        for _ in 0..MAX_STEPS {
            if residual.norm() <= TOLERANCE * (1.0 + target.norm()) {
                return Some(x);
            }
            let step = self.jacobian(&x).try_inverse()? * residual;
            let shorter = (0..MAX_HALVINGS).find_map(|halvings| {
                let tried = x - step * 0.5f64.powi(halvings as i32);
                let left = self.map(&tried) - target;
                (tried.norm() <= limit && left.norm() < residual.norm()).then_some((tried, left))
            });
            (x, residual) = shorter?;
        }
        None
    }

    /// The disc on which the polynomial is one-to-one, looked for outwards from the axis in steps of a small part of
    /// `asked` until it is `enough` or cannot grow.
    pub(super) fn extent(&self, asked: f64, enough: impl Fn(&Extent) -> bool) -> Extent {
        let mut extent = Extent {
            radius: 0.0,
            covered: 0.0,
        };
        for interval in 1..=(MAX_EXPANSION * INTERVALS) as u32 {
            let next = asked * f64::from(interval) / INTERVALS;
            let stretch = self.least_stretch(extent.radius, next);
            // What is no number is in no range.
            if enough(&extent) || !(MIN_STRETCH..).contains(&stretch) {
                break;
            }
            extent = Extent {
                radius: next,
                covered: next * self.radial(next * next)
                    - 3.0 * self.tangential().norm() * next * next,
            };
        }
        extent
    }

    /// Lower bound of the Jacobian's eigenvalues between two radii.
    fn least_stretch(&self, inner: f64, outer: f64) -> f64 {
        let [inner2, outer2] = [inner * inner, outer * outer];
        let least = |coefficient: f64, power: i32| {
            coefficient * if coefficient < 0.0 { outer2 } else { inner2 }.powi(power)
        };
        let bound = |[a, b, c]: [f64; 3]| {
            1.0 + least(a * self.k1, 1) + least(b * self.k2, 2) + least(c * self.k3, 3)
        };
        let radial = bound([3.0, 5.0, 7.0]).min(bound([1.0; 3]));
        radial - 6.0 * self.tangential().norm() * outer
    }

    fn radial(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
    }

    fn tangential(&self) -> Vector2<f64> {
        Vector2::new(self.p2, self.p1)
    }

    fn jacobian(&self, x: &Vector2<f64>) -> Matrix2<f64> {
        let (r2, q) = (x.norm_squared(), self.tangential());
        let growth = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3);
        Matrix2::identity() * (self.radial(r2) + 2.0 * q.dot(x))
            + x * x.transpose() * (2.0 * growth)
            + (x * q.transpose() + q * x.transpose()) * 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn coefficients() -> impl Strategy<Value = Coefficients> {
        (
            -0.6..0.6f64,
            -0.6..0.6f64,
            -0.02..0.02f64,
            -0.02..0.02f64,
            -0.6..0.6f64,
        )
            .prop_map(|(k1, k2, p1, p2, k3)| Coefficients { k1, k2, p1, p2, k3 })
    }

    fn place() -> impl Strategy<Value = Vector2<f64>> {
        (-0.8..0.8f64, -0.8..0.8f64).prop_map(|(x, y)| Vector2::new(x, y))
    }

    #[test]
    fn the_polynomial_is_that_of_opencv() {
        let lens = Coefficients {
            k1: 0.1,
            k2: -0.2,
            p1: 0.003,
            p2: -0.004,
            k3: 0.05,
        };
        let (x, y) = (0.4, -0.3);
        let r2: f64 = x * x + y * y;
        let radial = 1.0 + 0.1 * r2 - 0.2 * r2 * r2 + 0.05 * r2 * r2 * r2;
        let expected = Vector2::new(
            x * radial + 2.0 * 0.003 * x * y - 0.004 * (r2 + 2.0 * x * x),
            y * radial + 0.003 * (r2 + 2.0 * y * y) - 2.0 * 0.004 * x * y,
        );
        assert!((lens.map(&Vector2::new(x, y)) - expected).norm() < 1e-15);
    }

    #[test]
    fn a_lens_that_folds_is_one_to_one_only_inside_the_fold() {
        // r - r³ turns at r = 1 / √3 = 0.577, where it is 0.385.
        let folding = Coefficients {
            k1: -1.0,
            ..Coefficients::default()
        };
        let extent = folding.extent(1.0, |_| false);
        assert!((0.55..0.5774).contains(&extent.radius), "{extent:?}");
        assert!((0.38..0.3850).contains(&extent.covered), "{extent:?}");
        assert_eq!(
            folding.inverse(&Vector2::new(0.39, 0.0), extent.radius),
            None
        );
    }

    proptest! {
        #[test]
        fn the_jacobian_is_the_slope_of_the_polynomial(lens in coefficients(), x in place()) {
            let h = 1e-6;
            for axis in 0..2 {
                let mut aside = Vector2::zeros();
                aside[axis] = h;
                let slope = (lens.map(&(x + aside)) - lens.map(&(x - aside))) / (2.0 * h);
                prop_assert!((slope - lens.jacobian(&x).column(axis)).norm() < 1e-8);
            }
        }

        #[test]
        fn the_bound_on_the_stretch_holds(lens in coefficients(), x in place()) {
            let least = lens.jacobian(&x).symmetric_eigenvalues().min();
            prop_assert!(lens.least_stretch(x.norm() * 0.99, x.norm() * 1.01) <= least + 1e-12);
        }

        #[test]
        fn every_place_the_disc_covers_has_its_inverse(
            lens in coefficients(), asked in 0.05..2.0f64, turn in 0.0..6.3f64, share in 0.0..1.0f64
        ) {
            let extent = lens.extent(asked, |extent| extent.covered >= asked);
            let target = Vector2::new(turn.cos(), turn.sin()) * extent.covered.max(0.0) * share;
            let place = lens.inverse(&target, extent.radius);
            prop_assert!(place.is_some(), "{extent:?} {target}");
            prop_assert!((lens.map(&place.unwrap()) - target).norm() < 1e-12);
        }
    }
}
