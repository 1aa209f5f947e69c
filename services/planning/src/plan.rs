//! Plans a resection: voxels, target, bites, evaluation, in this order.

mod approach;
mod model;
mod scoring;

use std::ops::ControlFlow;

use arthro_geometry::{Mesh, Point3};

use crate::bites::{self, Access, Ended, Found, Partial, Patience};
use crate::contour::Spline;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::evaluation::time::Timing;
use crate::evaluation::{Evaluation, Task};
use crate::jaw::{Bite, Jaw};
use crate::lesion::Lesion;
use crate::paper::{self, Search};
use crate::reach::{Clearance, Knee};
use crate::target::{self, Target};
use crate::tissue::THROAT_LIMIT;
use crate::view::{self, Optics, View};
use crate::voxels::Voxels;

use approach::Approach;

pub use model::model;
pub use scoring::{EvaluationRequest, Given, evaluate};

/// Least volume worth a plan, mm3.
const MIN_REGION_MM3: f64 = 1.5;
/// Distance between the points of a contour handed out, mm.
const CONTOUR_SPACING_MM: f64 = 0.2;
/// What is aimed at outside the region if nothing is said: so much, and this share of the region, mm3.
const USUAL_OUTSIDE: (f64, f64) = (2.0, 0.04);
/// What may go outside the region where that is too little, mm3.
const MOST_OUTSIDE_MM3: f64 = 15.0;

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

/// What a planner hands back, in the axes of the crescent.
struct Bitten {
    bites: Vec<(usize, Bite)>,
    path: Vec<Point3>,
    choice: Option<Choice>,
}

/// What both planners work on.
struct Work<'a> {
    request: &'a Request,
    task: &'a Task<'a>,
    approach: &'a Approach<'a>,
    contour: &'a Spline,
    placement_error_mm: Option<f64>,
    region_mm3: f64,
}

impl Work<'_> {
    fn in_box(&self, point: &Point3) -> bool {
        let Some((low, high)) = self.request.target_box else {
            return true;
        };
        let point = self.task.crescent.ct_from_meniscal * *point;
        point.inf(&low) == low && point.sup(&high) == high
    }

    fn fewest(
        &self,
        patience: &(dyn Fn() -> Patience + Sync),
        watch: &mut dyn FnMut(Progress),
    ) -> Result<Bitten, Error> {
        let limits = &self.request.limits;
        let access = Access {
            portals: self.task.portals,
            allowed: &|portal, bite| {
                self.in_box(&bite.center) && self.approach.is_clear(portal, bite)
            },
            rim_min_mm: self.request.contour_rules.rim_min_mm,
            placement_error_mm: self.placement_error_mm,
        };
        let (base_mm3, share) = USUAL_OUTSIDE;
        let usual_mm3 = (base_mm3 + share * self.region_mm3).min(MOST_OUTSIDE_MM3);
        let usual_limits_mm3 = [usual_mm3, MOST_OUTSIDE_MM3];
        let outside_limits_mm3 = limits.outside_limit_mm3.map(|limit_mm3| [limit_mm3; 2]);
        let rules = bites::Rules {
            region_share: limits.region_percent / 100.0,
            outside_limits_mm3: outside_limits_mm3.unwrap_or(usual_limits_mm3),
            throat_limit: self.task.throat_limit,
            partial: limits.partial,
        };
        let mut hear = |found: Found| {
            watch(Progress {
                stage: "bites",
                fraction: 0.2 + 0.75 * found.fraction,
                iterations: 0,
                incumbent: found.incumbent,
                bound: found.bound,
            });
        };
        let effort = bites::Effort {
            seed: self.request.seed,
            factor: self.request.effort,
        };
        let chosen = bites::choose(self.task, &access, &rules, &effort, patience, &mut hear);
        let chosen = chosen.map_err(|refusal| self.approach.explained(refusal))?;
        if chosen.bites.is_empty() {
            let region_mm3 = self.region_mm3;
            return Err(Error::NoBite { region_mm3 });
        }
        Ok(Bitten {
            bites: chosen.bites,
            path: Vec::new(),
            choice: Some(Choice {
                bound: chosen.bound,
                complete: chosen.complete,
                ended: chosen.ended,
            }),
        })
    }

    fn paper(
        &self,
        search: &Search,
        patience: &(dyn Fn() -> Patience + Sync),
        watch: &mut dyn FnMut(Progress),
    ) -> Result<Bitten, Error> {
        let allowed = |point: &Point3| self.in_box(point);
        let path = paper::search(
            self.contour,
            self.task.voxels,
            search,
            allowed,
            |iterations| {
                let share = f64::from(iterations) / f64::from(search.max_iterations);
                watch(Progress {
                    stage: "rrt",
                    fraction: 0.2 + 0.75 * share,
                    iterations,
                    incumbent: None,
                    bound: None,
                });
                match patience() {
                    Patience::GoOn => ControlFlow::Continue(()),
                    // Half a path is no path.
                    Patience::Hurry | Patience::Stop => ControlFlow::Break(()),
                }
            },
        )?;
        let superior = arthro_geometry::Vector3::z();
        let bites = paper::bites(&path.points, &self.task.portals[0], &superior)?;
        Ok(Bitten {
            bites: bites.into_iter().map(|bite| (0, bite)).collect(),
            path: path.points,
            choice: None,
        })
    }
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
