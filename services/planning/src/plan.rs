//! Plans a resection: voxels, target, bites, evaluation, in this order.

mod approach;
mod model;
mod request;
mod scoring;
mod work;

use std::ops::ControlFlow;

use arthro_geometry::Point3;

use crate::bites::{Ended, Patience};
use crate::crescent::Crescent;
use crate::error::Error;
use crate::evaluation::time::Timing;
use crate::evaluation::{Evaluation, Task};
use crate::jaw::Bite;
use crate::lesion::Lesion;
use crate::reach::Clearance;
use crate::target::Target;
use crate::view::{self, View};
use crate::voxels::Voxels;

use approach::Approach;
use work::{Bitten, Work};

pub use model::model;
pub use request::{Arthroscope, Limits, Planner, Request};
pub use scoring::{EvaluationRequest, Given, evaluate};

/// Least volume worth a plan, mm3.
const MIN_REGION_MM3: f64 = 1.5;
/// Distance between the points of a contour handed out, mm.
const CONTOUR_SPACING_MM: f64 = 0.2;

/// The bites and what they are made from; all points in ct, mm.
#[derive(Clone, Debug)]
pub struct Plan {
    /// In the order of execution.
    pub bites: Vec<Planned>,
    /// The new free edge that the plan aims at.
    pub contour: Vec<Point3>,
    /// The path of the paper's planner from start to goal; empty for the other.
    pub path: Vec<Point3>,
    /// The plan scored on the model it was made for; `rim_min_at` in ct.
    pub evaluation: Evaluation,
    /// How the arthroscope watches each bite; empty if none was asked for.
    pub views: Vec<View>,
    /// How good the choice is; `None` for the paper's planner, which does not choose.
    pub choice: Option<Choice>,
}

/// A bite of a plan, ct.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// The bite.
    pub bite: Bite,
    /// Through which of the request's portals.
    pub portal: usize,
    /// How much room the forceps' shaft has; `None` if nothing is known of the joint.
    pub clearance: Option<Clearance>,
}

/// How good a choice of bites is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// No fewer bites of those considered can clear enough, in whatever order.
    pub bound: usize,
    /// Whether all that was to go goes; `false` only where a partial plan was asked for.
    pub complete: bool,
    /// Why the search ended.
    pub ended: Ended,
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// The stage's name.
    pub stage: &'static str,
    /// Share of the whole work, 0..1, an estimate.
    pub fraction: f64,
    /// Iterations of the paper's search so far.
    pub iterations: u32,
    /// Bites of the best plan so far.
    pub incumbent: Option<usize>,
    /// The least number of bites possible.
    pub bound: Option<usize>,
}

