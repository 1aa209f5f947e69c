//! The whole registration behind one function: a pose by one of two methods, the evidence for it, the verdict.
//! Pure and deterministic: same input and seed, same answer on any number of threads. Parallel parts run on the rayon
//! pool of the caller.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity};

use crate::budget::Budget;
use crate::covariance::Covariance;
use crate::error::{Error, Violation};
use crate::evidence::{self, Evidence};
use crate::gate::{self, Verdict};
use crate::mse::mean_squared_error;
use crate::problem::Problem;
use crate::scale::ScaleRange;
use crate::{input, paper, robust};

/// How the pose is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Every pose and scale is tried, the physics of the view judges.
    #[default]
    Robust,
    /// As the paper has it: Super4PCS with the scale of the bounding boxes (Eq. 1-4), then scaled ICP (Eq. 5-7).
    Paper,
}

/// What is known beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How the pose is found.
    pub method: Method,
    /// The scales that camera_from_ct may have.
    pub scale: ScaleRange,
    /// Where the camera stood, in the target's frame.
    pub viewpoint: Option<Point3>,
    /// Box in ct whose error matters; all of the model if not given.
    pub target_region: Option<(Point3, Point3)>,
    /// Seed of the random draws of the paper's method; the robust one has none.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::default(),
            scale: ScaleRange::known(1.0),
            viewpoint: None,
            target_region: None,
            seed: 0,
        }
    }
}

/// What happens on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A coarse stage begins.
    CoarseStarted,
    /// The hypotheses of one more scale were tried.
    Searched {
        /// Scales tried so far.
        scales: u32,
        /// Scales that this round tries.
        scales_in_all: u32,
        /// The best pose so far.
        best: Similarity<Camera, Ct>,
        /// Its residual, mm of the view.
        score_mm: f64,
    },
    /// A coarse candidate, best first.
    Candidate {
        /// 0 is the best.
        rank: u32,
        /// Its pose before any refinement.
        camera_from_ct: Similarity<Camera, Ct>,
        /// Share of view points near the model there, 0..1.
        inlier_share: f64,
        /// Eq. 15 there, mm2 of the model.
        mse_mm2: f64,
    },
    /// A fine stage begins.
    FineStarted,
    /// One iteration of the fine stage.
    Iteration {
        /// Rank of the candidate that is refined.
        candidate: u32,
        /// Number of the iteration.
        iteration: u32,
        /// State before its step.
        state: Iteration,
    },
}

/// One iteration of the fine stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// Weighted mean squared distance of the points that count, mm2 of the model.
    pub mse_mm2: f64,
    /// Scale of camera_from_ct.
    pub scale: f64,
}

/// The answer.
#[derive(Clone, Debug)]
pub struct Registration {
    /// The pose of the model in the view.
    pub camera_from_ct: Similarity<Camera, Ct>,
    /// Eq. 15 of the coarse pose that led here, mm2 of the model.
    pub coarse_mse_mm2: f64,
    /// Eq. 15 of the pose, mm2 of the model.
    pub mse_mm2: f64,
    /// Distance of each view point to the model's surface, mm of the model.
    pub residuals_mm: Vec<f32>,
    /// Covariance of turn (rad, about the model's centre, in ct), shift (mm) and logarithm of scale.
    pub covariance: Covariance,
    /// What the turn is about, in ct: the model's centre.
    pub covariance_about: Point3,
    /// What stays where it is when the scale changes, in ct: the view's centre.
    pub scale_about: Point3,
    /// What speaks for and against the pose.
    pub evidence: Evidence,
    /// The judgement.
    pub verdict: Verdict,
    /// Why it is not ACCEPT.
    pub reasons: Vec<String>,
}

/// Registers `source`, the whole surface of the model in ct, to `target`, what the camera saw of it.
///
/// # Errors
/// [`Error::Invalid`] names every violation of [`input::check`], or a target region beside the model; [`Error::Cancelled`] once `budget` is cancelled;
/// [`Error::NothingFound`] if no pose can be formed at all.
pub fn register(
    source: &Cloud,
    target: &Cloud,
    options: &Options,
    progress: &mut (dyn FnMut(Event) + Send),
    budget: &Budget,
) -> Result<Registration, Error> {
    input::check(source, target, options)?;
    let problem = Problem::new(source, target, options.viewpoint, options.scale);
    budget.check()?;
    let targets = targets(&problem, options)?;
    let ranked = match options.method {
        Method::Robust => robust::candidates(&problem, progress, budget)?,
        Method::Paper => paper::candidates(&problem, options.seed, progress, budget)?,
    };
    let best = *ranked.first().ok_or(Error::NothingFound)?;
    let (evidence, covariance) = evidence::whole(&problem, &ranked, &targets, budget)?;
    let (verdict, reasons) = gate::judge(&evidence);
    Ok(Registration {
        camera_from_ct: problem.camera_from_ct(&best.pose),
        coarse_mse_mm2: mean_squared_error(&problem, &problem.view.dense, &best.coarse),
        mse_mm2: mean_squared_error(&problem, &problem.view.dense, &best.pose),
        residuals_mm: residuals(&problem, target, &best.pose),
        covariance,
        covariance_about: problem.model.center,
        scale_about: problem.model.center + best.pose.translation_mm,
        evidence,
        verdict,
        reasons,
    })
}

/// The model's samples in the target region, or all of them, about the model's centre.
fn targets(problem: &Problem, options: &Options) -> Result<Vec<Point3>, Error> {
    let samples = problem.model.points.iter().copied();
    let Some((low, high)) = options.target_region else {
        return Ok(samples.collect());
    };
    let center = problem.model.center.coords;
    let (low, high) = (low - center, high - center);
    let inside: Vec<Point3> = samples
        .filter(|p| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis])))
        .collect();
    if inside.is_empty() {
        let (low, high) = (low + center, high + center);
        return Err(Error::Invalid(vec![Violation::new(
            "target_region",
            format!(
                "is {low} to {high} and holds nothing of the source, must hold some of its surface"
            ),
        )]));
    }
    Ok(inside)
}

/// Of every point of the target, in its order.
fn residuals(problem: &Problem, target: &Cloud, pose: &crate::problem::Pose) -> Vec<f32> {
    use rayon::prelude::*;
    target
        .points
        .par_iter()
        .with_min_len(256)
        .map(|point| {
            let about = point - problem.view.center.coords;
            problem.model.foot(&(*pose * about)).distance2.sqrt() as f32
        })
        .collect()
}
