//! The remote centre of motion: poses and paths whose shaft passes the portal.
//!
//! With the portal `p`, the shaft's unit direction `u` (tool x, out of the tip) and the depth `d`, the
//! tip is `p + d u`. A path turns `u` about one fixed axis and changes `d` linearly, so that the shaft
//! passes the portal at every point of it and not only at its ends.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::{Unit, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

/// A shaft line that comes this near to the portal belongs to it; farther away the tip is beside the
/// knee and not in it, whatever its depth, mm.
const PORTAL_REACH_MM: f64 = 100.0;
/// Directions closer than this are one direction: their cross product has no axis left, rad.
const PARALLEL_RAD: f64 = 1e-12;
/// The share of a path within which the shaft is brought back onto the portal.
const REGAIN_SHARE: f64 = 0.2;

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

/// A path through the portal, over s = 0..1.
#[derive(Clone, Debug, PartialEq)]
pub struct RcmPath {
    portal: Point3,
    start: Rotation,
    turn: Turn,
    from_depth_mm: f64,
    to_depth_mm: f64,
    offset: Vector3,
    regain: Regain,
}

/// What becomes of the deviation that the shaft begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regain {
    /// It fades out early on the path: pivots and insertions.
    Portal,
    /// It stays: a retraction of a shaft that is far off the portal keeps to its own line.
    Nothing,
}

impl RcmPath {
    /// Turns the shaft about the portal, at constant depth and with the least twist, until it aims at
    /// `aim`. `None` if `aim` is the portal.
    pub fn pivot(base_from_tool: &Rigid<Base, Tool>, portal: Point3, aim: Point3) -> Option<Self> {
        let to = (aim - portal).try_normalize(1e-6)?;
        let mut path = Self::at(base_from_tool, portal, Regain::Portal);
        path.turn = Turn::between(&shaft(base_from_tool), &to);
        Some(path)
    }

    /// Moves the tip along the shaft to `depth_mm`.
    pub fn along(
        base_from_tool: &Rigid<Base, Tool>,
        portal: Point3,
        depth_mm: f64,
        regain: Regain,
    ) -> Self {
        let mut path = Self::at(base_from_tool, portal, regain);
        path.to_depth_mm = depth_mm;
        path
    }

    fn at(base_from_tool: &Rigid<Base, Tool>, portal: Point3, regain: Regain) -> Self {
        let placement = Placement::of(base_from_tool, &portal);
        let shaft = shaft(base_from_tool);
        Self {
            portal,
            start: base_from_tool.rotation(),
            turn: Turn::between(&shaft, &shaft),
            from_depth_mm: placement.depth_mm,
            to_depth_mm: placement.depth_mm,
            offset: placement.offset,
            regain,
        }
    }

    /// The pose at `s`.
    pub fn pose(&self, s: f64) -> Rigid<Base, Tool> {
        let turned = self.turn.part(s);
        let rotation = turned * self.start;
        let depth_mm = self.from_depth_mm + (self.to_depth_mm - self.from_depth_mm) * s;
        let tip = self.portal.coords
            + rotation * Vector3::x() * depth_mm
            + turned * self.offset * self.remaining(s);
        Rigid::new(rotation, tip)
    }

    /// The deviation that the path itself has at `s`, mm.
    pub fn planned_deviation_mm(&self, s: f64) -> f64 {
        self.offset.norm() * self.remaining(s)
    }

    /// The point that the shaft passes.
    pub fn portal(&self) -> Point3 {
        self.portal
    }

    /// The whole turn, rad.
    pub fn turn_rad(&self) -> f64 {
        self.turn.angle_rad
    }

    /// The whole travel of the tip along the shaft and back onto the portal, mm.
    pub fn travel_mm(&self) -> f64 {
        let regained = self.offset.norm() * (1.0 - self.remaining(1.0));
        (self.to_depth_mm - self.from_depth_mm).abs() + regained
    }

    /// The share of the initial deviation left at `s`; smooth to the second derivative.
    fn remaining(&self, s: f64) -> f64 {
        match self.regain {
            Regain::Nothing => 1.0,
            Regain::Portal => {
                let t = (s / REGAIN_SHARE).clamp(0.0, 1.0);
                1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0))
            }
        }
    }
}

#[cfg(test)]
mod tests;
