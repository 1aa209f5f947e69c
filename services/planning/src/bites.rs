//! Chooses the bites that clear the planned region.
//!
//! Candidates lie along the path, shifted inward until an edge of the jaw, not its centre, meets the
//! contour, and in further rows towards the free edge. A greedy choice takes the bite that gains most
//! per bite, since each costs a trip of the forceps to the tray, until the region is clear and the
//! lesion stays covered even when every bite lands a little off. What the later bites made redundant
//! is dropped.

mod candidates;

use std::ops::ControlFlow;

use arthro_geometry::Point3;

use crate::contour::Spline;
use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::Bite;

use candidates::{Candidate, DISPLACEMENTS};

/// How far in the plane the cell's bites may lie from the planned ones, mm.
pub const PLACEMENT_ERROR_MM: f64 = 0.7;
/// Share of the region that is enough.
const REGION_TARGET: f64 = 0.97;
/// Share of the lesion to be covered under every displacement, above the 95 % that are asked for.
const LESION_TARGET: f64 = 0.98;
/// What a bite must gain: less is not worth a trip to the tray, mm3.
const BITE_COST_MM3: f64 = 1.0;
/// How much more a volume of lesion counts than one of the planned region.
const LESION_WEIGHT: f64 = 4.0;
/// How much a volume outside the region counts against a bite.
const OUTSIDE_WEIGHT: f64 = 1.2;

/// Where the forceps come from and what they may touch.
pub struct Access<'a> {
    /// The portal in the axes of the crescent, mm.
    pub portal: Point3,
    /// Whether a bite may have its centre here.
    pub allowed: &'a dyn Fn(&Point3) -> bool,
    /// Rim that must be left beyond the contour, mm.
    pub rim_min_mm: f64,
    /// How far in the plane an executed bite may lie from the planned one and still the lesion must
    /// be covered, mm.
    pub placement_error_mm: f64,
}

