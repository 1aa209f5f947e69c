//! What may be asked of depth images, and what is usual.

use super::fusion::views;
use super::intrinsics::{Intrinsics, Roi};
use super::noise::StereoNoise;
use super::outliers::OutlierFilter;
use super::plane::PlaneRemoval;
use crate::error::Violation;

/// What becomes points, and what is taken away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The pixels looked at; `None` for all.
    pub roi: Option<Roi>,
    /// Nearest depth kept, mm.
    pub min_depth_mm: f64,
    /// Farthest depth kept, mm; infinite for all.
    pub max_depth_mm: f64,
    /// Drops pixels in the air beside an edge: those between a nearer and a farther neighbour, across steps that are both
    /// steeper than this against the image plane, within [`STEEPEST_RAD`].
    pub steepest_rad: Option<f64>,
    /// Pixels to each side that a normal is fitted to, 1 to [`MAX_NORMAL_REACH_PX`].
    pub normal_reach_px: u32,
    /// The camera's noise.
    pub noise: StereoNoise,
    /// Edge of the cells in which points of several viewpoints become one, mm; within [`views::VOXELS_MM`].
    pub voxel_mm: f64,
    /// Takes strays away.
    pub outliers: Option<OutlierFilter>,
    /// Takes away what the thing lies on.
    pub plane: Option<PlaneRemoval>,
}

/// Steepnesses that may be asked of an edge: 45 to 89 degrees.
pub const STEEPEST_RAD: std::ops::RangeInclusive<f64> = 0.785..=1.554;
/// Steepness of an edge where nothing else is asked: 75 degrees.
pub const DEFAULT_STEEPEST_RAD: f64 = 1.309;
/// Widest neighbourhood of a normal, pixels to each side.
pub const MAX_NORMAL_REACH_PX: u32 = 10;

impl Default for Options {
    /// Every pixel of a D435i.
    fn default() -> Self {
        Self {
            roi: None,
            min_depth_mm: 0.0,
            max_depth_mm: f64::INFINITY,
            steepest_rad: None,
            normal_reach_px: 2,
            noise: StereoNoise::default(),
            voxel_mm: 0.5,
            outliers: None,
            plane: None,
        }
    }
}

impl Options {
    /// What is wrong with the options for an image of `intrinsics`.
    pub fn violations(&self, intrinsics: &Intrinsics) -> Vec<Violation> {
        let mut violations = Vec::new();
        if let Some(roi) = &self.roi {
            violations.extend(roi.violations(intrinsics));
        }
        if !(self.min_depth_mm >= 0.0 && self.min_depth_mm.is_finite()) {
            violations.push(Violation::new(
                "header.min_depth_mm",
                format!("is {}, must be finite and at least 0", self.min_depth_mm),
            ));
        } else if self.max_depth_mm.is_nan() || self.max_depth_mm <= self.min_depth_mm {
            violations.push(Violation::new(
                "header.max_depth_mm",
                format!(
                    "is {}, must be greater than min_depth_mm, {}",
                    self.max_depth_mm, self.min_depth_mm
                ),
            ));
        }
        if let Some(steepest_rad) = self.steepest_rad.filter(|s| !STEEPEST_RAD.contains(s)) {
            violations.push(Violation::new(
                "header.flying_pixels.steepest_rad",
                format!(
                    "is {steepest_rad}, must be {} to {}",
                    STEEPEST_RAD.start(),
                    STEEPEST_RAD.end()
                ),
            ));
        }
        if self.normal_reach_px == 0 || self.normal_reach_px > MAX_NORMAL_REACH_PX {
            violations.push(Violation::new(
                "header.normal_reach_px",
                format!(
                    "is {}, must be 1 to {MAX_NORMAL_REACH_PX}",
                    self.normal_reach_px
                ),
            ));
        }
        violations.extend(self.noise.violations());
        violations.extend(views::voxel_violation(self.voxel_mm));
        violations.extend(self.outliers.iter().flat_map(OutlierFilter::violations));
        violations.extend(self.plane.iter().flat_map(PlaneRemoval::violations));
        violations
    }
}
