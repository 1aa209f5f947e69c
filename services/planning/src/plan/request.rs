//! What is asked of a plan.

use arthro_geometry::{Mesh, Point3};

use crate::bites::Partial;
use crate::jaw::Jaw;
use crate::paper::Search;
use crate::reach::Knee;
use crate::target;
use crate::tissue::THROAT_LIMIT;
use crate::view::Optics;

/// What is to be planned; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Request {
    /// The meniscus, a closed surface.
    pub model: Mesh,
    /// The damaged tissue on a grid; may be empty.
    pub lesion: Vec<Point3>,
    /// Distance between the lesion's points, mm.
    pub lesion_spacing_mm: f64,
    /// What the contour comes from.
    pub aim: target::Aim,
    /// What the contour has to keep.
    pub contour_rules: target::Rules,
    /// Lowest and highest corner of the box that holds all targets; `None`: anywhere.
    pub target_box: Option<(Point3, Point3)>,
    /// Where the forceps may enter; the first is the one they start with.
    pub portals: Vec<Point3>,
    /// The jaw of the forceps.
    pub jaw: Jaw,
    /// Edge of the planning voxels, mm.
    pub voxel_mm: f64,
    /// How the bites are chosen.
    pub planner: Planner,
    /// What the bites have to keep.
    pub limits: Limits,
    /// Multiplies the search for fewer bites.
    pub effort: u32,
    /// The joint around the meniscus, which the forceps' shaft keeps clear of; `None`: nothing is known.
    pub knee: Option<Knee>,
    /// From where each bite is to be watched; `None`: no views are planned.
    pub arthroscope: Option<Arthroscope>,
    /// Same seed, same plan.
    pub seed: u64,
}

/// The arthroscope that watches; `portal` in ct.
#[derive(Clone, Debug, PartialEq)]
pub struct Arthroscope {
    /// Where it enters, mm.
    pub portal: Point3,
    /// Its optics.
    pub optics: Optics,
    /// Radius of the forceps' shaft, mm.
    pub forceps_radius_mm: f64,
}

/// How the bites are chosen.
#[derive(Clone, Copy, Debug, Default)]
pub enum Planner {
    /// As few as clear the region, in an order in which each can be made.
    #[default]
    Bites,
    /// The paper's: one on every point of a path through the tissue.
    Paper(Search),
}

/// What the bites have to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Share of the region that has to go, percent.
    pub region_percent: f64,
    /// How much may go outside it, mm3; `None`: 2 mm3 and 4 % of the region, and up to 15 mm3 where
    /// no bites keep that.
    pub outside_limit_mm3: Option<f64>,
    /// How far in the plane an executed bite may lie from the planned one and still the lesion must
    /// be covered, mm.
    pub placement_error_mm: f64,
    /// Share of a jaw's throat that tissue may block when the bite is made, 0..1.
    pub throat_limit: f64,
    /// What to do where the region cannot be cleared.
    pub partial: Partial,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            region_percent: 95.0,
            outside_limit_mm3: None,
            placement_error_mm: 0.3,
            throat_limit: THROAT_LIMIT,
            partial: Partial::Refuse,
        }
    }
}
