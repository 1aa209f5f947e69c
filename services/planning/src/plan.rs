//! Plans a resection: voxels, reference contour, path, bites, evaluation, in this order.

use std::ops::ControlFlow;

use arthro_geometry::{Mesh, Point3};

use crate::band::Band;
use crate::bites::{self, Access};
use crate::crescent::Crescent;
use crate::error::Error;
use crate::evaluation::{Evaluation, Task};
use crate::jaw::{Bite, Jaw};
use crate::lesion::Lesion;
use crate::paper::{self, Search};
use crate::reference::{Ends, Reference};
use crate::voxels::Voxels;

/// How far a lesion's points are looked for beside the tissue of a model that is scored, mm.
const DEFAULT_TOLERANCE_MM: f64 = 1.0;
/// Extent that a meniscus has, mm: a mesh in metres or inches is neither.
const EXTENT_MM: std::ops::RangeInclusive<f64> = 10.0..=150.0;
/// How far the volume by the triangles' direction may be from the solid's, as a share.
const VOLUME_MISMATCH: f64 = 0.3;
/// Distance of the portal from the nearest voxel of tissue, mm.
const PORTAL_CLEARANCE_MM: f64 = 5.0;
/// Least volume worth a plan, mm3.
const MIN_REGION_MM3: f64 = 1.5;
/// Distance between the points of a contour handed out, mm.
const CONTOUR_SPACING_MM: f64 = 0.5;

/// What is to be planned; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Request {
    /// The meniscus, a closed surface.
    pub model: Mesh,
    /// The damaged tissue on a grid; empty: what lies between the free edge and the contour.
    pub lesion: Vec<Point3>,
    /// Distance between the lesion's points, mm.
    pub lesion_spacing_mm: f64,
    /// Where the contour begins.
    pub start: Point3,
    /// Where the contour ends.
    pub goal: Point3,
    /// Lowest and highest corner of the box that holds all targets.
    pub target_box: (Point3, Point3),
    /// Where the forceps enter.
    pub portal: Point3,
    /// The jaw of the forceps.
    pub jaw: Jaw,
    /// Edge of the planning voxels, mm.
    pub voxel_mm: f64,
    /// Rim that must be left, mm.
    pub rim_min_mm: f64,
    /// How the path is searched.
    pub search: Search,
}

/// The bites and what they are made from; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Plan {
    /// In the order of execution.
    pub bites: Vec<Bite>,
    /// The new free edge that the plan aims at.
    pub contour: Vec<Point3>,
    /// The path of the RRT from start to goal.
    pub path: Vec<Point3>,
    /// The plan scored on the model it was made for; `rim_min_at` in ct.
    pub evaluation: Evaluation,
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage's name.
    pub stage: &'static str,
    /// RRT iterations so far.
    pub iterations: u32,
    /// Share of the whole work, 0..1, an estimate.
    pub fraction: f64,
}

/// Hears of the progress and may end the work.
pub type Watch<'a> = &'a mut dyn FnMut(Progress) -> ControlFlow<()>;

