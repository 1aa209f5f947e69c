//! Where the arthroscope stands while each bite is made.
//!
//! Its tip may stand on the places of one lattice around the bites, so that neighbouring bites can be
//! seen from the same place. A place is taken if the insertion is in range, the roll about the shaft
//! turns the oblique view onto the whole jaw, the shaft keeps clear of forceps, tissue and bones, and
//! neither forceps nor tissue hide the jaw (`poses`). Of the places left a shortest path through the bites weighs
//! how well each shows its bite against how far the arthroscope moves (`sequence`). Everything is
//! in the axes of the crescent: z superior.

mod blind;
mod optics;
mod poses;
mod relief;
mod segment;
mod sequence;

use std::ops::{ControlFlow, RangeInclusive};

use arthro_geometry::frame::Frame;
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::jaw::{Bite, Jaw};
use crate::voxels::Voxels;

pub use blind::{Blind, Reason};
pub use optics::{Look, Optics};
pub use segment::Segment;

/// Radii of forceps' shafts that are taken, mm.
pub const FORCEPS_RADIUS_MM: RangeInclusive<f64> = 0.25..=5.0;

/// How much of a shaft counts behind its tip, mm: 8 inch, the longest punch of the AORN instruments
/// page. It reaches out of the portal, where shafts may meet too.
const SHAFT_LENGTH_MM: f64 = 203.0;

/// What is to be seen, from where, and what stands in the way.
pub struct Scene<'a> {
    /// Where the arthroscope enters, mm.
    pub portal: Point3,
    /// The bites in the order of execution. Their forceps come along their `approach`.
    pub bites: &'a [Bite],
    /// The forceps' jaw.
    pub jaw: Jaw,
    /// Radius of the forceps' shaft, mm.
    pub forceps_radius_mm: f64,
    /// The meniscus before the first bite: what is bitten away hides less, never more.
    pub tissue: &'a Voxels,
    /// Distance from the axis of a shaft in the joint to the nearest bone, mm; infinite where the
    /// bones are not known.
    pub bone_mm: &'a dyn Fn(&Segment) -> f64,
    /// The arthroscope.
    pub optics: &'a Optics,
}

/// How the arthroscope looks at one bite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the shaft ends, mm.
    pub tip: Point3,
    /// Unit direction along the shaft, out of the tip.
    pub approach: Vector3,
    /// Unit direction of the middle of the image.
    pub optical_axis: Vector3,
    /// Turn of the optics about the shaft, see [`Optics::axis`].
    pub roll_rad: f64,
    /// From the portal to the tip, mm.
    pub depth_mm: f64,
    /// Angle between the optical axis and the middle of the jaw.
    pub bite_offset_rad: f64,
    /// From the tip to the middle of the jaw, mm.
    pub distance_mm: f64,
    /// Between the surfaces of both shafts, mm.
    pub forceps_clearance_mm: f64,
    /// Share of the jaw's footprint that tissue or the forceps' shaft hide, percent.
    pub occluded_percent: f64,
}

impl View {
    /// The same view in another frame.
    pub fn carried<A: Frame, B: Frame>(&self, a_from_b: &Rigid<A, B>) -> Self {
        Self {
            tip: *a_from_b * self.tip,
            approach: a_from_b.direction(&self.approach),
            optical_axis: a_from_b.direction(&self.optical_axis),
            ..*self
        }
    }
}

/// One view for each bite, in their order. `watch` hears the share done and may end the work.
///
/// # Errors
/// [`Blind`] names the first bite that cannot be seen, what came closest to showing it, and what
/// would; or the value of the scene that cannot be right.
pub fn plan(
    scene: &Scene<'_>,
    mut watch: impl FnMut(f64) -> ControlFlow<()>,
) -> Result<Vec<View>, Blind> {
    check(scene)?;
    let surroundings = poses::Surroundings::of(scene);
    let mut layers = Vec::with_capacity(scene.bites.len());
    for (index, bite) in scene.bites.iter().enumerate() {
        if watch(index as f64 / scene.bites.len() as f64).is_break() {
            return Err(Blind::Cancelled);
        }
        let poses = surroundings.poses(bite).map_err(|reason| Blind::Bite {
            bite: index,
            reason,
        })?;
        layers.push(poses);
    }
    Ok(sequence::shortest(&layers))
}

fn check(scene: &Scene<'_>) -> Result<(), Blind> {
    if let Some((field, problem)) = scene.optics.problems().into_iter().next() {
        return Err(Blind::Invalid { field, problem });
    }
    let invalid = |field, problem| Err(Blind::Invalid { field, problem });
    if !FORCEPS_RADIUS_MM.contains(&scene.forceps_radius_mm) {
        let (low, high) = (FORCEPS_RADIUS_MM.start(), FORCEPS_RADIUS_MM.end());
        let problem = format!("is {}; must be {low} .. {high}", scene.forceps_radius_mm);
        return invalid("forceps_radius_mm", problem);
    }
    if !(scene.jaw.length_mm.is_finite() && scene.jaw.width_mm.is_finite()) {
        return invalid("jaw", "is not finite".into());
    }
    if !is_finite(&scene.portal.coords) {
        return invalid("portal", "is not finite".into());
    }
    for (index, bite) in scene.bites.iter().enumerate() {
        if ![bite.center.coords, bite.approach, bite.opening]
            .iter()
            .all(is_finite)
        {
            return invalid("bites", format!("[{index}] is not finite"));
        }
    }
    Ok(())
}

fn is_finite(vector: &Vector3) -> bool {
    vector.iter().all(|value| value.is_finite())
}
