//! The sum of squared distances to planes, as a quadratic form of the point.

use std::ops::{Add, AddAssign};

use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::{Point3, Vector3};

/// How strongly a merged vertex is held near the middle of its edge where the planes leave it free, as a share of
/// what they hold it with across.
const HOLD: f64 = 1e-3;

/// x^T A x - 2 b^T x + c, mm2.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadric {
    a: Matrix3<f64>,
    b: Vector3,
    c: f64,
}

impl Quadric {
    /// The plane of a triangle; nothing for a triangle without area.
    pub(super) fn of_plane([a, b, c]: &[Point3; 3]) -> Self {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
            return Self::default();
        };
        let offset = normal.dot(&a.coords);
        Self {
            a: normal * normal.transpose(),
            b: normal * offset,
            c: offset * offset,
        }
    }

    /// Sum of squared distances of `point`, mm2.
    pub(super) fn error2(&self, point: &Point3) -> f64 {
        let x = &point.coords;
        (x.dot(&(self.a * x)) - 2.0 * self.b.dot(x) + self.c).max(0.0)
    }

    /// The point with the least error; where the planes do not hold it, the one nearest to `middle`.
    pub(super) fn best_near(&self, middle: &Point3) -> Point3 {
        let hold = HOLD * self.a.trace();
        let held = self.a + Matrix3::from_diagonal_element(hold);
        let away = self.b - self.a * middle.coords;
        match held.cholesky() {
            Some(factored) => middle + factored.solve(&away),
            None => *middle,
        }
    }
}

impl Default for Quadric {
    fn default() -> Self {
        Self {
            a: Matrix3::zeros(),
            b: Vector3::zeros(),
            c: 0.0,
        }
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            a: self.a + other.a,
            b: self.b + other.b,
            c: self.c + other.c,
        }
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_point_of_three_planes_is_near_their_corner_and_without_error() {
        let corner = Point3::new(3.0, -2.0, 5.0);
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let quadric = [0, 1, 2]
            .map(|i| Quadric::of_plane(&[corner, corner + axes[i], corner + axes[(i + 1) % 3]]))
            .into_iter()
            .fold(Quadric::default(), Add::add);
        let best = quadric.best_near(&Point3::new(3.4, -2.2, 5.1));
        assert!((best - corner).norm() < 2e-3);
        assert!(quadric.error2(&best) < 1e-5);
        assert!((quadric.error2(&Point3::new(4.0, 0.0, 8.0)) - 14.0).abs() < 1e-9);
    }

    #[test]
    fn a_single_plane_leaves_the_point_above_the_middle() {
        let plane = [
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ];
        let best = Quadric::of_plane(&plane).best_near(&Point3::new(7.0, 8.0, 0.5));
        assert!((best - Point3::new(7.0, 8.0, 0.0)).norm() < 1e-3);
    }
}
