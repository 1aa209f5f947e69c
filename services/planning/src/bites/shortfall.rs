//! What no set of bites can clear, found before any is sought: everything that can be bitten, bitten.

use arthro_geometry::{Point3, Vector3};

use super::Rules;
use super::order::{self, Gone};
use super::poses::Ground;
use super::problem::Problem;
use super::selection::Selection;
use crate::error::Error;
use crate::evaluation::Task;

/// Tissue that stays whatever is bitten.
#[derive(Debug)]
pub(super) struct Shortfall {
    residual_mm3: f64,
    allowed_mm3: f64,
    /// Its middle, in ct.
    at: Point3,
    /// Part of it that would be cut if its bites could be made: their throats stay blocked.
    blocked_mm3: f64,
    /// Share of the region that does not stay, percent.
    possible_percent: f64,
    region: usize,
    undisplaced: usize,
}

/// What stays of the region, if that is more than the rules allow.
pub(super) fn of(problem: &Problem, ground: &Ground<'_>, rules: &Rules) -> Option<Shortfall> {
    let Ground { task, region, .. } = *ground;
    let all: Vec<usize> = (0..problem.candidates.len()).collect();
    let mut gone = Gone::nothing(problem);
    let order = order::of(&all, problem, &mut gone);
    let mut stays = region.to_vec();
    let mut cleared = 0;
    for (number, voxel) in (0u32..).zip(&problem.of_model[..problem.region]) {
        if gone.holds(number) {
            stays[*voxel as usize] = false;
            cleared += 1;
        }
    }
    let mut covered = vec![false; problem.undisplaced];
    for candidate in &order.made {
        for place in &problem.candidates[*candidate].places {
            if let Some(covered) = covered.get_mut(*place as usize) {
                *covered = true;
            }
        }
    }
    let undisplaced = covered.iter().filter(|covered| **covered).count();
    let uncovered = ground.lesion().iter().zip(&covered);
    for (point, _) in uncovered.filter(|(_, covered)| !**covered) {
        if let Some(voxel) = task.voxels.at(point) {
            stays[voxel] = true;
        }
    }
    if cleared >= problem.region_needed && undisplaced >= problem.undisplaced_needed {
        return None;
    }
    let mm3 = |count: usize| count as f64 * task.voxels.voxel_mm3();
    let whole = region.iter().filter(|inside| **inside).count();
    let mut blocked: Vec<u32> = order
        .stuck
        .iter()
        .flat_map(|candidate| &problem.candidates[*candidate].cut)
        .map(|number| problem.of_model[*number as usize])
        .filter(|voxel| stays[*voxel as usize])
        .collect();
    blocked.sort_unstable();
    blocked.dedup();
    let residual: Vec<&Point3> = marked(&stays, task).collect();
    Some(Shortfall {
        residual_mm3: mm3(residual.len()),
        allowed_mm3: (1.0 - rules.region_share) * mm3(whole),
        at: task.crescent.ct_from_meniscal * middle(&residual),
        blocked_mm3: mm3(blocked.len()),
        possible_percent: 100.0 * cleared as f64 / whole.max(1) as f64,
        region: cleared,
        undisplaced,
    })
}

impl Shortfall {
    pub(super) fn refusal(&self) -> Error {
        Error::UnreachableTissue {
            residual_mm3: self.residual_mm3,
            allowed_mm3: self.allowed_mm3,
            blocked_mm3: self.blocked_mm3,
            possible_percent: self.possible_percent,
            at: self.at,
        }
    }

    /// Asks for no more than can be had.
    pub(super) fn lower(&self, problem: &mut Problem) {
        problem.region_needed = problem.region_needed.min(self.region);
        problem.undisplaced_needed = problem.undisplaced_needed.min(self.undisplaced);
    }
}

/// The refusal where no set was found that clears enough and keeps the limits: what the closest one
/// leaves and takes.
pub(super) fn of_closest(closest: &Selection<'_>, task: &Task<'_>) -> Error {
    let problem = closest.problem();
    let mut stays = vec![false; task.voxels.centers().len()];
    for (number, voxel) in (0u32..).zip(&problem.of_model[..problem.region]) {
        stays[*voxel as usize] = !closest.is_bitten(number);
    }
    let residual: Vec<&Point3> = marked(&stays, task).collect();
    let mm3 = |count: usize| count as f64 * task.voxels.voxel_mm3();
    Error::RegionNotCleared {
        bites: closest.chosen.len(),
        residual_mm3: mm3(residual.len()),
        allowed_mm3: mm3(problem.region.saturating_sub(problem.region_needed)),
        outside_mm3: mm3(closest.outside()),
        outside_limit_mm3: mm3(problem.outside_limit),
        at: task.crescent.ct_from_meniscal * middle(&residual),
    }
}

fn marked<'a>(marks: &'a [bool], task: &'a Task<'_>) -> impl Iterator<Item = &'a Point3> {
    let centers = task.voxels.centers().iter().zip(marks);
    centers.filter(|(_, mark)| **mark).map(|(center, _)| center)
}

fn middle(points: &[&Point3]) -> Point3 {
    let sum: Vector3 = points.iter().map(|point| point.coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}
