//! The free room between the two arms of a cell.
//!
//! Shafts meet in the joint and come near to each other on purpose; nothing else of the arms does.
//! So the room between the shafts is told apart from the room between any other two bodies.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{ArthroscopeBase, ForcepsBase};

use crate::bodies::{ArmShape, Bodies, Body};
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;

/// Both arms of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Clearance {
    forceps: (ToolArm, ArmShape),
    arthroscope: (ToolArm, ArmShape),
    forceps_base_from_arthroscope_base: Rigid<ForcepsBase, ArthroscopeBase>,
}

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The forceps arm, whose base is the common frame.
    Forceps,
    /// The arthroscope arm.
    Arthroscope,
}

/// The free room between two bodies, the first of one arm and the second of the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Free room, mm; negative by as much as they overlap.
    pub mm: f64,
    /// Which bodies.
    pub bodies: [Body; 2],
}

/// Where two arms are nearest to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Between the shafts.
    pub shafts: Distance,
    /// Between any other two bodies.
    pub others: Distance,
}

/// The free room that two arms must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Between the shafts, mm.
    pub shafts_mm: f64,
    /// Between any other two bodies, mm.
    pub others_mm: f64,
}

impl Side {
    /// The other one.
    pub const fn other(self) -> Self {
        match self {
            Self::Forceps => Self::Arthroscope,
            Self::Arthroscope => Self::Forceps,
        }
    }
}

impl Clearance {
    /// Of arms that stand as stated.
    pub fn new(
        forceps: (ToolArm, ArmShape),
        arthroscope: (ToolArm, ArmShape),
        forceps_base_from_arthroscope_base: Rigid<ForcepsBase, ArthroscopeBase>,
    ) -> Self {
        Self {
            forceps,
            arthroscope,
            forceps_base_from_arthroscope_base,
        }
    }

    /// The nearest bodies of the two arms at the given joints, rad; the forceps' first.
    pub fn between(&self, forceps: &Joints, arthroscope: &Joints) -> Nearest {
        let forceps = self.bodies(Side::Forceps, forceps);
        forceps.nearest(&self.bodies(Side::Arthroscope, arthroscope))
    }

    /// The bodies of one arm in the common frame.
    pub fn bodies(&self, side: Side, joints: &Joints) -> Bodies {
        let (arm, shape) = match side {
            Side::Forceps => &self.forceps,
            Side::Arthroscope => &self.arthroscope,
        };
        self.in_common(side, &shape.bodies(joints, &arm.base_from_tool(joints)))
    }

    /// What one of the arms looks like.
    pub fn shape(&self, side: Side) -> ArmShape {
        match side {
            Side::Forceps => self.forceps.1,
            Side::Arthroscope => self.arthroscope.1,
        }
    }

    /// Bodies in an arm's base, carried into the common frame.
    pub fn in_common(&self, side: Side, bodies: &Bodies) -> Bodies {
        match side {
            Side::Forceps => *bodies,
            Side::Arthroscope => {
                bodies.map(|point| self.forceps_base_from_arthroscope_base * *point)
            }
        }
    }
}

impl Bodies {
    /// The nearest bodies of two arms, both in one frame.
    pub fn nearest(&self, other: &Self) -> Nearest {
        let (shaft, their_shaft) = (self.get(Body::Shaft), other.get(Body::Shaft));
        let mut others = Distance {
            mm: f64::INFINITY,
            bodies: [Body::Base, Body::Base],
        };
        for (body, capsule) in self.iter() {
            for (their_body, their_capsule) in other.iter() {
                if body == Body::Shaft && their_body == Body::Shaft {
                    continue;
                }
                // Spheres are cheap, and most bodies are far apart.
                if capsule.distance_at_least_mm(their_capsule) >= others.mm {
                    continue;
                }
                let mm = capsule.distance_mm(their_capsule);
                if mm < others.mm {
                    others = Distance {
                        mm,
                        bodies: [body, their_body],
                    };
                }
            }
        }
        Nearest {
            shafts: Distance {
                mm: shaft.distance_mm(their_shaft),
                bodies: [Body::Shaft, Body::Shaft],
            },
            others,
        }
    }
}

impl Nearest {
    /// The same with less room, mm.
    pub fn less(&self, mm: f64) -> Self {
        let mut less = *self;
        less.shafts.mm -= mm;
        less.others.mm -= mm;
        less
    }
}

impl Keep {
    /// What the limits of an arm ask for.
    pub fn of(limits: &Limits) -> Self {
        Self {
            shafts_mm: limits.shafts_distance_min_mm,
            others_mm: limits.arms_distance_min_mm,
        }
    }

    /// The same, with arms that are nearer already held to not coming nearer by more than `slack_mm`.
    pub fn eased(&self, now: &Nearest, slack_mm: f64) -> Self {
        Self {
            shafts_mm: self.shafts_mm.min(now.shafts.mm - slack_mm),
            others_mm: self.others_mm.min(now.others.mm - slack_mm),
        }
    }

    /// How much more room there is than must be kept, mm; negative where one is missed.
    pub fn surplus_mm(&self, nearest: &Nearest) -> f64 {
        let shafts_mm = nearest.shafts.mm - self.shafts_mm;
        shafts_mm.min(nearest.others.mm - self.others_mm)
    }

    /// The distance that is too short and its limit, mm, if there is one.
    pub fn missed(&self, nearest: &Nearest) -> Option<(Distance, f64)> {
        let pairs = [
            (nearest.shafts, self.shafts_mm),
            (nearest.others, self.others_mm),
        ];
        pairs
            .into_iter()
            .find(|(distance, limit_mm)| distance.mm < *limit_mm)
    }
}

#[cfg(test)]
mod tests;
