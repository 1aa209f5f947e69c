//! A cloud thinned to a few points with fitted normals, as congruent sets are searched in it.

use arthro_geometry::{Point3, Vector3};

use crate::cells::Cells;
use crate::sampling;

/// Spacings over which a normal is fitted.
const NORMAL_SPACINGS: f64 = 2.2;

/// Evenly spread points with normals whose signs are arbitrary.
#[derive(Clone, Debug)]
pub struct Thinned {
    /// Positions, mm.
    pub points: Vec<Point3>,
    /// Unit normals of `points`.
    pub normals: Vec<Vector3>,
}

impl Thinned {
    /// Thins `points` to at most `count` and fits normals.
    pub fn new(points: &[Point3], count: usize) -> Self {
        let points = sampling::spread(points, count);
        let radius_mm = NORMAL_SPACINGS * sampling::spacing_mm(&points);
        let normals = sampling::fitted_normals(&points, &Cells::new(&points, radius_mm), radius_mm);
        Self { points, normals }
    }
}
