//! A set of bites and what it comes to, kept up to date while bites are exchanged.

use super::anneal::Aim;
use super::order::{self, Gone};
use super::poses::{DISPLACEMENTS, Place};
use super::problem::{Problem, WHOLE_THROAT};

/// What a point of the lesion that stays under a displacement counts, in voxels.
const LESION_WEIGHT: f64 = 1.0;
/// What a voxel too much outside the region counts.
const OUTSIDE_WEIGHT: f64 = 1.5;
/// What a whole blocked throat counts, in voxels.
const THROAT_WEIGHT: f64 = 60.0;
/// What is missing counts so much more than what could be better.
const SHORTAGE_WEIGHT: f64 = 1000.0;
/// What a voxel of the region that is left counts beside one outside that goes.
const LEFT_WEIGHT: f64 = 0.5;

/// Chosen candidates.
#[derive(Clone, Debug)]
pub(super) struct Selection<'a> {
    problem: &'a Problem,
    pub(super) chosen: Vec<usize>,
    /// How often each voxel is bitten.
    bitten: Vec<u16>,
    /// How often each place of the lesion is covered.
    covered: Vec<u16>,
    region: usize,
    outside: usize,
    /// How many points of the lesion are covered under each displacement.
    lesion: [usize; DISPLACEMENTS],
    gone: Gone,
    /// The slots in about the order in which their bites can be made.
    sequence: Vec<usize>,
}

impl<'a> Selection<'a> {
    pub(super) fn empty(problem: &'a Problem) -> Self {
        Self {
            problem,
            chosen: Vec::new(),
            bitten: vec![0; problem.voxels],
            covered: vec![0; problem.lesion * DISPLACEMENTS],
            region: 0,
            outside: 0,
            lesion: [0; DISPLACEMENTS],
            gone: Gone::nothing(problem),
            sequence: Vec::new(),
        }
    }

    /// The candidates at some places; a place without one is left out.
    pub(super) fn of(places: &[Place], problem: &'a Problem) -> Self {
        let mut selection = Self::empty(problem);
        for place in places {
            let mut candidates = problem.candidates.iter();
            if let Some(candidate) = candidates.position(|other| other.place() == *place) {
                selection.add(candidate);
            }
        }
        selection
    }

    /// Where the chosen ones are among all poses.
    pub(super) fn places(&self) -> Vec<Place> {
        let chosen = self.chosen.iter();
        chosen
            .map(|candidate| self.problem.candidates[*candidate].place())
            .collect()
    }

