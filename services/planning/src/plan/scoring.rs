//! Scores a list of bites on a model, from whatever source they come.

use arthro_geometry::{Mesh, Point3};

use super::model::{EXTENT_MM, model};
use crate::band::Band;
use crate::error::Error;
use crate::evaluation::time::Timing;
use crate::evaluation::{Evaluation, Task};
use crate::jaw::{Bite, Jaw};
use crate::lesion::Lesion;
use crate::tissue::THROAT_LIMIT;

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
    /// The bites, from whatever source.
    pub bites: Vec<Bite>,
    /// The jaw of the forceps.
    pub jaw: Jaw,
    /// Edge of the voxels, mm.
    pub voxel_mm: f64,
}

/// Scores bites on a model; `rim_min_at` in ct.
pub fn evaluate(request: &EvaluationRequest) -> Result<Evaluation, Error> {
    if request.lesion.is_empty() && request.contour.is_empty() {
        return Err(Error::invalid(
            "options.contour",
            "is empty and no lesion is given; at least one of them says what was to be removed",
        ));
    }
    // The jaws open upwards; without a bite any side is as good.
    let above = request.bites.first().map_or_else(Point3::origin, |bite| {
        bite.center + bite.opening * *EXTENT_MM.end()
    });
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
        _ => Lesion::of(
            &request.lesion,
            request.lesion_spacing_mm,
            &crescent,
            &voxels,
            TOLERANCE_MM,
        )?,
    };
    let task = Task {
        crescent: &crescent,
        voxels: &voxels,
        lesion: &lesion,
        band: band.as_ref(),
        jaw: request.jaw,
        portals: &[],
        timing: Timing::default(),
        throat_limit: THROAT_LIMIT,
    };
    let bites: Vec<Bite> = request
        .bites
        .iter()
        .map(|bite| bite.carried(&meniscal_from_ct))
        .collect();
    let mut evaluation = task.evaluate(&bites);
    evaluation.rim_min_at = crescent.ct_from_meniscal * evaluation.rim_min_at;
    Ok(evaluation)
}
