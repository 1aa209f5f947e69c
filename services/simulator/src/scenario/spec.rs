//! The numbers a case is made from. Every one has a default; a file states those that differ.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::{Layout, Mounting};
use crate::Error;

/// What a case is made from, beside the model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Spec {
    /// Where the knee lies and what noise the camera has.
    pub seed: u64,
    /// How far the knee may lie from its nominal pose.
    pub displacement: Displacement,
    /// The damage in the middle of the body.
    pub tear: TearSpec,
    /// The joint.
    pub knee: KneeSpec,
    /// The jaw of the forceps.
    pub jaw: JawSpec,
    /// The camera.
    pub camera: Intrinsics,
    /// Where things stand in the cell.
    pub layout: Layout,
    /// How far from the layout things are really mounted.
    pub mounting: Mounting,
}

/// Bounds of the displacement that the seed draws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Displacement {
    /// Along each axis, mm.
    pub translation_mm: f64,
    /// About a random axis, degrees.
    pub rotation_deg: f64,
}

impl Default for Displacement {
    fn default() -> Self {
        Self {
            translation_mm: 8.0,
            rotation_deg: 10.0,
        }
    }
}

/// A radial tear.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TearSpec {
    /// From the free edge, as a share of the local width.
    pub depth_fraction: f64,
    /// It ends at least this far from the rim, so that a resection around it leaves the rim that planning asks for, mm.
    pub rim_min_mm: f64,
    /// Across, mm.
    pub width_mm: f64,
    /// The contour leaves the free edge this far on each side of the tear, degrees about the hole.
    pub reach_deg: f64,
}

impl Default for TearSpec {
    fn default() -> Self {
        Self {
            depth_fraction: 0.42,
            rim_min_mm: 3.5,
            width_mm: 1.5,
            reach_deg: 28.0,
        }
    }
}

/// The joint around the meniscus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KneeSpec {
    /// Edge of a tissue cell, mm.
    pub voxel_mm: f64,
    /// Radius of the femoral condyle, mm.
    pub condyle_radius_mm: f64,
    /// Between the top of the meniscus and the lowest point of the condyle, mm.
    pub joint_gap_mm: f64,
    /// Cartilage on the tibial plateau, mm: the meniscus lies on it, the bone begins below it.
    pub cartilage_mm: f64,
    /// Radius of the tibial plateau, mm.
    pub plateau_radius_mm: f64,
}

impl Default for KneeSpec {
    fn default() -> Self {
        Self {
            voxel_mm: 0.3,
            condyle_radius_mm: 24.0,
            joint_gap_mm: 8.0,
            cartilage_mm: 3.0,
            plateau_radius_mm: 36.0,
        }
    }
}

/// A straight punch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct JawSpec {
    /// Across the shaft, mm.
    pub width_mm: f64,
    /// Along the shaft, mm; the tip of the tool is the middle of the jaw.
    pub length_mm: f64,
    /// Between the open jaws, mm.
    pub opening_mm: f64,
    /// Feed at which the empty jaws touch, mm.
    pub closed_feed_mm: f64,
    /// What a full bite asks of the feed drive on top of its friction, mA. Tissue is sheared along the
    /// edge of the footprint, so a smaller bite asks for the root of its share of the area.
    pub cutting_current_ma: f64,
}

impl Default for JawSpec {
    fn default() -> Self {
        Self {
            width_mm: 3.0,
            length_mm: 4.5,
            opening_mm: 10.0,
            closed_feed_mm: 10.0,
            cutting_current_ma: 260.0,
        }
    }
}

/// The depth camera. The law of the noise is that of a stereo camera: its deviation along the ray is
/// Z^2 * subpixel / (f * baseline).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Intrinsics {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Focal length, pixels; 700 gives 0.5 mm a pixel at 350 mm.
    pub focal_px: f64,
    /// Between the two imagers, mm.
    pub baseline_mm: f64,
    /// Deviation of the disparity, pixels; 0 makes a camera without noise.
    pub subpixel_px: f64,
    /// Millimetres a depth unit.
    pub depth_unit_mm: f64,
    /// Deviation of a corner of the calibration board, each axis, pixels.
    pub corner_px: f64,
}

impl Default for Intrinsics {
    fn default() -> Self {
        Self {
            width_px: 1280,
            height_px: 720,
            focal_px: 700.0,
            baseline_mm: 50.0,
            subpixel_px: 0.08,
            depth_unit_mm: 0.1,
            corner_px: 0.3,
        }
    }
}

impl Intrinsics {
    /// Column and row of the optical axis, pixels.
    pub fn principal_point_px(&self) -> [f64; 2] {
        [
            0.5 * f64::from(self.width_px - 1),
            0.5 * f64::from(self.height_px - 1),
        ]
    }
}

