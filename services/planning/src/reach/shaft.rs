//! The straight shaft of an instrument: a capsule that ends where its slimmer jaw begins.

use arthro_geometry::{Point3, Vector3};
use parry3d_f64::math::Pose3;
use parry3d_f64::query::details::distance_segment_segment;
use parry3d_f64::shape::Segment;

use super::convert::to_glam;
use crate::jaw::{Bite, Jaw};

/// The hinge behind the jaw, as slim as the jaw, mm.
const THROAT_MM: f64 = 1.0;

/// The sizes of a straight instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaft {
    /// Of the shaft, mm.
    pub radius_mm: f64,
    /// From the tool's tip (the middle of the jaw) to the drive unit, mm.
    pub length_mm: f64,
    /// How far the tool reaches ahead of its tip, mm.
    pub ahead_mm: f64,
    /// How far behind its tip the tool is slimmer than the shaft and meant to reach into tissue, mm.
    pub slim_mm: f64,
}

impl Shaft {
    /// An arthroscope of 4.0 mm, thick to its very end.
    pub const ARTHROSCOPE: Self = Self {
        radius_mm: 2.0,
        length_mm: 150.0,
        ahead_mm: 0.0,
        slim_mm: 0.0,
    };

    /// A forceps of 3.5 mm whose shaft is 150 mm long.
    pub fn forceps(jaw: &Jaw) -> Self {
        Self {
            radius_mm: 1.75,
            length_mm: 150.0,
            ahead_mm: 0.5 * jaw.length_mm,
            slim_mm: 0.5 * jaw.length_mm + THROAT_MM,
        }
    }

    /// Where the shaft is when the tool's tip is at `tip` and points along the unit vector `approach`.
    pub fn body(&self, tip: &Point3, approach: &Vector3) -> Capsule {
        let first_mm = self.slim_mm + self.radius_mm;
        Capsule {
            start: tip - approach * first_mm,
            along: -approach,
            length_mm: (self.length_mm - first_mm).max(0.0),
            radius_mm: self.radius_mm,
        }
    }

    /// Where the shaft is when it makes a bite.
    pub fn at(&self, bite: &Bite) -> Capsule {
        self.body(&bite.center, &bite.approach)
    }
}

/// All places within a radius of a straight axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// The end of the axis that is deepest in the joint, mm.
    pub start: Point3,
    /// Unit vector from there.
    pub along: Vector3,
    /// Of the axis, mm.
    pub length_mm: f64,
    /// Around it, mm.
    pub radius_mm: f64,
}

impl Capsule {
    /// The place on the axis so far from its start, mm.
    pub fn at(&self, way_mm: f64) -> Point3 {
        self.start + self.along * way_mm
    }

    /// How far from the start of the axis its place nearest to `point` is, mm.
    pub fn way_mm(&self, point: &Point3) -> f64 {
        let way_mm = (point - self.start).dot(&self.along);
        way_mm.max(0.0).min(self.length_mm)
    }

    /// The same capsule moved.
    pub fn displaced(&self, by: &Vector3) -> Self {
        Self {
            start: self.start + by,
            ..*self
        }
    }

    pub(super) fn segment(&self, from_mm: f64, to_mm: f64) -> Segment {
        Segment::new(to_glam(&self.at(from_mm)), to_glam(&self.at(to_mm)))
    }
}

/// Distance between two shafts, mm; negative by as much as they overlap.
pub fn shafts_mm(a: &Capsule, b: &Capsule) -> f64 {
    let (one, other) = (a.segment(0.0, a.length_mm), b.segment(0.0, b.length_mm));
    distance_segment_segment(&Pose3::IDENTITY, &one, &other) - a.radius_mm - b.radius_mm
}