/// Plans the bites.
pub fn plan(request: &Request, watch: Watch<'_>) -> Result<Plan, Error> {
    let mut iterations = 0;
    let mut report = |stage, iterations, fraction| {
        let progress = Progress {
            stage,
            iterations,
            fraction,
        };
        watch(progress)
    };
    go_on(report("voxels", 0, 0.0))?;
    let tolerance_mm = request.search.tolerance_mm;
    let (crescent, voxels) = model(
        &request.model,
        &request.portal,
        request.voxel_mm,
        tolerance_mm,
    )?;
    check_places(request, &crescent, &voxels)?;
    let lesion = match request.lesion.as_slice() {
        [] => None,
        points => Some(Lesion::of(
            points,
            request.lesion_spacing_mm,
            &crescent,
            &voxels,
            tolerance_mm,
        )?),
    };

    go_on(report("contour", 0, 0.1))?;
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let ends = Ends {
        start: meniscal_from_ct * request.start,
        goal: meniscal_from_ct * request.goal,
        tolerance_mm,
        rim_min_mm: request.rim_min_mm,
    };
    let reference = Reference::draw(&ends, lesion.as_ref(), &crescent, &voxels)?;

    go_on(report("rrt", 0, 0.2))?;
    let (low, high) = request.target_box;
    let in_box = |point: &Point3| {
        let point = crescent.ct_from_meniscal * *point;
        point.inf(&low) == low && point.sup(&high) == high
    };
    let path = paper::search(
        &reference.spline,
        &voxels,
        &request.search,
        in_box,
        |iteration| {
            iterations = iteration;
            let share = f64::from(iteration) / f64::from(request.search.max_iterations);
            report("rrt", iteration, 0.2 + 0.2 * share)
        },
    )?;

    go_on(report("bites", path.iterations, 0.4))?;
    // A region that nobody called a lesion need not survive a displaced bite.
    let placement_error_mm = lesion.as_ref().map_or(0.0, |_| bites::PLACEMENT_ERROR_MM);
    let lesion = lesion.unwrap_or_else(|| Lesion::inboard_of(&reference.band, &crescent, &voxels));
    let task = Task {
        crescent: &crescent,
        voxels: &voxels,
        lesion: &lesion,
        band: Some(&reference.band),
        jaw: request.jaw,
    };
    let inboard = task.region().iter().filter(|inboard| **inboard).count();
    let region_mm3 = inboard as f64 * voxels.voxel_mm3();
    if region_mm3 < MIN_REGION_MM3 {
        return Err(Error::NothingToRemove {
            region_mm3,
            limit_mm3: MIN_REGION_MM3,
        });
    }
    let access = Access {
        portal: meniscal_from_ct * request.portal,
        allowed: &in_box,
        rim_min_mm: request.rim_min_mm,
        placement_error_mm,
    };
    let bites = bites::choose(&task, &reference.spline, &access, |share| {
        report("bites", path.iterations, 0.4 + 0.5 * share)
    })?;
    if bites.is_empty() {
        return Err(Error::NoBite { region_mm3 });
    }

    go_on(report("evaluation", path.iterations, 0.9))?;
    let mut evaluation = task.evaluate(&bites);
    evaluation.rim_min_at = crescent.ct_from_meniscal * evaluation.rim_min_at;
    let into_ct = |points: Vec<Point3>| {
        let points = points.into_iter();
        points
            .map(|point| crescent.ct_from_meniscal * point)
            .collect()
    };
    Ok(Plan {
        bites: bites
            .iter()
            .map(|bite| bite.carried(&crescent.ct_from_meniscal))
            .collect(),
        contour: into_ct(reference.spline.points_every(CONTOUR_SPACING_MM)),
        path: into_ct(path.points),
        evaluation,
    })
}

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
    let (crescent, voxels) = model(
        &request.model,
        &above,
        request.voxel_mm,
        DEFAULT_TOLERANCE_MM,
    )?;
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
            DEFAULT_TOLERANCE_MM,
        )?,
    };
    let task = Task {
        crescent: &crescent,
        voxels: &voxels,
        lesion: &lesion,
        band: band.as_ref(),
        jaw: request.jaw,
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

/// The crescent and the voxels of a model, checked to have the size of a meniscus.
pub fn model(
    mesh: &Mesh,
    above: &Point3,
    voxel_mm: f64,
    margin_mm: f64,
) -> Result<(Crescent, Voxels), Error> {
    arthro_geometry::volume::check(mesh)?;
    let (low, high) = mesh.bounds().ok_or(arthro_geometry::volume::Error::Empty)?;
    let extent_mm = (high - low).max();
    if !EXTENT_MM.contains(&extent_mm) {
        return Err(Error::invalid(
            "model",
            format!(
                "is {extent_mm:.4} mm long; must be {} .. {} mm: are the vertices in millimetres?",
                EXTENT_MM.start(),
                EXTENT_MM.end()
            ),
        ));
    }
    let crescent = Crescent::of(mesh, above)?;
    let voxels = Voxels::of(mesh, &crescent, voxel_mm, margin_mm)?;
    let solid_mm3 = voxels.centers().len() as f64 * voxels.voxel_mm3();
    let signed_mm3 = mesh.volume_mm3().abs();
    if (signed_mm3 / solid_mm3 - 1.0).abs() > VOLUME_MISMATCH {
        return Err(Error::invalid(
            "model",
            format!(
                "has triangles that face both ways: they enclose {signed_mm3:.0} mm3 by their \
                 direction and {solid_mm3:.0} mm3 by their place"
            ),
        ));
    }
    Ok((crescent, voxels))
}

/// Start, goal, box and portal must fit the tissue.
fn check_places(request: &Request, crescent: &Crescent, voxels: &Voxels) -> Result<(), Error> {
    let (low, high) = request.target_box;
    let in_box = |point: &Point3| point.inf(&low) == low && point.sup(&high) == high;
    let tissue = voxels.centers().iter();
    if !tissue
        .clone()
        .any(|center| in_box(&(crescent.ct_from_meniscal * *center)))
    {
        return Err(Error::invalid(
            "options.target_box",
            "holds no tissue of the model",
        ));
    }
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let limit_mm = request.search.tolerance_mm;
    for (field, point) in [
        ("options.start", request.start),
        ("options.goal", request.goal),
    ] {
        if !in_box(&point) {
            return Err(Error::invalid(field, "lies outside options.target_box"));
        }
        if voxels
            .distance_mm(&(meniscal_from_ct * point), limit_mm)
            .is_none()
        {
            return Err(Error::invalid(
                field,
                format!("is further than options.tolerance_mm, {limit_mm} mm, from tissue"),
            ));
        }
    }
    let portal = meniscal_from_ct * request.portal;
    if let Some(distance_mm) = voxels.distance_mm(&portal, PORTAL_CLEARANCE_MM) {
        return Err(Error::invalid(
            "options.portal",
            format!(
                "is {distance_mm:.1} mm from tissue; must be more than {PORTAL_CLEARANCE_MM} mm"
            ),
        ));
    }
    Ok(())
}

fn go_on(flow: ControlFlow<()>) -> Result<(), Error> {
    match flow {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Cancelled),
    }
}
