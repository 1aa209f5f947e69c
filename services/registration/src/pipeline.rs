//! The whole registration: Super4PCS and spread rotations give poses, short refinement ranks them, scaled ICP
//! finishes the best ones, and the evidence is judged. Pure and deterministic: same input and seed, same answer on
//! any number of threads. Parallel parts run on the rayon pool of the caller.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity};

use crate::cancel::Cancel;
use crate::error::Error;
use crate::mse::mean_squared_error;
use crate::scaled_icp::{Iteration, ScaleRange};
use crate::surface::Surface;
use crate::verdict::{Evidence, Verdict};
use crate::visibility::Visibility;
use crate::{input, sampling};

mod evidence;
mod stages;

/// What is known beforehand.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Scale of camera_from_ct expected from the sensors; 1 for two metric ones.
    pub scale_prior: f64,
    /// How far the scale may be from the prior, as a fraction.
    pub scale_tolerance: f64,
    /// Where the camera stood, in the target's frame.
    pub viewpoint: Option<Point3>,
    /// Seed of the random draws.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            scale_prior: 1.0,
            scale_tolerance: 0.02,
            viewpoint: None,
            seed: 0,
        }
    }
}

/// What happens on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The coarse stage begins.
    CoarseStarted,
    /// A coarse candidate, best first.
    Candidate {
        /// 0 is the best.
        rank: u32,
        /// Share of view points near the model at the coarse pose, 0..1.
        inlier_share: f64,
        /// Eq. 15 at the coarse pose, mm2.
        mse_mm2: f64,
    },
    /// The fine stage begins.
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

/// The answer.
#[derive(Clone, Debug)]
pub struct Registration {
    /// The pose of the model in the view.
    pub camera_from_ct: Similarity<Camera, Ct>,
    /// Eq. 15 of the coarse pose that led here, mm2.
    pub coarse_mse_mm2: f64,
    /// Eq. 15 of the pose, mm2.
    pub mse_mm2: f64,
    /// Distance of each view point to the model's surface, mm of the camera frame.
    pub residuals_mm: Vec<f32>,
    /// What speaks for and against the pose.
    pub evidence: Evidence,
    /// The judgement.
    pub verdict: Verdict,
    /// Why it is not ACCEPT.
    pub reasons: Vec<String>,
}

/// A view point this near to the model is an inlier, mm.
pub const INLIER_DISTANCE_MM: f64 = 1.0;

/// Most samples of the model's surface.
const MODEL_POINTS: usize = 6000;
/// Model samples searched for congruent sets, and view samples that bases are drawn from.
const CONGRUENT_MODEL_POINTS: usize = 450;
const CONGRUENT_VIEW_POINTS: usize = 120;
/// View samples of the three refinements: many hypotheses, the best candidates, the finalists.
const SHORT_VIEW_POINTS: usize = 160;
const FINE_VIEW_POINTS: usize = 500;
const FINAL_VIEW_POINTS: usize = 2000;
/// Model samples that are tested for free space.
const FREE_SPACE_POINTS: usize = 600;

/// Registers `source`, the whole surface of the model in ct, to `target`, what the camera saw of it.
///
/// # Errors
/// [`Error::Invalid`] names every violation of [`input::check`]; [`Error::Cancelled`] once `cancel` is raised.
pub fn register(
    source: &Cloud,
    target: &Cloud,
    options: &Options,
    progress: &mut (dyn FnMut(Event) + Send),
    cancel: &Cancel,
) -> Result<Registration, Error> {
    input::check(source, target, options)?;
    let problem = Problem::new(source, target, options);
    progress(Event::CoarseStarted);
    let candidates = problem.coarse(options.seed, cancel)?;
    for (rank, candidate) in candidates.iter().enumerate() {
        let residuals_mm = problem.residuals_mm(&problem.fine_view, &candidate.coarse);
        progress(Event::Candidate {
            rank: rank as u32,
            inlier_share: evidence::inlier_share(&residuals_mm),
            mse_mm2: mean_squared_error(&problem.model, &problem.fine_view, &candidate.coarse),
        });
    }
    progress(Event::FineStarted);
    let ranked = problem.fine(candidates, progress, cancel)?;
    Ok(problem.answer(target, &ranked))
}

/// The input made ready.
struct Problem {
    model: Surface,
    congruent_model: Surface,
    congruent_view: Surface,
    short_view: Vec<Point3>,
    fine_view: Vec<Point3>,
    final_view: Vec<Point3>,
    free_space_model: Vec<Point3>,
    visibility: Option<Visibility>,
    scale: ScaleRange,
}

/// A pose under way.
#[derive(Clone, Debug)]
struct Candidate {
    /// As the coarse stage found it.
    coarse: Similarity<Ct, Camera>,
    /// As refined so far.
    refined: Similarity<Ct, Camera>,
    /// Residual in mm, stray points cut short, raised by free-space violations; lower is better.
    score: f64,
}

// === impl Problem ===

impl Problem {
    fn new(source: &Cloud, target: &Cloud, options: &Options) -> Self {
        let model = Surface::new(&source.points, MODEL_POINTS).with_lookup();
        let view = Surface::new(&target.points, FINAL_VIEW_POINTS);
        Self {
            congruent_model: model.thinned(CONGRUENT_MODEL_POINTS),
            congruent_view: view.thinned(CONGRUENT_VIEW_POINTS),
            short_view: sampling::spread(&view.points, SHORT_VIEW_POINTS),
            fine_view: sampling::spread(&view.points, FINE_VIEW_POINTS),
            free_space_model: sampling::spread(&model.points, FREE_SPACE_POINTS),
            visibility: options
                .viewpoint
                .and_then(|viewpoint| Visibility::new(&view.points, viewpoint)),
            scale: ScaleRange {
                low: options.scale_prior * (1.0 - options.scale_tolerance),
                high: options.scale_prior * (1.0 + options.scale_tolerance),
            },
            final_view: view.points,
            model,
        }
    }
}
