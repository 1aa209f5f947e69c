//! The lines of a meniscus that need no drawing: the free inner edge and the midline of the crescent.

use arthro_geometry::Point3;

use super::station::Station;
use super::{gap, heights, spline_through};
use crate::contour::Spline;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::voxels::Voxels;

/// A line along the whole crescent, from horn to horn at ascending angles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Where the tissue ends towards the centre.
    InnerEdge,
    /// Half way from the free edge to the rim.
    Midline,
}

impl Line {
    /// The line of a meniscus in the axes of its crescent, at the height of the middle of the tissue.
    ///
    /// # Errors
    /// When the crescent has a gap.
    pub fn of(self, crescent: &Crescent, voxels: &Voxels) -> Result<Spline, Error> {
        let depth = match self {
            Self::InnerEdge => 0.0,
            Self::Midline => 0.5,
        };
        let (first_rad, last_rad) = crescent.span_rad();
        let stations = Station::between(first_rad, last_rad, crescent).map_err(gap)?;
        let mut points: Vec<Point3> = stations.iter().map(|station| station.at(depth)).collect();
        heights::lift(&mut points, None, voxels);
        spline_through(&points)
    }
}