/// Plans the bites. `watch` hears of the progress; `patience` is asked often and from several threads.
pub fn plan(
    request: &Request,
    patience: &(dyn Fn() -> Patience + Sync),
    watch: &mut dyn FnMut(Progress),
) -> Result<Plan, Error> {
    let mut stage = |stage, fraction| {
        watch(Progress {
            stage,
            fraction,
            iterations: 0,
            incumbent: None,
            bound: None,
        });
        match patience() {
            Patience::Stop => Err(Error::Cancelled),
            _ => Ok(()),
        }
    };
    stage("voxels", 0.0)?;
    let first = request.portals.first().ok_or_else(no_portal)?;
    let tolerance_mm = request.contour_rules.tolerance_mm;
    let (crescent, voxels) = model(&request.model, first, request.voxel_mm, tolerance_mm)?;
    model::check_places(request, &crescent, &voxels)?;
    let lesion = lesion(request, &crescent, &voxels)?;

    stage("contour", 0.1)?;
    let aim = request.aim.carried(&crescent.ct_from_meniscal.inverse());
    let rules = &request.contour_rules;
    let target = Target::draw(&aim, rules, lesion.as_ref(), &crescent, &voxels)?;

    stage("bites", 0.2)?;
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let portals = request
        .portals
        .iter()
        .map(|portal| meniscal_from_ct * *portal);
    let portals: Vec<Point3> = portals.collect();
    // A region that nobody called a lesion need not be covered by displaced bites.
    let placement_error_mm = lesion.as_ref().map(|_| request.limits.placement_error_mm);
    let lesion = lesion.unwrap_or_else(|| Lesion::inboard_of(&target.band, &crescent, &voxels));
    let task = Task {
        crescent: &crescent,
        voxels: &voxels,
        lesion: &lesion,
        band: Some(&target.band),
        jaw: request.jaw,
        portals: &portals,
        timing: Timing::default(),
        throat_limit: request.limits.throat_limit,
    };
    let region_mm3 = region_mm3(&task)?;
    let approach = Approach::of(request, &task, patience)?;
    let work = Work {
        request,
        approach: &approach,
        task: &task,
        contour: &target.spline,
        placement_error_mm,
        region_mm3,
    };
    let Bitten {
        bites,
        path,
        choice,
    } = match request.planner {
        Planner::Bites => work.fewest(patience, watch)?,
        Planner::Paper(search) => work.paper(&search, patience, watch)?,
    };

    watch(Progress {
        stage: "evaluation",
        fraction: 0.95,
        iterations: 0,
        incumbent: choice.map(|_| bites.len()),
        bound: choice.map(|choice| choice.bound),
    });
    if patience() == Patience::Stop {
        return Err(Error::Cancelled);
    }
    let local: Vec<Bite> = bites.iter().map(|(_, bite)| *bite).collect();
    let mut evaluation = task.evaluate(&local);
    evaluation.rim_min_at = crescent.ct_from_meniscal * evaluation.rim_min_at;
    let clearances = approach.clearances(&bites)?;
    let views = views(request, &task, &approach, &local, patience, watch)?;
    let into_ct = |points: Vec<Point3>| {
        let points = points.into_iter();
        points
            .map(|point| crescent.ct_from_meniscal * point)
            .collect()
    };
    let planned = |((portal, bite), clearance): (&(usize, Bite), Option<Clearance>)| Planned {
        bite: target
            .meeting(bite, &task.jaw)
            .carried(&crescent.ct_from_meniscal),
        portal: *portal,
        clearance,
    };
    Ok(Plan {
        bites: bites.iter().zip(clearances).map(planned).collect(),
        contour: into_ct(target.spline.points_every(CONTOUR_SPACING_MM)),
        path: into_ct(path),
        evaluation,
        views,
        choice,
    })
}

/// The arthroscope's views in ct, if any were asked for.
fn views(
    request: &Request,
    task: &Task<'_>,
    approach: &Approach<'_>,
    bites: &[Bite],
    patience: &(dyn Fn() -> Patience + Sync),
    watch: &mut dyn FnMut(Progress),
) -> Result<Vec<View>, Error> {
    let Some(arthroscope) = &request.arthroscope else {
        return Ok(Vec::new());
    };
    let ct_from_meniscal = &task.crescent.ct_from_meniscal;
    let scene = view::Scene {
        portal: ct_from_meniscal.inverse() * arthroscope.portal,
        bites,
        jaw: task.jaw,
        forceps_radius_mm: arthroscope.forceps_radius_mm,
        tissue: task.voxels,
        bone_mm: &|shaft| approach.bone_mm(shaft),
        optics: &arthroscope.optics,
    };
    let views = view::plan(&scene, |share| {
        watch(Progress {
            stage: "view",
            fraction: 0.96 + 0.04 * share,
            iterations: 0,
            incumbent: None,
            bound: None,
        });
        match patience() {
            Patience::Stop => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    })?;
    Ok(views
        .iter()
        .map(|view| view.carried(ct_from_meniscal))
        .collect())
}

fn no_portal() -> Error {
    Error::invalid("options.portal", "is missing; the forceps need one")
}

fn lesion(
    request: &Request,
    crescent: &Crescent,
    voxels: &Voxels,
) -> Result<Option<Lesion>, Error> {
    if request.lesion.is_empty() {
        return Ok(None);
    }
    let (points, spacing_mm) = (&request.lesion, request.lesion_spacing_mm);
    let tolerance_mm = request.contour_rules.tolerance_mm;
    Lesion::of(points, spacing_mm, crescent, voxels, tolerance_mm).map(Some)
}

fn region_mm3(task: &Task<'_>) -> Result<f64, Error> {
    let inboard = task.region().iter().filter(|inboard| **inboard).count();
    let region_mm3 = inboard as f64 * task.voxels.voxel_mm3();
    if region_mm3 < MIN_REGION_MM3 {
        return Err(Error::NothingToRemove {
            region_mm3,
            limit_mm3: MIN_REGION_MM3,
        });
    }
    Ok(region_mm3)
}
