//! Why a bite cannot be reached: reason, number, limit, place, and what would make it possible.

use std::fmt;

use arthro_geometry::frame::Frame;
use arthro_geometry::{Point3, Rigid};

/// Why a bite cannot be reached and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstruction {
    /// What is in the way.
    pub cause: Cause,
    /// Where, in the axes in which it was asked, mm.
    pub at: Point3,
}

/// What is in the way of a shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// Portal and bite are no straight line: a value is not finite, a direction is not a unit or the
    /// two are at one place.
    NoShaft,
    /// The shaft points elsewhere than to the portal.
    MissesPortal {
        /// Of the portal to the axis, mm.
        distance_mm: f64,
        /// At most, mm.
        limit_mm: f64,
    },
    /// The portal is too near to the bite or too far.
    Insertion {
        /// From the portal to the middle of the jaw, mm.
        insertion_mm: f64,
        /// The limit that is broken, mm.
        limit_mm: f64,
    },
    /// The shaft is too steep.
    Elevation {
        /// Over the meniscal plane.
        elevation_rad: f64,
        /// The limit that is broken.
        limit_rad: f64,
        /// How much lower the portal must be, mm; negative: higher.
        lower_mm: f64,
    },
    /// A part of the tool is where none may be.
    KeepOut {
        /// Which of the limits' keep-outs.
        index: usize,
        /// Distance to it, mm, negative inside.
        distance_mm: f64,
        /// At least, mm.
        limit_mm: f64,
    },
    /// The portal is in a bone.
    PortalInBone {
        /// Which.
        bone: BoneName,
        /// Below its surface, mm; of a mesh no more than [`super::MARGIN_MM`] is told.
        depth_mm: f64,
    },
    /// The shaft comes too near to the tibia.
    HitsTibia {
        /// Between shaft and bone, mm, negative by as much as they overlap.
        distance_mm: f64,
        /// At least, mm.
        limit_mm: f64,
        /// The triangle of the mesh.
        triangle: Option<u32>,
        /// How much higher a portal would be clear of it, mm; `None` if none is within reach.
        raise_mm: Option<f64>,
    },
    /// The shaft comes too near to the femur, and would not if the joint were opened more.
    JointGap {
        /// How far the femur is lifted, mm.
        opening_mm: f64,
        /// How far it must be, mm.
        needed_mm: f64,
        /// Between shaft and bone, mm, negative by as much as they overlap.
        distance_mm: f64,
        /// The triangle of the mesh.
        triangle: Option<u32>,
    },
    /// The shaft comes too near to the femur however far the joint is opened.
    HitsCondyle {
        /// Between shaft and bone, mm, negative by as much as they overlap.
        distance_mm: f64,
        /// At least, mm.
        limit_mm: f64,
        /// How far the joint can be opened, mm.
        max_opening_mm: f64,
        /// The triangle of the mesh.
        triangle: Option<u32>,
    },
    /// The shaft passes through too much of the remaining meniscus.
    Tissue {
        /// How much, mm.
        tissue_mm: f64,
        /// At most, mm.
        limit_mm: f64,
    },
}

/// The bones of the joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoneName {
    /// Above the meniscus.
    Femur,
    /// Below it.
    Tibia,
}

/// What was measured and what it had to keep to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measure {
    /// A length and its limit, mm.
    Millimetres(f64, f64),
    /// An angle and its limit.
    Radians(f64, f64),
}

impl Obstruction {
    /// The same obstruction told in another frame.
    pub fn carried<A: Frame, B: Frame>(&self, a_from_b: &Rigid<A, B>) -> Self {
        Self {
            at: *a_from_b * self.at,
            ..*self
        }
    }
}

