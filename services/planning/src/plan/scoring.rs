//! Scores a list of bites on a model, from whatever source they come.

use arthro_geometry::frame::Ct;
use arthro_geometry::{Mesh, Point3, Rigid, Vector3};

use super::model::{EXTENT_MM, model};
use crate::band::Band;
use crate::crescent::Meniscal;
use crate::error::Error;
use crate::evaluation::time::Timing;
use crate::evaluation::{Evaluation, Task};
use crate::jaw::{Bite, Jaw};
use crate::lesion::Lesion;

/// How far a lesion's points are looked for beside the tissue, mm.
const TOLERANCE_MM: f64 = 1.0;

/// Bites to be scored; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct EvaluationRequest {
    /// The meniscus, a closed surface.
    pub model: Mesh,
    /// The damaged tissue on a grid; empty: what lies inboard of the contour.
    pub lesion: Vec<Point3>,
    /// Distance between the lesion's points, mm.
    pub lesion_spacing_mm: f64,
    /// The new free edge that was aimed at; empty: the lesion is the region.
    pub contour: Vec<Point3>,
    /// The bites, from whatever source, in the order of execution.
    pub bites: Vec<Given>,
    /// Where the forceps enter; may be empty.
    pub portals: Vec<Point3>,
    /// The jaw of the forceps.
    pub jaw: Jaw,
    /// Share of a jaw's throat that tissue may block, 0..1.
    pub throat_limit: f64,
    /// Edge of the voxels, mm.
    pub voxel_mm: f64,
}

/// A bite as others state it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Given {
    /// Middle of the jaw, ct, mm.
    pub center: Point3,
    /// Along the jaw, out of the portal into the joint; of any length.
    pub axis: Vector3,
    /// Unit direction in which the jaw opens, at right angles to the axis; `None`: superior, as far as
    /// the axis lets it.
    pub opening: Option<Vector3>,
}

impl From<&Bite> for Given {
    fn from(bite: &Bite) -> Self {
        Self {
            center: bite.center,
            axis: bite.approach,
            opening: Some(bite.opening),
        }
    }
}

impl Given {
    /// The bite with this index in the axes of the crescent.
    fn read(&self, index: usize, meniscal_from_ct: &Rigid<Meniscal, Ct>) -> Result<Bite, Error> {
        let center = *meniscal_from_ct * self.center;
        let axis = meniscal_from_ct.direction(&self.axis);
        let superior = match self.opening {
            Some(opening) => meniscal_from_ct.direction(&opening),
            None => Vector3::z(),
        };
        Bite::of_axis(center, &axis, &superior).map_err(|error| error.of_bite(index))
    }
}

/// Scores bites on a model; `rim_min_at` in ct. Without lesion and contour there is no region: what
/// is removed, what rim it leaves and whether the order can be made are scored all the same.
pub fn evaluate(request: &EvaluationRequest) -> Result<Evaluation, Error> {
    let above = above(request);
    let (crescent, voxels) = model(&request.model, &above, request.voxel_mm, TOLERANCE_MM)?;
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let contour: Vec<Point3> = request
        .contour
        .iter()
        .map(|point| meniscal_from_ct * *point)
        .collect();
    let band = (!contour.is_empty()).then(|| Band::inboard_of(&contour, &crescent));
    let lesion = match &band {
        Some(band) if request.lesion.is_empty() => Lesion::inboard_of(band, &crescent, &voxels),
        None if request.lesion.is_empty() => {
            Lesion::of_voxels(vec![false; voxels.centers().len()], &voxels)
        }
        _ => Lesion::of(
            &request.lesion,
            request.lesion_spacing_mm,
            &crescent,
            &voxels,
            TOLERANCE_MM,
        )?,
    };
    let portals = request.portals.iter();
    let portals: Vec<Point3> = portals.map(|portal| meniscal_from_ct * *portal).collect();
    let task = Task {
        crescent: &crescent,
        voxels: &voxels,
        lesion: &lesion,
        band: band.as_ref(),
        jaw: request.jaw,
        portals: &portals,
        timing: Timing::default(),
        throat_limit: request.throat_limit,
    };
    let read = request.bites.iter().enumerate();
    let bites: Vec<Bite> = read
        .map(|(index, bite)| bite.read(index, &meniscal_from_ct))
        .collect::<Result<_, _>>()?;
    let mut evaluation = task.evaluate(&bites);
    evaluation.rim_min_at = crescent.ct_from_meniscal * evaluation.rim_min_at;
    Ok(evaluation)
}

/// A point on the side that the jaws open to or the portals lie on. A cut has no end along its
/// opening, so that without either any side is as good.
fn above(request: &EvaluationRequest) -> Point3 {
    let opening = request.bites.iter().find_map(|bite| {
        let opening = bite.opening?;
        Some(bite.center + opening * *EXTENT_MM.end())
    });
    let portal = request.portals.first().copied();
    opening.or(portal).unwrap_or_else(Point3::origin)
}
