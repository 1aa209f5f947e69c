//! A path through the portal: shaft direction along a great circle, depth and roll in proportion.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Point3, Rigid, Vector3};

use super::portal::{about_shaft, wrap};
use super::{Coordinates, Placement, Portal, Turn};
use crate::roll::profile::Profile;

/// The share of a path within which the shaft is brought back onto the portal.
const REGAIN_SHARE: f64 = 0.2;
/// An aim nearer than this to the portal gives no direction, mm.
const AIM_MIN_MM: f64 = 1e-6;

/// A path through the portal, over s = 0..1.
#[derive(Clone, Debug, PartialEq)]
pub struct RcmPath {
    portal: Portal,
    from: Coordinates,
    turn: Turn,
    to_depth_mm: f64,
    roll_by_rad: f64,
    chosen_roll: Option<Profile>,
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

/// Where a path ends. What is `None` stays as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Destination {
    /// Of the shaft.
    pub direction: Option<Unit<Vector3>>,
    /// Of the tip beyond the portal, mm.
    pub depth_mm: Option<f64>,
    /// About the shaft, from the portal's reference, rad. The nearer way round is taken.
    pub roll_rad: Option<f64>,
}

impl RcmPath {
    /// Turns, rolls and inserts at once.
    pub fn to(
        base_from_tool: &Rigid<Base, Tool>,
        portal: impl Into<Portal>,
        end: &Destination,
        regain: Regain,
    ) -> Self {
        let portal = portal.into();
        let from = portal.coordinates(base_from_tool);
        let to = end.direction.unwrap_or(from.direction);
        let roll_rad = end.roll_rad.unwrap_or(from.roll_rad);
        Self {
            portal,
            from,
            turn: Turn::between(&from.direction, &to),
            to_depth_mm: end.depth_mm.unwrap_or(from.depth_mm),
            roll_by_rad: wrap(roll_rad - from.roll_rad),
            chosen_roll: None,
            offset: Placement::of(base_from_tool, &portal.point).offset,
            regain,
        }
    }

    /// Turns the shaft about the portal, at constant depth and roll, until it aims at `aim`. `None` if
    /// `aim` is the portal.
    pub fn pivot(
        base_from_tool: &Rigid<Base, Tool>,
        portal: impl Into<Portal>,
        aim: Point3,
    ) -> Option<Self> {
        let portal = portal.into();
        let end = Destination {
            direction: Some(direction_to(&portal, &aim)?),
            ..Destination::default()
        };
        Some(Self::to(base_from_tool, portal, &end, Regain::Portal))
    }

    /// Moves the tip along the shaft to `depth_mm`.
    pub fn along(
        base_from_tool: &Rigid<Base, Tool>,
        portal: impl Into<Portal>,
        depth_mm: f64,
        regain: Regain,
    ) -> Self {
        let end = Destination {
            depth_mm: Some(depth_mm),
            ..Destination::default()
        };
        Self::to(base_from_tool, portal, &end, regain)
    }

    /// The same tip and shaft, rolled by a profile on top of the path's own roll.
    pub fn rolled(self, profile: Profile) -> Self {
        Self {
            chosen_roll: Some(profile),
            ..self
        }
    }

    /// The pose at `s`.
    pub fn pose(&self, s: f64) -> Rigid<Base, Tool> {
        let turned = self.turn.part(s);
        let direction = Unit::new_normalize(turned * self.from.direction.into_inner());
        let chosen_rad = self
            .chosen_roll
            .as_ref()
            .map_or(0.0, |roll| roll.roll_rad(s));
        let roll_rad = self.from.roll_rad + self.roll_by_rad * s + chosen_rad;
        let rotation = self.portal.unrolled(&direction) * about_shaft(roll_rad);
        let tip = self.portal.point.coords
            + rotation * Vector3::x() * self.depth_mm(s)
            + turned * self.offset * self.remaining(s);
        Rigid::new(rotation, tip)
    }

    /// The depth at `s`, mm.
    pub fn depth_mm(&self, s: f64) -> f64 {
        self.from.depth_mm + (self.to_depth_mm - self.from.depth_mm) * s
    }

    /// The deviation that the path itself has at `s`, mm.
    pub fn planned_deviation_mm(&self, s: f64) -> f64 {
        self.offset.norm() * self.remaining(s)
    }

    /// The point that the shaft passes.
    pub fn portal(&self) -> Point3 {
        self.portal.point
    }

    /// The whole turn of the shaft, rad.
    pub fn turn_rad(&self) -> f64 {
        self.turn.angle_rad
    }

    /// The whole travel of the tip along the shaft and back onto the portal, mm.
    pub fn travel_mm(&self) -> f64 {
        let regained = self.offset.norm() * (1.0 - self.remaining(1.0));
        (self.to_depth_mm - self.from.depth_mm).abs() + regained
    }

    /// Whether it goes nowhere.
    pub fn is_still(&self) -> bool {
        const STILL: f64 = 1e-9;
        let chosen_rad = self.chosen_roll.as_ref().map_or(0.0, Profile::most_rad);
        let turned = self.turn_rad().max(self.roll_by_rad.abs()).max(chosen_rad);
        (..STILL).contains(&self.travel_mm().max(turned))
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

/// From the portal to a point; `None` if they coincide.
pub fn direction_to(portal: &Portal, aim: &Point3) -> Option<Unit<Vector3>> {
    Unit::try_new(aim - portal.point, AIM_MIN_MM)
}
