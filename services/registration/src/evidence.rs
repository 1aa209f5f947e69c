//! What is measured of a pose, for and against it: residuals, free space, overlap, rivals, the mirror, the predicted error.

use arthro_geometry::Point3;
use nalgebra::SMatrix;

use crate::budget::Budget;
use crate::cells::Cells;
use crate::contact::{MODEL_DEVIATION_UNITS, contacts};
use crate::covariance::{self, Covariance};
use crate::error::Error;
use crate::gate;
use crate::mse::trimmed_mean_square;
use crate::pipeline::Event;
use crate::problem::{Candidate, Likeness, Pose, Problem};
use crate::robust;
use crate::scale::ScaleRange;
use crate::view::Seen;

/// A view point this near to the model's surface is an inlier, units.
const INLIER_UNITS: f64 = 1.2;
/// A pose farther from the best one than this is another pose, not the same one less well refined.
pub const RIVAL: Likeness = Likeness {
    degrees: 10.0,
    units: 3.0,
    log_scale: 0.1,
};
/// How far the mirror's scale may be from the answer's.
const MIRROR_TOLERANCE: f64 = 0.06;

/// What speaks for and against a pose. Lengths are mm of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Scale of camera_from_ct.
    pub scale: f64,
    /// Its standard deviation, as a fraction.
    pub scale_deviation: f64,
    /// The scales that were allowed.
    pub allowed: ScaleRange,
    /// Root mean square distance to the model's surface of the nearest nine tenths of the view, as a multiple of what the
    /// view's own noise and the stairs of the model's voxels explain.
    pub misfit: f64,
    /// Share of view points near the model's surface, 0..1.
    pub inlier_share: f64,
    /// Share of the model's surface that the view covers, 0..1.
    pub overlap: f64,
    /// Share of the model that would have hidden what was seen, 0..1.
    pub violation_share: f64,
    /// Score of the pose over that of the best clearly different one: 0 no rival, 1 as good.
    pub ambiguity: f64,
    /// Score of the pose over the best one of the mirrored view: above 1 the mirrored model fits better.
    pub mirror: f64,
    /// Predicted root mean square target registration error over the model, or over the target region.
    pub tre_predicted_mm: f64,
    /// The model's unit of length, see [`crate::model::Model::unit_mm`].
    pub unit_mm: f64,
}

/// The figures that cost little, of the best of `ranked`.
pub fn quick(problem: &Problem, ranked: &[Candidate]) -> Evidence {
    let best = &ranked[0];
    let residuals = residuals_mm(problem, &problem.view.dense, &best.pose);
    let trimmed_rms_mm = trimmed_mean_square(residuals.clone()).sqrt();
    let noise_mm = problem.view.noise_mm * best.pose.scale;
    let usual_mm = noise_mm.hypot(MODEL_DEVIATION_UNITS * problem.model.unit_mm);
    Evidence {
        scale: 1.0 / best.pose.scale,
        scale_deviation: f64::INFINITY,
        allowed: problem.allowed,
        misfit: trimmed_rms_mm / usual_mm,
        inlier_share: inlier_share(problem, &residuals),
        overlap: overlap(problem, &best.pose),
        violation_share: problem.violation_share(&best.pose),
        ambiguity: ambiguity(problem, ranked),
        mirror: 0.0,
        tre_predicted_mm: 0.0,
        unit_mm: problem.model.unit_mm,
    }
}

/// All figures of the best of `ranked`, and its covariance. `targets` are the points, about the model's centre, whose
/// error matters.
pub fn whole(
    problem: &Problem,
    ranked: &[Candidate],
    targets: &[Point3],
    budget: &Budget,
) -> Result<(Evidence, Covariance), Error> {
    let mut evidence = quick(problem, ranked);
    let best = &ranked[0];
    let covariance = covariance::of(problem, &best.pose)
        .unwrap_or_else(|| SMatrix::from_diagonal_element(f64::INFINITY));
    evidence.tre_predicted_mm = covariance::predicted_tre_mm(&covariance, &best.pose, targets);
    evidence.scale_deviation = covariance[(6, 6)].max(0.0).sqrt();
    evidence.mirror = mirror(problem, best, budget)?;
    Ok((evidence, covariance))
}

/// What is told of a coarse candidate.
pub fn of_coarse(problem: &Problem, rank: usize, candidate: &Candidate) -> Event {
    let residuals = residuals_mm(problem, &problem.view.medium, &candidate.coarse);
    Event::Candidate {
        rank: rank as u32,
        camera_from_ct: problem.camera_from_ct(&candidate.coarse),
        inlier_share: inlier_share(problem, &residuals),
        mse_mm2: trimmed_mean_square(residuals),
    }
}

/// Whether the best of `ranked` would be accepted by the figures that cost little.
pub fn is_convincing(problem: &Problem, ranked: &[Candidate]) -> bool {
    gate::judge(&quick(problem, ranked)).0 == gate::Verdict::Accept
}

/// Distances of `seen` to the model's surface, mm of the model.
pub fn residuals_mm(problem: &Problem, seen: &Seen, pose: &Pose) -> Vec<f64> {
    let contacts = contacts(&problem.model, seen, pose);
    contacts
        .into_iter()
        .map(|contact| contact.foot.distance2.sqrt())
        .collect()
}

/// Share of the view that belongs to the model, 0..1; strays that were taken out before do not.
pub fn inlier_share(problem: &Problem, residuals_mm: &[f64]) -> f64 {
    let limit_mm = INLIER_UNITS * problem.model.unit_mm;
    let inliers = residuals_mm.iter().filter(|residual| **residual < limit_mm);
    let share = inliers.count() as f64 / residuals_mm.len().max(1) as f64;
    share * (1.0 - problem.view.stray_share)
}

/// Share of the model's samples that have a view point nearby, 0..1.
fn overlap(problem: &Problem, pose: &Pose) -> f64 {
    let carried: Vec<Point3> = problem
        .view
        .dense
        .points
        .iter()
        .map(|p| *pose * *p)
        .collect();
    let reach_mm = (INLIER_UNITS * problem.model.unit_mm).max(problem.view.spacing_mm * pose.scale);
    let cells = Cells::new(&carried, reach_mm);
    let covered = problem
        .model
        .points
        .iter()
        .filter(|point| cells.count_within(point, reach_mm) > 0);
    covered.count() as f64 / problem.model.points.len() as f64
}

/// Score of the best over that of its best clear rival, 0..1.
fn ambiguity(problem: &Problem, ranked: &[Candidate]) -> f64 {
    let best = &ranked[0];
    ranked[1..]
        .iter()
        .filter(|other| !problem.alike(&other.pose, &best.pose, &RIVAL))
        .map(|rival| best.score / rival.score.max(f64::MIN_POSITIVE))
        .fold(0.0, f64::max)
        .min(1.0)
}

/// Score of the best over that of the mirrored view's best: a left meniscus for a right one fits in the mirror.
fn mirror(problem: &Problem, best: &Candidate, budget: &Budget) -> Result<f64, Error> {
    let scale = 1.0 / best.pose.scale;
    let near = ScaleRange::around(scale, MIRROR_TOLERANCE);
    let mirrored = problem.mirrored(problem.allowed.intersection(&near));
    let rival = robust::best_quickly(&mirrored, budget)?;
    Ok(rival.map_or(0.0, |rival| best.score / rival.score.max(f64::MIN_POSITIVE)))
}
