//! What a shaft may do beside keeping clear of bone.

use std::ops::RangeInclusive;

use arthro_geometry::{Point3, Vector3};

use super::shaft::Capsule;
use crate::crescent::Crescent;
use crate::error::Error;

/// Mean distance of the popliteal bundle from the posterior horn of the lateral meniscus, mm (Gilat
/// et al. 2019).
const POPLITEAL_BUNDLE_MM: f64 = 7.8;
/// Radius of the bundle, mm: an assumption.
const POPLITEAL_RADIUS_MM: f64 = 4.0;
/// How far up and down from the meniscus the bundle runs past it, mm: more than a shaft can reach.
const POPLITEAL_REACH_MM: f64 = 100.0;

/// What a shaft must keep to, in the axes of the crescent.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Between the shaft and bone, mm, at least.
    pub clearance_mm: f64,
    /// Of the shaft over the meniscal plane; positive when the portal is above the bite.
    pub elevation_rad: RangeInclusive<f64>,
    /// From the portal to the middle of the jaw, mm.
    pub insertion_mm: RangeInclusive<f64>,
    /// How far the joint can be opened, mm.
    pub max_opening_mm: f64,
    /// How far from the shaft's axis the portal may be, mm.
    pub portal_mm: f64,
    /// How much remaining meniscus the shaft may pass through, mm; `None` because tissue yields.
    pub tissue_mm: Option<f64>,
    /// Where no part of the tool may be.
    pub keep_outs: Vec<KeepOut>,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            // Between the clearance that a shaft needs (none) and the cell's placement error of 0.7 mm
            // in the plane, of which little is across the shaft.
            clearance_mm: 0.5,
            // "Not more than 15 deg off the tibial articular surface" (Wheeless' Textbook of
            // Orthopaedics, medial portals), plus 5 deg between that surface and the meniscal plane.
            elevation_rad: -5f64.to_radians()..=20f64.to_radians(),
            // 33 .. 70 mm measured over the crescent through both portals.
            insertion_mm: 10.0..=110.0,
            // No table of joint spaces under distraction was found: an assumption.
            max_opening_mm: 12.0,
            portal_mm: 1.0,
            tissue_mm: None,
            keep_outs: Vec::new(),
        }
    }
}

impl Limits {
    pub(super) fn checked(self) -> Result<Self, Error> {
        in_range(
            "options.joint.limits.clearance_mm",
            self.clearance_mm,
            0.0..=5.0,
        )?;
        in_range(
            "options.joint.limits.max_opening_mm",
            self.max_opening_mm,
            0.0..=50.0,
        )?;
        in_range("options.joint.limits.portal_mm", self.portal_mm, 0.0..=10.0)?;
        if let Some(tissue_mm) = self.tissue_mm {
            in_range(
                "options.joint.limits.tissue_limit_mm",
                tissue_mm,
                0.0..=200.0,
            )?;
        }
        ordered("options.joint.limits.elevation", &self.elevation_rad, "rad")?;
        ordered("options.joint.limits.insertion", &self.insertion_mm, "mm")?;
        for keep_out in &self.keep_outs {
            keep_out.check()?;
        }
        Ok(self)
    }
}

pub(super) fn in_range(
    field: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
) -> Result<(), Error> {
    // NaN is in no range.
    if range.contains(&value) {
        return Ok(());
    }
    let (low, high) = range.into_inner();
    Err(Error::invalid(
        field,
        format!("is {value}; must be {low} .. {high}"),
    ))
}

fn ordered(field: &'static str, range: &RangeInclusive<f64>, unit: &str) -> Result<(), Error> {
    let (low, high) = (*range.start(), *range.end());
    if low <= high && low.is_finite() && high.is_finite() {
        return Ok(());
    }
    Err(Error::invalid(
        field,
        format!("is {low} .. {high} {unit}; must be a range from low to high"),
    ))
}

/// A place that no part of the tool may enter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KeepOut {
    /// Everything from a plane on.
    HalfSpace {
        /// A point of the plane, mm.
        through: Point3,
        /// Unit vector into what is kept out of.
        inward: Vector3,
    },
    /// Everything around a line, such as a vessel.
    Vessel(Capsule),
}

impl KeepOut {
    /// The popliteal bundle, upright behind the posterior horn: the one that is farther from an
    /// anterior `portal`. Portal and answer are in the axes of the crescent.
    pub fn popliteal(crescent: &Crescent, portal: &Point3) -> Self {
        // The horns lie at both sides of x, the axis through the body.
        let posterior = if portal.y > 0.0 { -1.0 } else { 1.0 };
        let behind_mm = |point: &Point3| posterior * point.y;
        let horn = crescent
            .rays()
            .filter_map(|angle_rad| {
                let rim_mm = crescent.rim_mm(angle_rad)?;
                let (sin, cos) = angle_rad.sin_cos();
                Some(Point3::new(rim_mm * cos, rim_mm * sin, 0.0))
            })
            .max_by(|a, b| behind_mm(a).total_cmp(&behind_mm(b)))
            .unwrap_or_else(Point3::origin);
        let behind = Vector3::y() * (posterior * (POPLITEAL_BUNDLE_MM + POPLITEAL_RADIUS_MM));
        Self::Vessel(Capsule {
            start: horn + behind - Vector3::z() * POPLITEAL_REACH_MM,
            along: Vector3::z(),
            length_mm: 2.0 * POPLITEAL_REACH_MM,
            radius_mm: POPLITEAL_RADIUS_MM,
        })
    }

    /// Distance of the tool to the place, mm, negative inside, and the place on the tool's axis that
    /// is nearest to it.
    pub(super) fn distance_mm(&self, tool: &Capsule) -> (f64, Point3) {
        match self {
            Self::HalfSpace { through, inward } => {
                let before_mm = |point: &Point3| (through - point).dot(inward);
                let ends = [tool.start, tool.at(tool.length_mm)];
                let deepest = if before_mm(&ends[0]) <= before_mm(&ends[1]) {
                    ends[0]
                } else {
                    ends[1]
                };
                (before_mm(&deepest) - tool.radius_mm, deepest)
            }
            Self::Vessel(vessel) => {
                let distance_mm = super::shaft::shafts_mm(tool, vessel);
                // Alternating projections between two lines end at their nearest places.
                let mut at = tool.start;
                for _ in 0..32 {
                    at = tool.at(tool.way_mm(&vessel.at(vessel.way_mm(&at))));
                }
                (distance_mm, at)
            }
        }
    }

    fn check(&self) -> Result<(), Error> {
        let (point, direction, sizes) = match self {
            Self::HalfSpace { through, inward } => (through, inward, [1.0, 1.0]),
            Self::Vessel(vessel) => (
                &vessel.start,
                &vessel.along,
                [vessel.length_mm, vessel.radius_mm],
            ),
        };
        let is_finite = point.iter().all(|value| value.is_finite());
        let is_unit = (direction.norm() - 1.0).abs() <= 1e-6;
        if is_finite && is_unit && sizes.iter().all(|size| (0.0..=1000.0).contains(size)) {
            return Ok(());
        }
        Err(Error::invalid(
            "options.joint.limits.keep_outs",
            format!("is {self:?}; must be finite, with a unit direction and sizes of 0 .. 1000 mm"),
        ))
    }
}