    pub(super) fn problem(&self) -> &'a Problem {
        self.problem
    }

    /// Other voxels that are bitten.
    pub(super) fn outside(&self) -> usize {
        self.outside
    }

    pub(super) fn is_bitten(&self, voxel: u32) -> bool {
        self.bitten[voxel as usize] > 0
    }

    /// How many places of the lesion a candidate would cover that nothing covers yet.
    pub(super) fn new_places(&self, candidate: usize) -> usize {
        let places = self.problem.candidates[candidate].places.iter();
        places
            .filter(|place| self.covered[**place as usize] == 0)
            .count()
    }

    pub(super) fn add(&mut self, candidate: usize) {
        self.count(candidate);
        self.sequence.push(self.chosen.len());
        self.chosen.push(candidate);
    }

    pub(super) fn remove(&mut self, slot: usize) -> usize {
        let candidate = self.chosen.remove(slot);
        self.sequence = (0..self.chosen.len()).collect();
        self.uncount(candidate);
        candidate
    }

    /// Puts another candidate into a slot; returns the one that was there.
    pub(super) fn exchange(&mut self, slot: usize, candidate: usize) -> usize {
        let before = std::mem::replace(&mut self.chosen[slot], candidate);
        let (old, new) = (
            &self.problem.candidates[before],
            &self.problem.candidates[candidate],
        );
        old.cut_bits
            .visit_without(&new.cut_bits, |voxel| self.uncount_voxel(voxel));
        new.cut_bits
            .visit_without(&old.cut_bits, |voxel| self.count_voxel(voxel));
        old.place_bits
            .visit_without(&new.place_bits, |place| self.uncount_place(place));
        new.place_bits
            .visit_without(&old.place_bits, |place| self.count_place(place));
        before
    }

    /// The slot of the bite without which least is missing.
    pub(super) fn least_useful(&self) -> usize {
        let without = |slot: usize| {
            let mut others = self.clone();
            others.remove(slot);
            others.shortage()
        };
        let slots = (0..self.chosen.len()).map(|slot| (without(slot), slot));
        let least = slots.min_by(|a, b| a.0.total_cmp(&b.0));
        least.map_or(0, |(_, slot)| slot)
    }

    /// Puts other candidates in the place of all.
    pub(super) fn replace(&mut self, chosen: &[usize]) {
        for slot in (0..self.chosen.len()).rev() {
            self.remove(slot);
        }
        for candidate in chosen {
            self.add(*candidate);
        }
    }

    fn count(&mut self, candidate: usize) {
        let candidate = &self.problem.candidates[candidate];
        candidate
            .cut
            .iter()
            .for_each(|voxel| self.count_voxel(*voxel));
        candidate
            .places
            .iter()
            .for_each(|place| self.count_place(*place));
    }

    fn uncount(&mut self, candidate: usize) {
        let candidate = &self.problem.candidates[candidate];
        candidate
            .cut
            .iter()
            .for_each(|voxel| self.uncount_voxel(*voxel));
        candidate
            .places
            .iter()
            .for_each(|place| self.uncount_place(*place));
    }

    fn count_voxel(&mut self, voxel: u32) {
        let bitten = &mut self.bitten[voxel as usize];
        *bitten += 1;
        if *bitten == 1 {
            *self.part_of(voxel) += 1;
        }
    }

    fn uncount_voxel(&mut self, voxel: u32) {
        let bitten = &mut self.bitten[voxel as usize];
        *bitten -= 1;
        if *bitten == 0 {
            *self.part_of(voxel) -= 1;
        }
    }

    /// The sum that a voxel belongs to.
    fn part_of(&mut self, voxel: u32) -> &mut usize {
        if (voxel as usize) < self.problem.region {
            &mut self.region
        } else {
            &mut self.outside
        }
    }

    fn count_place(&mut self, place: u32) {
        let covered = &mut self.covered[place as usize];
        *covered += 1;
        if *covered == 1 {
            self.lesion[place as usize / self.problem.lesion] += 1;
        }
    }

    fn uncount_place(&mut self, place: u32) {
        let covered = &mut self.covered[place as usize];
        *covered -= 1;
        if *covered == 0 {
            self.lesion[place as usize / self.problem.lesion] -= 1;
        }
    }

    /// Whether nothing is missing and every bite can be made in some order.
    pub(super) fn is_complete(&mut self) -> bool {
        self.energy(Aim::Complete, f64::INFINITY) <= 0.0
    }

    /// What the set is judged by, in voxels; less is better, and a complete set has 0 or less. Above
    /// `limit` only a lower bound of it, which is quicker.
    pub(super) fn energy(&mut self, aim: Aim, limit: f64) -> f64 {
        let mut energy = self.shortage();
        if aim == Aim::Best {
            energy = SHORTAGE_WEIGHT * energy + self.waste();
        }
        if energy > limit {
            return energy;
        }
        let blocked = self.blocked();
        energy
            + match aim {
                Aim::Complete => blocked,
                Aim::Best => SHORTAGE_WEIGHT * blocked,
            }
    }

    /// What is missing, in voxels, the order left aside; 0 if nothing is.
    pub(super) fn shortage(&self) -> f64 {
        let problem = self.problem;
        let missing = |needed: usize, have: usize| needed.saturating_sub(have) as f64;
        let lesion = problem.lesion_needed.iter().zip(self.lesion);
        let lesion: f64 = lesion.map(|(needed, have)| missing(*needed, have)).sum();
        missing(problem.region_needed, self.region)
            + LESION_WEIGHT * lesion
            + OUTSIDE_WEIGHT * missing(self.outside, problem.outside_limit)
    }

    /// What is taken outside the region beside what is left of it, in voxels.
    fn waste(&self) -> f64 {
        let problem = self.problem;
        self.outside as f64 + LEFT_WEIGHT * (problem.region - self.region) as f64
            - (problem.outside_limit + problem.region) as f64
    }

    /// What the throats miss in the best order, in voxels.
    fn blocked(&mut self) -> f64 {
        let sequence = std::mem::take(&mut self.sequence);
        let order = order::of_slots(sequence, &self.chosen, self.problem, &mut self.gone);
        let blocked = THROAT_WEIGHT * f64::from(order.excess) / f64::from(WHOLE_THROAT)
            + order.stuck.len() as f64;
        // The next set differs in one bite: its order will hardly be another.
        self.sequence = order.made;
        self.sequence.extend(order.stuck);
        blocked
    }
}