/// The bites that clear `task`'s region along `path`, in the order of execution: free edge first, so
/// that the jaw never has to bite a hole into whole tissue.
///
/// `watch` hears the share done and may end the work.
pub fn choose(
    task: &Task<'_>,
    path: &Spline,
    access: &Access<'_>,
    mut watch: impl FnMut(f64) -> ControlFlow<()>,
) -> Result<Vec<Bite>, Error> {
    let region = task.region();
    let candidates = candidates::along(task, path, access, &region, |share| watch(0.7 * share))?;
    let mut coverage = Coverage::none(task, &region);
    let mut chosen: Vec<&Candidate> = Vec::new();
    while let Some(best) = coverage.best(&candidates) {
        if watch(0.7 + 0.3 * coverage.region_share()).is_break() {
            return Err(Error::Cancelled);
        }
        coverage.count(best, Change::Add);
        chosen.push(best);
    }
    drop_redundant(&mut chosen, &mut coverage);
    chosen.sort_by(|a, b| {
        (a.row, a.way_mm)
            .partial_cmp(&(b.row, b.way_mm))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(chosen.into_iter().map(|candidate| candidate.bite).collect())
}

/// How often each voxel is bitten.
struct Coverage {
    voxel_mm3: f64,
    region_voxels: usize,
    region_bitten: usize,
    bitten: Vec<u16>,
    /// How often each voxel of the lesion is bitten when all bites are displaced one way.
    lesion_bitten: Vec<[u16; DISPLACEMENTS]>,
    lesion_voxels: usize,
    /// Voxels of the lesion bitten under each displacement.
    lesion_covered: [usize; DISPLACEMENTS],
}

enum Change {
    Add,
    Remove,
}

impl Coverage {
    fn none(task: &Task<'_>, region: &[bool]) -> Self {
        let count = |flags: &[bool]| flags.iter().filter(|flag| **flag).count();
        Self {
            voxel_mm3: task.voxels.voxel_mm3(),
            region_voxels: count(region),
            region_bitten: 0,
            bitten: vec![0; region.len()],
            lesion_bitten: vec![[0; DISPLACEMENTS]; region.len()],
            lesion_voxels: count(&task.lesion.marks),
            lesion_covered: [0; DISPLACEMENTS],
        }
    }

    fn region_share(&self) -> f64 {
        self.region_bitten as f64 / self.region_voxels.max(1) as f64
    }

    /// Whether the lesion stays covered under every displacement.
    fn lesion_is_safe(&self) -> bool {
        let needed = LESION_TARGET * self.lesion_voxels as f64;
        self.lesion_covered
            .iter()
            .all(|&covered| covered as f64 >= needed)
    }

    /// The candidate that gains most; `None` when enough is covered or nothing is worth a bite.
    fn best<'a>(&self, candidates: &'a [Candidate]) -> Option<&'a Candidate> {
        let lesion_is_safe = self.lesion_is_safe();
        if lesion_is_safe && self.region_share() >= REGION_TARGET {
            return None;
        }
        let mut best: Option<(f64, &Candidate)> = None;
        for candidate in candidates {
            let (gain_mm3, lesion_mm3) = self.gain(candidate);
            let worth = gain_mm3 > BITE_COST_MM3 || (!lesion_is_safe && lesion_mm3 > 0.0);
            if worth && best.is_none_or(|(most, _)| gain_mm3 > most) {
                best = Some((gain_mm3, candidate));
            }
        }
        best.map(|(_, candidate)| candidate)
    }

    /// What a candidate adds: weighed as a whole, and of the lesion under the displacements that
    /// still lack some, mm3.
    fn gain(&self, candidate: &Candidate) -> (f64, f64) {
        let new = |voxels: &[u32]| {
            let fresh = voxels
                .iter()
                .filter(|&&voxel| self.bitten[voxel as usize] == 0);
            fresh.count() as f64
        };
        let needed = LESION_TARGET * self.lesion_voxels as f64;
        let lacking: u32 = (0..DISPLACEMENTS)
            .filter(|&way| (self.lesion_covered[way] as f64) < needed)
            .map(|way| 1 << way)
            .sum();
        let mut lesion = 0;
        for &(voxel, ways) in &candidate.lesion {
            let bitten = &self.lesion_bitten[voxel as usize];
            let mut left = ways & lacking;
            while left != 0 {
                lesion += u32::from(bitten[left.trailing_zeros() as usize] == 0);
                left &= left - 1;
            }
        }
        let lesion = f64::from(lesion) / DISPLACEMENTS as f64;
        let gain = new(&candidate.region) + LESION_WEIGHT * lesion
            - OUTSIDE_WEIGHT * new(&candidate.outside);
        (gain * self.voxel_mm3, lesion * self.voxel_mm3)
    }

    fn count(&mut self, candidate: &Candidate, change: Change) {
        let (step, edge) = match change {
            Change::Add => (1u16, 0),
            Change::Remove => (u16::MAX, 1),
        };
        // A voxel's share changes when its count leaves `edge`; adding u16::MAX takes one away.
        let turn = |count: &mut u16| {
            let turned = *count == edge;
            *count = count.wrapping_add(step);
            turned
        };
        let shift = |sum: &mut usize| match change {
            Change::Add => *sum += 1,
            Change::Remove => *sum -= 1,
        };
        for &voxel in &candidate.region {
            if turn(&mut self.bitten[voxel as usize]) {
                shift(&mut self.region_bitten);
            }
        }
        for &voxel in &candidate.outside {
            turn(&mut self.bitten[voxel as usize]);
        }
        for &(voxel, ways) in &candidate.lesion {
            for way in (0..DISPLACEMENTS).filter(|way| ways & (1 << way) != 0) {
                if turn(&mut self.lesion_bitten[voxel as usize][way]) {
                    shift(&mut self.lesion_covered[way]);
                }
            }
        }
    }
}

/// Takes out bites that the others cover, the least useful first.
fn drop_redundant(chosen: &mut Vec<&Candidate>, coverage: &mut Coverage) {
    loop {
        let lesion_was_safe = coverage.lesion_is_safe();
        let alone_mm3 = |candidate: &Candidate, coverage: &Coverage| {
            let voxels = candidate.region.iter();
            let alone = voxels
                .filter(|&&voxel| coverage.bitten[voxel as usize] == 1)
                .count();
            alone as f64 * coverage.voxel_mm3
        };
        let mut order: Vec<(f64, usize)> = chosen
            .iter()
            .enumerate()
            .map(|(index, candidate)| (alone_mm3(candidate, coverage), index))
            .filter(|&(alone_mm3, _)| alone_mm3 <= BITE_COST_MM3)
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let dropped = order.into_iter().find(|&(_, index)| {
            let before = coverage.lesion_covered;
            coverage.count(chosen[index], Change::Remove);
            let still_fine =
                coverage.lesion_covered == before || (lesion_was_safe && coverage.lesion_is_safe());
            if !still_fine {
                coverage.count(chosen[index], Change::Add);
            }
            still_fine
        });
        match dropped {
            Some((_, index)) => chosen.remove(index),
            None => return,
        };
    }
}
