//! A portal and the coordinates of a shaft that passes it: direction, roll and depth.
//!
//! The roll is counted from a reference of the portal's own: the tool that looks along the portal's
//! axis with its z as upright as it goes has roll 0, and so has every tool that this one becomes by the
//! one turn that takes the axis onto its shaft. Directions that come back therefore bring the roll
//! back. A shaft that is only ever turned with the least twist does not: after a closed loop it has
//! turned about itself by the solid angle of the loop.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::{Matrix3, Quaternion, Rotation3, Unit, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::{Placement, Turn, shaft};
use crate::error::Error;

/// A portal nearer than this to the axis of the base is inside the arm, mm: the base is 151 mm wide,
/// and shoulder and upper arm turn about the same axis within 136 mm of it.
pub const BASE_RADIUS_MM: f64 = 150.0;
/// Below this sine an axis counts as vertical and its reference is the base's x.
const VERTICAL_SINE: f64 = 1e-3;
/// Directions nearer than this to the opposite of the axis leave the turn open, as 1 + cosine.
const OPPOSITE: f64 = 1e-9;

/// The point in the skin that a shaft turns about, in base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Portal {
    /// The point, mm.
    pub point: Point3,
    /// Into the joint: the middle of the cone that the shaft may lean in, and where the roll is counted
    /// from. Not stated, the cone is not limited and the roll is counted from the horizontal that leads
    /// away from the axis of the base.
    pub axis: Option<Unit<Vector3>>,
}

/// A shaft through a portal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// Of the shaft in base, out of the tip.
    pub direction: Unit<Vector3>,
    /// About the shaft, from the portal's reference, -pi .. pi.
    pub roll_rad: f64,
    /// Of the tip beyond the portal, mm.
    pub depth_mm: f64,
}

impl From<Point3> for Portal {
    fn from(point: Point3) -> Self {
        Self { point, axis: None }
    }
}

impl Portal {
    /// A portal whose axis is stated or not.
    ///
    /// # Errors
    /// PORTAL_IN_BASE when it is within [`BASE_RADIUS_MM`] of the axis of the base.
    pub fn new(point: Point3, axis: Option<Unit<Vector3>>) -> Result<Self, Error> {
        let radius_mm = point.x.hypot(point.y);
        if !(BASE_RADIUS_MM..).contains(&radius_mm) {
            return Err(Error::PortalInBase {
                radius_mm,
                limit_mm: BASE_RADIUS_MM,
            });
        }
        Ok(Self { point, axis })
    }

    /// How far a shaft leans from the axis, rad; `None` when no axis is stated.
    pub fn lean_rad(&self, direction: &Vector3) -> Option<f64> {
        self.axis
            .map(|axis| axis.cross(direction).norm().atan2(axis.dot(direction)))
    }

    /// The direction that the roll is counted from: the axis, or the horizontal away from the base.
    pub fn reference_axis(&self) -> Unit<Vector3> {
        self.axis.unwrap_or_else(|| {
            let outward = Vector3::new(self.point.x, self.point.y, 0.0);
            Unit::try_new(outward, f64::EPSILON).unwrap_or_else(Vector3::x_axis)
        })
    }

    /// The rotation base_from_tool of direction `direction` and roll 0.
    pub fn unrolled(&self, direction: &Unit<Vector3>) -> Rotation {
        let axis = self.reference_axis();
        swing(&axis, direction) * upright(&axis)
    }

    /// The pose of a tool whose shaft passes the portal.
    pub fn pose(&self, at: &Coordinates) -> Rigid<Base, Tool> {
        let rotation = self.unrolled(&at.direction) * about_shaft(at.roll_rad);
        let tip = self.point + at.direction.into_inner() * at.depth_mm;
        Rigid::new(rotation, tip.coords)
    }

    /// The coordinates of a tool; what it is beside the portal is not in them.
    pub fn coordinates(&self, base_from_tool: &Rigid<Base, Tool>) -> Coordinates {
        let direction = Unit::new_normalize(shaft(base_from_tool));
        let rolled = self.unrolled(&direction).inverse() * base_from_tool.rotation();
        Coordinates {
            direction,
            roll_rad: wrap(2.0 * rolled.i.atan2(rolled.w)),
            depth_mm: Placement::of(base_from_tool, &self.point).depth_mm,
        }
    }
}

/// A turn about the shaft, in tool axes: it multiplies from the right.
pub fn about_shaft(roll_rad: f64) -> Rotation {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll_rad)
}

/// The same angle in -pi .. pi.
pub fn wrap(angle_rad: f64) -> f64 {
    use std::f64::consts::TAU;
    angle_rad - TAU * (angle_rad / TAU).round()
}

/// The turn without twist from one unit direction to another, by half angles: no arctangent.
fn swing(from: &Unit<Vector3>, to: &Unit<Vector3>) -> Rotation {
    let cosine = from.dot(to);
    if 1.0 + cosine < OPPOSITE {
        return Turn::between(from, to).part(1.0);
    }
    UnitQuaternion::new_normalize(Quaternion::from_parts(1.0 + cosine, from.cross(to)))
}

/// The rotation with x along `axis` and z as near to the base's z as it goes.
fn upright(axis: &Unit<Vector3>) -> Rotation {
    let up = if axis.x.hypot(axis.y) < VERTICAL_SINE {
        Vector3::x()
    } else {
        Vector3::z()
    };
    let y = Unit::new_normalize(up.cross(axis)).into_inner();
    let columns = Matrix3::from_columns(&[axis.into_inner(), y, axis.cross(&y)]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns))
}
