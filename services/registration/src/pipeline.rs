//! The whole registration: Super4PCS and spread rotations give poses, short refinement ranks them, scaled ICP
//! finishes the best ones, and the evidence is judged. Pure and deterministic: same input and seed, same answer on
//! any number of threads. Parallel parts run on the rayon pool of the caller.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity};
use rayon::prelude::*;

use crate::cancel::Cancel;
use crate::error::Error;
use crate::input;
use crate::mse::{MATCHED_SHARE, mean_squared_error};
use crate::scaled_icp::{self, Iteration, ScaleRange, Start};
use crate::surface::{Matching, Surface};
use crate::verdict::{self, Evidence, Verdict};
use crate::visibility::Visibility;
use crate::{sampling, seeds, super4pcs};

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

const BASES: usize = 24;
const KEPT_PER_BASE: usize = 12;
const CONGRUENT_CANDIDATES: usize = 80;
const CONGRUENCE_TOLERANCE_MM: f64 = 1.3;
const ROTATION_SEEDS: usize = 120;
const COARSE_CANDIDATES: usize = 16;
const FINALISTS: usize = 4;

/// Share of the view that ranks the many hypotheses.
const SHORT_KEPT_SHARE: f64 = 0.85;
/// Weight of free-space violations against residuals.
const VIOLATION_WEIGHT: f64 = 4.0;

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
        progress(Event::Candidate {
            rank: rank as u32,
            inlier_share: problem.inlier_share(&problem.fine_view, &candidate.coarse),
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
    /// Trimmed residual in mm, raised by free-space violations; lower is better.
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

    /// Distinct candidates, best first.
    fn coarse(&self, seed: u64, cancel: &Cancel) -> Result<Vec<Candidate>, Error> {
        let settings = super4pcs::Settings {
            bases: BASES,
            tolerance_mm: CONGRUENCE_TOLERANCE_MM,
            scale: super4pcs::aabb_scale(&self.model, &self.congruent_view, self.scale),
            kept_per_base: KEPT_PER_BASE,
        };
        let congruent = super4pcs::search(
            &self.congruent_model,
            &self.model,
            &self.congruent_view,
            &settings,
            seed,
        );
        cancel.check()?;
        let mut starts: Vec<Similarity<Ct, Camera>> = Vec::new();
        for candidate in congruent {
            let pose = candidate.ct_from_camera;
            if starts.len() < CONGRUENT_CANDIDATES
                && !starts
                    .iter()
                    .any(|other| self.alike(other, &pose, 5.0, 1.0))
            {
                starts.push(pose);
            }
        }
        starts.extend(seeds::poses(
            &self.model.points,
            &self.short_view,
            self.scale,
            ROTATION_SEEDS,
        ));
        let short = |start: &Similarity<Ct, Camera>| scaled_icp::Settings {
            point_steps: 6,
            plane_steps: 10,
            kept_share: SHORT_KEPT_SHARE,
            scale: ScaleRange::only(1.0 / start.scale),
            matching: Matching::Rough,
            start: Start::Rough,
        };
        let candidates: Vec<Candidate> = starts
            .into_par_iter()
            .map(|start| {
                cancel.check()?;
                let refined =
                    scaled_icp::refine(&self.model, &self.short_view, start, &short(&start));
                Ok(self.candidate(
                    start,
                    refined.ct_from_camera,
                    &self.short_view,
                    SHORT_KEPT_SHARE,
                ))
            })
            .collect::<Result<_, Error>>()?;
        Ok(self.distinct(candidates, COARSE_CANDIDATES, 8.0, 2.0))
    }

    /// Finished candidates, best first.
    fn fine(
        &self,
        candidates: Vec<Candidate>,
        progress: &mut (dyn FnMut(Event) + Send),
        cancel: &Cancel,
    ) -> Result<Vec<Candidate>, Error> {
        let rough = scaled_icp::Settings {
            point_steps: 4,
            plane_steps: 100,
            kept_share: MATCHED_SHARE,
            scale: self.scale,
            matching: Matching::Rough,
            start: Start::Rough,
        };
        let exact = scaled_icp::Settings {
            point_steps: 0,
            plane_steps: 40,
            matching: Matching::Exact,
            start: Start::Near,
            ..rough
        };
        let refined = self.refine_all(candidates, &self.fine_view, &rough, progress, cancel)?;
        let mut ranked = self.distinct(refined, usize::MAX, 4.0, 1.0);
        let rest = ranked.split_off(FINALISTS.min(ranked.len()));
        let mut finished = self.refine_all(ranked, &self.final_view, &exact, progress, cancel)?;
        finished.sort_by(|a, b| a.score.total_cmp(&b.score));
        finished.extend(rest);
        Ok(finished)
    }

    fn refine_all(
        &self,
        candidates: Vec<Candidate>,
        view: &[Point3],
        settings: &scaled_icp::Settings,
        progress: &mut (dyn FnMut(Event) + Send),
        cancel: &Cancel,
    ) -> Result<Vec<Candidate>, Error> {
        let refined: Vec<(Candidate, Vec<Iteration>)> = candidates
            .into_par_iter()
            .map(|candidate| {
                cancel.check()?;
                let refined = scaled_icp::refine(&self.model, view, candidate.refined, settings);
                let next = self.candidate(
                    candidate.coarse,
                    refined.ct_from_camera,
                    view,
                    MATCHED_SHARE,
                );
                Ok((next, refined.iterations))
            })
            .collect::<Result<_, Error>>()?;
        let mut candidates = Vec::with_capacity(refined.len());
        for (index, (candidate, iterations)) in refined.into_iter().enumerate() {
            for (iteration, state) in iterations.into_iter().enumerate() {
                progress(Event::Iteration {
                    candidate: index as u32,
                    iteration: iteration as u32,
                    state,
                });
            }
            candidates.push(candidate);
        }
        Ok(candidates)
    }

    fn candidate(
        &self,
        coarse: Similarity<Ct, Camera>,
        refined: Similarity<Ct, Camera>,
        view: &[Point3],
        kept_share: f64,
    ) -> Candidate {
        let rms_mm = self.trimmed_rms_mm(view, &refined, kept_share);
        let violations = self.violation_share(&refined);
        Candidate {
            coarse,
            refined,
            score: rms_mm * (1.0 + VIOLATION_WEIGHT * violations),
        }
    }

    /// The best of each group of like candidates, at most `count`, best first.
    fn distinct(
        &self,
        mut candidates: Vec<Candidate>,
        count: usize,
        degrees: f64,
        millimetres: f64,
    ) -> Vec<Candidate> {
        candidates.sort_by(|a, b| a.score.total_cmp(&b.score));
        let mut kept: Vec<Candidate> = Vec::new();
        for candidate in candidates {
            if kept.len() == count {
                break;
            }
            let known = kept
                .iter()
                .any(|other| self.alike(&other.refined, &candidate.refined, degrees, millimetres));
            if !known {
                kept.push(candidate);
            }
        }
        kept
    }

    /// Whether two poses differ by less than `degrees` and put the view's middle less than `millimetres` apart.
    fn alike(
        &self,
        a: &Similarity<Ct, Camera>,
        b: &Similarity<Ct, Camera>,
        degrees: f64,
        millimetres: f64,
    ) -> bool {
        let middle = self.short_view[self.short_view.len() / 2];
        a.rotation.angle_to(&b.rotation).to_degrees() < degrees
            && (*a * middle - *b * middle).norm() < millimetres
    }

    /// Distances of `view` to the model's surface, mm of the camera frame.
    fn residuals_mm(&self, view: &[Point3], ct_from_camera: &Similarity<Ct, Camera>) -> Vec<f64> {
        view.iter()
            .map(|point| {
                let foot = self
                    .model
                    .foot(&(*ct_from_camera * *point), Matching::Exact);
                foot.surface_distance2.sqrt() / ct_from_camera.scale
            })
            .collect()
    }

    fn trimmed_rms_mm(
        &self,
        view: &[Point3],
        ct_from_camera: &Similarity<Ct, Camera>,
        kept_share: f64,
    ) -> f64 {
        let mut residuals = self.residuals_mm(view, ct_from_camera);
        residuals.sort_by(f64::total_cmp);
        residuals.truncate((residuals.len() as f64 * kept_share).ceil() as usize);
        (residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64).sqrt()
    }

    fn violation_share(&self, ct_from_camera: &Similarity<Ct, Camera>) -> f64 {
        self.visibility.as_ref().map_or(0.0, |visibility| {
            visibility.violation_share(&self.free_space_model, &ct_from_camera.inverse())
        })
    }

    fn inlier_share(&self, view: &[Point3], ct_from_camera: &Similarity<Ct, Camera>) -> f64 {
        let residuals = self.residuals_mm(view, ct_from_camera);
        let inliers = residuals
            .iter()
            .filter(|r| **r < INLIER_DISTANCE_MM)
            .count();
        inliers as f64 / residuals.len() as f64
    }

    /// Share of the model's samples that have a view point nearby, 0..1.
    fn overlap(&self, camera_from_ct: &Similarity<Camera, Ct>) -> f64 {
        let view = Surface::new(&self.final_view, FINAL_VIEW_POINTS);
        let reach = INLIER_DISTANCE_MM.max(view.spacing_mm);
        let covered = self
            .model
            .points
            .iter()
            .filter(|point| view.has_within(&(*camera_from_ct * **point), reach * reach))
            .count();
        covered as f64 / self.model.points.len() as f64
    }

    /// Score margin of the best candidate to the best one that is clearly another pose.
    fn rival_margin(&self, ranked: &[Candidate]) -> f64 {
        let best = &ranked[0];
        ranked[1..]
            .iter()
            .filter(|other| !self.alike(&best.refined, &other.refined, 10.0, 3.0))
            .map(|rival| (1.0 - best.score / rival.score.max(1e-9)).clamp(0.0, 1.0))
            .fold(1.0, f64::min)
    }

    fn answer(&self, target: &Cloud, ranked: &[Candidate]) -> Registration {
        let best = &ranked[0];
        let camera_from_ct = best.refined.inverse();
        let residuals = self.residuals_mm(&target.points, &best.refined);
        let evidence = Evidence {
            scale: camera_from_ct.scale,
            scale_range: self.scale,
            trimmed_rms_mm: self.trimmed_rms_mm(&self.final_view, &best.refined, MATCHED_SHARE),
            inlier_share: self.inlier_share(&target.points, &best.refined),
            overlap: self.overlap(&camera_from_ct),
            violation_share: self.violation_share(&best.refined),
            rival_margin: self.rival_margin(ranked),
        };
        let (verdict, reasons) = verdict::judge(&evidence);
        Registration {
            camera_from_ct,
            coarse_mse_mm2: mean_squared_error(&self.model, &self.final_view, &best.coarse),
            mse_mm2: mean_squared_error(&self.model, &self.final_view, &best.refined),
            residuals_mm: residuals.into_iter().map(|r| r as f32).collect(),
            evidence,
            verdict,
            reasons,
        }
    }
}
