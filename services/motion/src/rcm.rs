//! The remote centre of motion: poses and paths whose shaft passes the portal.
//!
//! With the portal `p`, the shaft's unit direction `u` (tool x, out of the tip) and the depth `d`, the
//! tip is `p + d u`. A [`path`] turns `u` about one fixed axis and changes `d` and the roll about the
//! shaft linearly, so that the shaft passes the portal at every point of it and not only at its ends.
//! The roll is counted from a reference that the [`portal`] fixes. [`straight`] and [`paper`] are the
//! moves that others make, for comparison.

pub mod paper;
pub mod path;
pub mod portal;
pub mod straight;

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::{Unit, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

pub use self::path::{RcmPath, Regain};
pub use self::portal::{Coordinates, Portal};

/// A shaft line that comes this near to the portal belongs to it; farther away the tip is beside the
/// knee and not in it, whatever its depth, mm.
const PORTAL_REACH_MM: f64 = 100.0;
/// Directions closer than this are one direction: their cross product has no axis left, rad.
const PARALLEL_RAD: f64 = 1e-12;

/// Where a tool stands to its portal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Of the tip beyond the portal along the shaft, mm; negative outside.
    pub depth_mm: f64,
    /// From the portal to the nearest point of the infinite shaft line, perpendicular to the shaft.
    pub offset: Vector3,
}

impl Placement {
    /// Of a tool pose to a portal, both in base.
    pub fn of(base_from_tool: &Rigid<Base, Tool>, portal: &Point3) -> Self {
        let shaft = shaft(base_from_tool);
        let portal_to_tip = base_from_tool.origin() - portal;
        let depth_mm = portal_to_tip.dot(&shaft);
        Self {
            depth_mm,
            offset: portal_to_tip - shaft * depth_mm,
        }
    }

    /// The RCM deviation: the portal's distance to the infinite shaft line, mm.
    pub fn deviation_mm(&self) -> f64 {
        self.offset.norm()
    }

    /// Whether a tool that comes to stand so is inside: its tip is beyond the portal, and not beside
    /// the knee.
    pub fn is_inside(&self) -> bool {
        self.depth_mm > 0.0 && self.deviation_mm() <= PORTAL_REACH_MM
    }
}

/// The shaft's unit direction in base, out of the tip.
pub fn shaft(base_from_tool: &Rigid<Base, Tool>) -> Vector3 {
    base_from_tool.direction(&Vector3::x())
}

/// The turn that takes one unit direction onto another without twist about either: Eq. 12 to 14 of
/// the paper with the axis `x1 x x2` made a unit vector, without which Eq. 14 is no rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Perpendicular to both directions.
    pub axis: Unit<Vector3>,
    /// From the first to the second, 0 .. pi.
    pub angle_rad: f64,
}

impl Turn {
    /// Between unit directions. Parallel ones need no turn; antiparallel ones leave the axis open, and
    /// it is taken perpendicular to the first and to the base axis that is farthest from it.
    pub fn between(from: &Vector3, to: &Vector3) -> Self {
        let cross = from.cross(to);
        // The arctangent keeps its precision at both ends, where the paper's arccosine loses half the digits.
        let angle_rad = cross.norm().atan2(from.dot(to));
        let farthest = Vector3::ith(from.iamin(), 1.0);
        let axis = Unit::try_new(cross, PARALLEL_RAD)
            .unwrap_or_else(|| Unit::new_normalize(from.cross(&farthest)));
        Self { axis, angle_rad }
    }

    /// The part `share` of the turn, as a rotation in base axes: it multiplies from the left.
    pub fn part(&self, share: f64) -> Rotation {
        UnitQuaternion::from_axis_angle(&self.axis, self.angle_rad * share)
    }
}

#[cfg(test)]
mod tests;