impl Spec {
    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// Names the first one.
    pub fn checked(&self) -> Result<&Self, Error> {
        let jaw = &self.jaw;
        let knee = &self.knee;
        in_range(
            "scenario.displacement.translation_mm",
            self.displacement.translation_mm,
            0.0..=30.0,
            "0 .. 30 mm",
        )?;
        in_range(
            "scenario.displacement.rotation_deg",
            self.displacement.rotation_deg,
            0.0..=30.0,
            "0 .. 30 degrees",
        )?;
        in_range(
            "scenario.tear.depth_fraction",
            self.tear.depth_fraction,
            0.05..=0.9,
            "0.05 .. 0.9",
        )?;
        in_range(
            "scenario.tear.rim_min_mm",
            self.tear.rim_min_mm,
            0.0..=20.0,
            "0 .. 20 mm",
        )?;
        in_range(
            "scenario.tear.width_mm",
            self.tear.width_mm,
            0.5..=10.0,
            "0.5 .. 10 mm",
        )?;
        in_range(
            "scenario.tear.reach_deg",
            self.tear.reach_deg,
            5.0..=80.0,
            "5 .. 80 degrees",
        )?;
        in_range(
            "scenario.knee.voxel_mm",
            knee.voxel_mm,
            0.1..=1.0,
            "0.1 .. 1 mm",
        )?;
        in_range(
            "scenario.knee.condyle_radius_mm",
            knee.condyle_radius_mm,
            5.0..=60.0,
            "5 .. 60 mm",
        )?;
        in_range(
            "scenario.knee.joint_gap_mm",
            knee.joint_gap_mm,
            0.0..=200.0,
            "0 .. 200 mm",
        )?;
        in_range(
            "scenario.knee.cartilage_mm",
            knee.cartilage_mm,
            0.0..=10.0,
            "0 .. 10 mm",
        )?;
        in_range(
            "scenario.knee.plateau_radius_mm",
            knee.plateau_radius_mm,
            5.0..=100.0,
            "5 .. 100 mm",
        )?;
        in_range(
            "scenario.jaw.width_mm",
            jaw.width_mm,
            0.5..=10.0,
            "0.5 .. 10 mm",
        )?;
        in_range(
            "scenario.jaw.length_mm",
            jaw.length_mm,
            0.5..=20.0,
            "0.5 .. 20 mm",
        )?;
        in_range(
            "scenario.jaw.opening_mm",
            jaw.opening_mm,
            1.0..=20.0,
            "1 .. 20 mm",
        )?;
        in_range(
            "scenario.jaw.closed_feed_mm",
            jaw.closed_feed_mm,
            1.0..=14.0,
            "1 .. 14 mm",
        )?;
        in_range(
            "scenario.jaw.cutting_current_ma",
            jaw.cutting_current_ma,
            0.0..=5000.0,
            "0 .. 5000 mA",
        )?;
        in_range(
            "scenario.camera.width_px",
            self.camera.width_px.into(),
            16.0..=4096.0,
            "16 .. 4096",
        )?;
        in_range(
            "scenario.camera.height_px",
            self.camera.height_px.into(),
            16.0..=4096.0,
            "16 .. 4096",
        )?;
        in_range(
            "scenario.camera.focal_px",
            self.camera.focal_px,
            10.0..=10_000.0,
            "10 .. 10000 pixels",
        )?;
        in_range(
            "scenario.camera.baseline_mm",
            self.camera.baseline_mm,
            1.0..=1000.0,
            "1 .. 1000 mm",
        )?;
        in_range(
            "scenario.camera.subpixel_px",
            self.camera.subpixel_px,
            0.0..=2.0,
            "0 .. 2 pixels",
        )?;
        in_range(
            "scenario.camera.depth_unit_mm",
            self.camera.depth_unit_mm,
            0.01..=10.0,
            "0.01 .. 10 mm",
        )?;
        in_range(
            "scenario.camera.corner_px",
            self.camera.corner_px,
            0.0..=5.0,
            "0 .. 5 pixels",
        )?;
        self.mounting.checked()?;
        in_range(
            "scenario.layout.camera_distance_mm",
            self.layout.camera_distance_mm,
            100.0..=2000.0,
            "100 .. 2000 mm",
        )?;
        in_range(
            "scenario.layout.shaft_length_mm",
            self.layout.shaft_length_mm,
            50.0..=1000.0,
            "50 .. 1000 mm",
        )?;
        Ok(self)
    }
}

pub(super) fn in_range(
    field: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
    limit: &'static str,
) -> Result<(), Error> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(Error::Config {
        field,
        value: value.to_string(),
        limit,
    })
}