impl Cause {
    /// A stable word for the kind of cause.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::NoShaft => "NO_SHAFT",
            Self::MissesPortal { .. } => "SHAFT_MISSES_PORTAL",
            Self::Insertion { .. } => "INSERTION_BEYOND_LIMIT",
            Self::Elevation { .. } => "ELEVATION_BEYOND_LIMIT",
            Self::KeepOut { .. } => "KEEP_OUT",
            Self::PortalInBone { .. } => "PORTAL_IN_BONE",
            Self::HitsTibia { .. } => "SHAFT_HITS_TIBIA",
            Self::JointGap { .. } => "JOINT_GAP_TOO_SMALL",
            Self::HitsCondyle { .. } => "SHAFT_HITS_CONDYLE",
            Self::Tissue { .. } => "SHAFT_IN_MENISCUS",
        }
    }

    /// The number and its limit; for a joint that must be opened more, the opening there is and the one
    /// needed.
    pub fn measure(&self) -> Option<Measure> {
        use Measure::{Millimetres, Radians};
        Some(match *self {
            Self::NoShaft => return None,
            Self::Insertion {
                insertion_mm,
                limit_mm,
            } => Millimetres(insertion_mm, limit_mm),
            Self::Elevation {
                elevation_rad,
                limit_rad,
                ..
            } => Radians(elevation_rad, limit_rad),
            Self::PortalInBone { depth_mm, .. } => Millimetres(-depth_mm, 0.0),
            Self::JointGap {
                opening_mm,
                needed_mm,
                ..
            } => Millimetres(opening_mm, needed_mm),
            Self::Tissue {
                tissue_mm,
                limit_mm,
            } => Millimetres(tissue_mm, limit_mm),
            Self::MissesPortal {
                distance_mm,
                limit_mm,
            }
            | Self::KeepOut {
                distance_mm,
                limit_mm,
                ..
            }
            | Self::HitsTibia {
                distance_mm,
                limit_mm,
                ..
            }
            | Self::HitsCondyle {
                distance_mm,
                limit_mm,
                ..
            } => Millimetres(distance_mm, limit_mm),
        })
    }

    /// The triangle of the bone's mesh that is in the way.
    pub fn triangle(&self) -> Option<u32> {
        match self {
            Self::HitsTibia { triangle, .. }
            | Self::JointGap { triangle, .. }
            | Self::HitsCondyle { triangle, .. } => *triangle,
            _ => None,
        }
    }

    /// What would make it possible.
    pub fn remedy(&self) -> String {
        match self {
            Self::NoShaft => "give a portal away from the bite and a unit direction".into(),
            Self::MissesPortal { .. } => "let the shaft point from the portal to the bite".into(),
            Self::Insertion { limit_mm, .. } => {
                format!("a portal {limit_mm:.1} mm from the bite")
            }
            Self::Elevation { lower_mm, .. } if *lower_mm >= 0.0 => {
                format!("a portal {lower_mm:.1} mm lower")
            }
            Self::Elevation { lower_mm, .. } => format!("a portal {:.1} mm higher", -lower_mm),
            Self::KeepOut { .. } => "another portal, or a bite farther from it".into(),
            Self::PortalInBone { .. } => "a portal outside the bone".into(),
            Self::HitsTibia {
                raise_mm: Some(raise_mm),
                ..
            } => format!("a portal {raise_mm:.1} mm higher"),
            Self::HitsTibia { .. } => "another portal, or a slimmer shaft".into(),
            Self::JointGap { needed_mm, .. } => {
                format!("open the joint to {needed_mm:.1} mm")
            }
            Self::HitsCondyle { .. } => "another portal, or a slimmer shaft".into(),
            Self::Tissue { .. } => "another portal, or bite what is in the way first".into(),
        }
    }
}

impl fmt::Display for BoneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Femur => "femur",
            Self::Tibia => "tibia",
        })
    }
}

impl fmt::Display for Obstruction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = &self.at;
        write!(
            f,
            "{} at ({:.1}, {:.1}, {:.1}) mm",
            self.cause, at.x, at.y, at.z
        )
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoShaft => write!(f, "portal and bite are no straight line"),
            Self::MissesPortal {
                distance_mm,
                limit_mm,
            } => write!(
                f,
                "the shaft passes the portal at {distance_mm:.2} mm, the limit is {limit_mm} mm"
            ),
            Self::Insertion {
                insertion_mm,
                limit_mm,
            } => write!(
                f,
                "the portal is {insertion_mm:.1} mm from the bite, the limit is {limit_mm} mm"
            ),
            Self::Elevation {
                elevation_rad,
                limit_rad,
                ..
            } => write!(
                f,
                "the shaft is {:.1} deg over the meniscal plane, the limit is {:.1} deg",
                elevation_rad.to_degrees(),
                limit_rad.to_degrees()
            ),
            Self::KeepOut {
                index,
                distance_mm,
                limit_mm,
            } => write!(
                f,
                "the tool is {distance_mm:.2} mm from keep-out {index}, the limit is {limit_mm} mm"
            ),
            Self::PortalInBone { bone, depth_mm } => {
                write!(f, "the portal is {depth_mm:.1} mm deep in the {bone}")
            }
            Self::HitsTibia {
                distance_mm,
                limit_mm,
                ..
            } => write!(
                f,
                "the shaft is {distance_mm:.2} mm from the tibia, the limit is {limit_mm} mm"
            ),
            Self::JointGap {
                opening_mm,
                needed_mm,
                distance_mm,
                ..
            } => write!(
                f,
                "the joint is opened by {opening_mm:.1} mm and must be by {needed_mm:.1} mm: the shaft is {distance_mm:.2} mm from the femur"
            ),
            Self::HitsCondyle {
                distance_mm,
                limit_mm,
                max_opening_mm,
                ..
            } => write!(
                f,
                "the shaft is {distance_mm:.2} mm from the femur, the limit is {limit_mm} mm, and an opening of {max_opening_mm} mm does not free it"
            ),
            Self::Tissue {
                tissue_mm,
                limit_mm,
            } => write!(
                f,
                "the shaft passes through {tissue_mm:.1} mm of meniscus, the limit is {limit_mm} mm"
            ),
        }
    }
}
