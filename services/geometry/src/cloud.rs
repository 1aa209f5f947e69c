//! Point clouds: positions in mm, and unit normals where they are known.

use crate::{Point3, Vector3};

/// Points in one frame, mm; `normals` is empty or holds one unit vector a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Positions, mm.
    pub points: Vec<Point3>,
    /// Unit normals, one a point, or none at all.
    pub normals: Vec<Vector3>,
}

impl Cloud {
    /// A cloud without normals.
    pub fn new(points: Vec<Point3>) -> Self {
        Self {
            points,
            normals: Vec::new(),
        }
    }

    /// Lowest and highest corner of the axis-aligned bounding box, mm; `None` for an empty cloud.
    pub fn bounds(&self) -> Option<(Point3, Point3)> {
        bounds(&self.points)
    }
}

/// Lowest and highest corner of the axis-aligned bounding box of `points`; `None` if there are none.
pub fn bounds(points: &[Point3]) -> Option<(Point3, Point3)> {
    let first = *points.first()?;
    Some(
        points
            .iter()
            .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p))),
    )
}
