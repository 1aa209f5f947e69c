//! The choice of bites in whole numbers: which voxels count, how many of them must go, which bites
//! there are to choose from.

use super::Rules;
use super::bits::{Bits, Weights};
use super::poses::{DISPLACEMENTS, Ground, Place, Pose};
use crate::evaluation::Task;
use crate::jaw::Bite;

/// A whole throat; in integers sums do not depend on their order.
pub(super) const WHOLE_THROAT: u32 = 1 << 16;
/// What the parts of a throat may lose by rounding, as a share of it.
const ROUNDING: f64 = 2e-3;
/// Share of the lesion that has to be covered when the bites lie off.
const DISPLACED_SHARE: f64 = 0.98;

/// What has to be chosen from what.
#[derive(Clone, Debug)]
pub(super) struct Problem {
    /// How many voxels some candidate cuts: those of the region first, then the others.
    pub(super) voxels: usize,
    /// How many of these belong to the region.
    pub(super) region: usize,
    /// How many of the region have to go.
    pub(super) region_needed: usize,
    /// Points of the lesion. Its places are all of them where they are, then all of them displaced one
    /// way, and so on.
    pub(super) lesion: usize,
    /// How many of them have to go under each displacement; the first is none.
    pub(super) lesion_needed: [usize; DISPLACEMENTS],
    /// How many voxels outside the region may go.
    pub(super) outside_limit: usize,
    /// How much of a throat may be blocked.
    pub(super) throat_limit: u32,
    pub(super) candidates: Vec<Candidate>,
    /// The voxels in the model.
    pub(super) of_model: Vec<u32>,
}

/// One bite to choose.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub(super) bite: Bite,
    pub(super) portal: usize,
    /// Place on the fine grid of poses.
    pub(super) cell: [i32; 2],
    /// Voxels that it cuts; those of the region first.
    pub(super) cut: Vec<u32>,
    /// How many of these belong to the region.
    pub(super) inside: usize,
    /// Places of the lesion that it covers.
    pub(super) places: Vec<u32>,
    /// The same two as bits.
    pub(super) cut_bits: Bits,
    pub(super) place_bits: Bits,
    /// Voxels that block its throat and by how much.
    pub(super) throat: Weights,
    /// How much of its throat no candidate frees.
    pub(super) blocked: u32,
    /// How much of it is blocked before the first bite.
    pub(super) blocked_at_first: u32,
}

impl Problem {
    /// The problem of clearing `region` with `poses`. A pose whose throat nobody can free is left out.
    /// All of the ground's lesion has to go.
    pub(super) fn of(poses: Vec<Pose>, ground: &Ground<'_>, rules: &Rules) -> Self {
        let Ground { task, region, .. } = *ground;
        let numbers = Numbers::of(&poses, region);
        let lesion = ground.lesion().len();
        let displaced = (DISPLACED_SHARE * lesion as f64).ceil() as usize;
        let throat_limit = (rules.throat_limit - ROUNDING).max(0.0);
        let throat_limit = (throat_limit * f64::from(WHOLE_THROAT)) as u32;
        let whole = region.iter().filter(|inside| **inside).count();
        let candidates = poses
            .into_iter()
            .map(|pose| candidate(pose, &numbers, lesion as u32))
            .filter(|candidate| candidate.blocked <= throat_limit)
            .collect();
        Self {
            voxels: numbers.count,
            region: numbers.inside,
            region_needed: (rules.region_share * whole as f64).ceil() as usize,
            lesion,
            lesion_needed: std::array::from_fn(|way| if way == 0 { lesion } else { displaced }),
            outside_limit: whole_voxels(rules.outside_limits_mm3[0], task),
            throat_limit,
            candidates,
            of_model: numbers.voxels(),
        }
    }
}

impl Problem {
    /// The same with another limit outside the region.
    pub(super) fn with_outside_limit(&self, outside_limit_mm3: f64, task: &Task<'_>) -> Self {
        Self {
            outside_limit: whole_voxels(outside_limit_mm3, task),
            ..self.clone()
        }
    }

