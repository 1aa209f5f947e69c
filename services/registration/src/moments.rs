//! How the points around a place are spread: their mean and their covariance, and the plane that fits them best.

use arthro_geometry::{Point3, Vector3};
use nalgebra::{Matrix3, SymmetricEigen};

use crate::cells::Cells;

/// Moments of the points within a radius of a place.
#[derive(Clone, Copy, Debug)]
pub struct Moments {
    /// How many points.
    pub count: f64,
    /// From the place to their mean, mm.
    pub mean: Vector3,
    /// About their mean, mm2.
    pub covariance: Matrix3<f64>,
}

/// The plane through the mean of some points.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    /// Unit normal; its sign is arbitrary.
    pub normal: Vector3,
    /// Root mean square distance of the points from it, mm.
    pub deviation_mm: f64,
}

impl Moments {
    /// Of those of `points`, sorted into `cells`, that lie within `radius_mm` of `at`; `None` if there is none.
    pub fn around(at: &Point3, points: &[Point3], cells: &Cells, radius_mm: f64) -> Option<Self> {
        let (mut count, mut sum, mut squares) = (0.0, Vector3::zeros(), Matrix3::zeros());
        cells.within(at, radius_mm, |other, _| {
            let offset = points[other] - at;
            count += 1.0;
            sum += offset;
            squares.ger(1.0, &offset, &offset, 1.0);
        });
        let mean = sum / count;
        (count > 0.0).then(|| Self {
            count,
            mean,
            covariance: squares / count - mean * mean.transpose(),
        })
    }

    /// The plane in which they spread most.
    pub fn plane(&self) -> Plane {
        let eigen = SymmetricEigen::new(self.covariance);
        let least = eigen.eigenvalues.imin();
        Plane {
            normal: eigen.eigenvectors.column(least).into(),
            deviation_mm: eigen.eigenvalues[least].max(0.0).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_points_around_a_place_tell_their_plane() {
        let points: Vec<Point3> = (0..400)
            .map(|i| (f64::from(i % 20), f64::from(i / 20)))
            .map(|(x, y)| Point3::new(x, y, 0.5 * x))
            .collect();
        let cells = Cells::new(&points, 3.0);
        let moments = Moments::around(&Point3::new(10.0, 10.0, 5.0), &points, &cells, 3.0).unwrap();
        assert!(moments.mean.norm() < 1e-9);
        let plane = moments.plane();
        assert!(plane.deviation_mm < 1e-6);
        assert!(
            (plane
                .normal
                .dot(&Vector3::new(-0.5, 0.0, 1.0).normalize())
                .abs()
                - 1.0)
                .abs()
                < 1e-9
        );
        assert!(Moments::around(&Point3::new(99.0, 0.0, 0.0), &points, &cells, 3.0).is_none());
    }
}
