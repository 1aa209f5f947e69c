//! The two stages: many poses ranked after a short refinement, the best of them finished.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Similarity, Vector3};
use rayon::prelude::*;

use super::evidence::root_mean_square;
use super::{Candidate, Event, Problem};
use crate::cancel::Cancel;
use crate::error::Error;
use crate::mse::MATCHED_SHARE;
use crate::scaled_icp::{self, Iteration, ScaleRange, Start};
use crate::surface::Matching;
use crate::{seeds, super4pcs};

/// Super4PCS: bases drawn, poses kept of each, distinct ones refined in all, and how exact a congruence must be.
const BASES: usize = 24;
const KEPT_PER_BASE: usize = 12;
const CONGRUENT_CANDIDATES: usize = 80;
const CONGRUENCE_TOLERANCE_MM: f64 = 1.3;
/// Rotations tried beside them: on partial views Super4PCS alone often lacks the right one.
const ROTATION_SEEDS: usize = 120;
/// Distinct poses that leave the coarse stage, and those of them that are finished on the whole view.
const COARSE_CANDIDATES: usize = 16;
const FINALISTS: usize = 4;

/// Share of the view that pulls the many hypotheses.
const SHORT_KEPT_SHARE: f64 = 0.85;
/// A residual counts no more than this in a score, mm: a stray point weighs little, a missed horn of the crescent much.
const STRAY_DISTANCE_MM: f64 = 1.5;
/// Weight of free-space violations against residuals.
const VIOLATION_WEIGHT: f64 = 4.0;

impl Problem {
    /// Distinct candidates, best first.
    pub(super) fn coarse(&self, seed: u64, cancel: &Cancel) -> Result<Vec<Candidate>, Error> {
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
                Ok(self.candidate(start, refined.ct_from_camera, &self.short_view))
            })
            .collect::<Result<_, Error>>()?;
        Ok(self.distinct(candidates, COARSE_CANDIDATES, 8.0, 2.0))
    }

    /// Finished candidates, best first.
    pub(super) fn fine(
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
                let next = self.candidate(candidate.coarse, refined.ct_from_camera, view);
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
    ) -> Candidate {
        let residuals = self.residuals_mm(view, &refined);
        let rms_mm = root_mean_square(residuals.into_iter().map(|r| r.min(STRAY_DISTANCE_MM)));
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
    pub(super) fn alike(
        &self,
        a: &Similarity<Ct, Camera>,
        b: &Similarity<Ct, Camera>,
        degrees: f64,
        millimetres: f64,
    ) -> bool {
        let middle = self.middle();
        a.rotation.angle_to(&b.rotation).to_degrees() < degrees
            && (*a * middle - *b * middle).norm() < millimetres
    }

    /// A point in the midst of the view.
    fn middle(&self) -> Point3 {
        let sum: Vector3 = self.short_view.iter().map(|p| p.coords).sum();
        Point3::from(sum / self.short_view.len() as f64)
    }
}