    /// The same through one portal alone.
    pub(super) fn through(&self, portal: usize) -> Self {
        let mut alone = self.clone();
        alone
            .candidates
            .retain(|candidate| candidate.portal == portal);
        alone
    }

    /// The same with the limits of another.
    pub(super) fn with_limits_of(self, other: &Self) -> Self {
        Self {
            region_needed: other.region_needed,
            lesion_needed: other.lesion_needed,
            outside_limit: other.outside_limit,
            ..self
        }
    }
}

impl Candidate {
    /// The voxels of the region that it cuts.
    pub(super) fn inside(&self) -> &[u32] {
        &self.cut[..self.inside]
    }

    /// Where it is among all poses.
    pub(super) fn place(&self) -> Place {
        (self.portal, self.cell)
    }
}

/// How many voxels a volume holds.
fn whole_voxels(volume_mm3: f64, task: &Task<'_>) -> usize {
    (volume_mm3 / task.voxels.voxel_mm3()).floor() as usize
}

fn candidate(pose: Pose, numbers: &Numbers, lesion: u32) -> Candidate {
    let mut cut: Vec<u32> = pose
        .cut
        .iter()
        .filter_map(|voxel| numbers.of_voxel(*voxel))
        .collect();
    cut.sort_unstable();
    let inside = cut.partition_point(|voxel| (*voxel as usize) < numbers.inside);
    let (mut throat, mut blocked) = (Vec::new(), 0);
    for (voxel, share) in pose.throat {
        let part = (share * f64::from(WHOLE_THROAT)).round() as u32;
        match numbers.of_voxel(voxel) {
            Some(number) => throat.push((number, part)),
            None => blocked += part,
        }
    }
    let throat = Weights::of(&throat);
    let mut places = Vec::new();
    for (point, ways) in pose.lesion {
        let covered = (0..DISPLACEMENTS as u32).filter(|way| ways & (1 << way) != 0);
        places.extend(covered.map(|way| way * lesion + point));
    }
    Candidate {
        bite: pose.bite,
        portal: pose.portal,
        cell: pose.cell,
        cut_bits: Bits::of(&cut),
        place_bits: Bits::of(&places),
        cut,
        inside,
        places,
        blocked_at_first: blocked + throat.whole(),
        throat,
        blocked,
    }
}

/// Voxels of the model numbered anew, some first.
struct Numbers {
    numbers: Vec<Option<u32>>,
    inside: usize,
    count: usize,
}

impl Numbers {
    /// Everything that a pose cuts, the region first.
    fn of(poses: &[Pose], region: &[bool]) -> Self {
        let mut cut = vec![false; region.len()];
        for voxel in poses.iter().flat_map(|pose| &pose.cut) {
            cut[*voxel as usize] = true;
        }
        let inside = cut.iter().zip(region).map(|(cut, inside)| *cut && *inside);
        let mut numbers = Self::of_marks(&inside.collect::<Vec<_>>());
        for (number, cut) in numbers.numbers.iter_mut().zip(cut) {
            if cut && number.is_none() {
                *number = Some(numbers.count as u32);
                numbers.count += 1;
            }
        }
        numbers
    }

    fn of_marks(marks: &[bool]) -> Self {
        let mut count = 0;
        let numbers = marks.iter().map(|mark| {
            mark.then(|| {
                count += 1;
                count - 1
            })
        });
        let numbers = numbers.collect();
        Self {
            numbers,
            inside: count as usize,
            count: count as usize,
        }
    }

    /// The voxels of the model by their numbers.
    fn voxels(&self) -> Vec<u32> {
        let mut voxels = vec![0; self.count];
        for (voxel, number) in (0u32..).zip(&self.numbers) {
            if let Some(number) = number {
                voxels[*number as usize] = voxel;
            }
        }
        voxels
    }

    fn of_voxel(&self, voxel: u32) -> Option<u32> {
        self.numbers[voxel as usize]
    }
}
