//! What no set of bites can clear, found before any is sought: everything that can be bitten, bitten.

use arthro_geometry::{Point3, Vector3};

use super::Rules;
use super::order::{self, Gone, Order};
use super::poses::{DISPLACEMENTS, Ground};
use super::problem::Problem;
use super::selection::Selection;
use crate::error::Error;
use crate::evaluation::Task;

/// Share of what could be cleared that a partial plan clears.
const PARTIAL_SHARE: f64 = 0.97;

/// What everything that can be bitten clears.
#[derive(Debug)]
pub(super) struct Reachable {
    order: Order,
    gone: Gone,
    /// Voxels of the region.
    region: usize,
    /// Whether each point of the lesion is covered where it is.
    lesion: Vec<bool>,
    /// How many of them are under each displacement.
    ways: [usize; DISPLACEMENTS],
}

impl Reachable {
    pub(super) fn of(problem: &Problem) -> Self {
        let all: Vec<usize> = (0..problem.candidates.len()).collect();
        let mut gone = Gone::nothing(problem);
        let order = order::of(&all, problem, &mut gone);
        let mut covered = vec![false; problem.lesion * DISPLACEMENTS];
        let made = order.made.iter();
        for place in made.flat_map(|candidate| &problem.candidates[*candidate].places) {
            covered[*place as usize] = true;
        }
        let under = |way: usize| &covered[way * problem.lesion..(way + 1) * problem.lesion];
        let count = |flags: &[bool]| flags.iter().filter(|flag| **flag).count();
        let region = (0..problem.region as u32).filter(|voxel| gone.holds(*voxel));
        Self {
            region: region.count(),
            ways: std::array::from_fn(|way| count(under(way))),
            lesion: under(0).to_vec(),
            order,
            gone,
        }
    }

    /// Whether no more stays than may.
    pub(super) fn is_enough(&self, problem: &Problem) -> bool {
        self.region >= problem.region_needed && self.ways[0] >= problem.lesion_needed[0]
    }

    /// The refusal if more stays than the rules allow.
    pub(super) fn refusal(
        &self,
        problem: &Problem,
        ground: &Ground<'_>,
        rules: &Rules,
    ) -> Option<Error> {
        if self.is_enough(problem) {
            return None;
        }
        let Ground { task, region, .. } = *ground;
        let stays = self.stays(problem, ground);
        let blocked = self.order.stuck.iter();
        let mut blocked: Vec<u32> = blocked
            .flat_map(|candidate| &problem.candidates[*candidate].cut)
            .map(|number| problem.of_model[*number as usize])
            .filter(|voxel| stays[*voxel as usize])
            .collect();
        blocked.sort_unstable();
        blocked.dedup();
        let residual: Vec<&Point3> = marked(&stays, task).collect();
        let mm3 = |count: usize| count as f64 * task.voxels.voxel_mm3();
        let whole = region.iter().filter(|inside| **inside).count();
        Some(Error::UnreachableTissue {
            residual_mm3: mm3(residual.len()),
            allowed_mm3: (1.0 - rules.region_share) * mm3(whole),
            blocked_mm3: mm3(blocked.len()),
            lesion_percent: percent(problem.lesion - self.ways[0], problem.lesion),
            possible_percent: percent(self.region, whole),
            at: task.crescent.ct_from_meniscal * middle(&residual),
        })
    }

    /// Which voxels of the model stay that should go.
    fn stays(&self, problem: &Problem, ground: &Ground<'_>) -> Vec<bool> {
        let mut stays = ground.region.to_vec();
        for (number, voxel) in (0u32..).zip(&problem.of_model[..problem.region]) {
            stays[*voxel as usize] = !self.gone.holds(number);
        }
        let lesion = ground.lesion().iter().zip(&self.lesion);
        let uncovered = lesion.filter(|(_, covered)| !**covered);
        for voxel in uncovered.filter_map(|(point, _)| ground.task.voxels.at(point)) {
            stays[voxel] = true;
        }
        stays
    }

    /// Asks for no more cover under displacements than can be had: that is no reason to refuse.
    pub(super) fn settle(&self, problem: &mut Problem) {
        let ways = problem.lesion_needed.iter_mut().zip(self.ways).skip(1);
        for (needed, possible) in ways {
            *needed = possible.min(*needed);
        }
    }

    /// Asks for no more than can be had, and of the region for a little less: the last of it would take
    /// the most bites.
    pub(super) fn lower(&self, problem: &mut Problem) {
        let possible = (PARTIAL_SHARE * self.region as f64) as usize;
        problem.region_needed = problem.region_needed.min(possible);
        problem.lesion_needed[0] = problem.lesion_needed[0].min(self.ways[0]);
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

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}
