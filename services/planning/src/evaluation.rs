//! Scores a list of bites, from whatever source: what they take of the lesion, of the planned region
//! and of healthy tissue, what rim and what edge they leave, how long they take, and whether the jaw
//! can make them in their order.

pub mod edge;
pub mod order;
pub mod scallop;
pub mod time;
pub mod turns;

use arthro_geometry::Point3;

use crate::band::Band;
use crate::crescent::Crescent;
use crate::jaw::{Bite, Cut, Jaw};
use crate::lesion::Lesion;
use crate::voxels::Voxels;

use edge::Edge;
use order::{BiteAccount, Blocked};
use scallop::Scallop;
use time::Timing;
use turns::Turns;

/// What is scored and by which rules, in the axes of the crescent.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// Where free edge and rim are.
    pub crescent: &'a Crescent,
    /// The tissue.
    pub voxels: &'a Voxels,
    /// The damaged part of it.
    pub lesion: &'a Lesion,
    /// The planned region; `None`: the lesion is the region.
    pub band: Option<&'a Band>,
    /// The jaw that bites.
    pub jaw: Jaw,
    /// Where the forceps may enter, mm; empty: not known.
    pub portals: &'a [Point3],
    /// How long the parts of a cycle take.
    pub timing: Timing,
    /// Share of the jaw's throat that tissue may block when a bite is made, 0..1.
    pub throat_limit: f64,
}

/// What a list of bites does to the tissue. Without bites nothing is removed and the rim is whole.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// How many bites.
    pub bites: usize,
    /// Volume of the lesion, mm3.
    pub lesion_mm3: f64,
    /// Share of it that the bites cover; 100 if it is empty.
    pub lesion_covered_percent: f64,
    /// Volume of the planned region, mm3.
    pub region_mm3: f64,
    /// Share of it that the bites cover; 100 if it is empty.
    pub region_covered_percent: f64,
    /// Tissue removed, mm3.
    pub removed_mm3: f64,
    /// Tissue removed outside the lesion, mm3.
    pub healthy_removed_mm3: f64,
    /// Tissue removed outside the planned region, mm3.
    pub outside_removed_mm3: f64,
    /// Tissue of the planned region that is left, mm3.
    pub left_mm3: f64,
    /// Narrowest rim left where something is removed, or anywhere if nothing is, mm.
    pub rim_min_mm: f64,
    /// Where, in the axes of the crescent.
    pub rim_min_at: Point3,
    /// Where, as an angle about the centre of the crescent, 0 in the middle of the body.
    pub rim_min_angle_rad: f64,
    /// Mean rim left where something is removed, or everywhere if nothing is, mm.
    pub rim_mean_mm: f64,
    /// The new inner edge against the planned contour; `None` without a contour.
    pub scallop: Option<Scallop>,
    /// How evenly the new inner edge runs.
    pub edge_turns: Turns,
    /// Predicted time of all cycles, s.
    pub predicted_seconds: f64,
    /// What each bite does at its time.
    pub accounts: Vec<BiteAccount>,
    /// The bites whose jaw cannot close at their time.
    pub infeasible: Vec<Blocked>,
}

impl Evaluation {
    /// Whether the jaw can close at every bite in this order.
    pub fn is_order_feasible(&self) -> bool {
        self.infeasible.is_empty()
    }
}

impl Task<'_> {
    /// Whether each voxel belongs to the planned region.
    pub fn region(&self) -> Vec<bool> {
        match self.band {
            None => self.lesion.marks.clone(),
            Some(band) => {
                let centers = self.voxels.centers().iter();
                centers
                    .map(|center| band.contains(center, self.crescent))
                    .collect()
            }
        }
    }

    /// Scores the bites in their order.
    pub fn evaluate(&self, bites: &[Bite]) -> Evaluation {
        let region = self.region();
        let (tissue, accounts) = order::carry_out(self, &region, bites);
        let count = |flags: &[bool], is_left: bool| {
            let flagged = (0u32..).zip(flags).filter(|(_, flag)| **flag);
            flagged
                .filter(|(voxel, _)| tissue.is_left(*voxel) == is_left)
                .count()
        };
        let (region_removed, region_left) = (count(&region, false), count(&region, true));
        let removed = region.len() - tissue.left();
        let lesion_marks_removed = count(&self.lesion.marks, false);

        let cuts: Vec<Cut> = bites.iter().map(|bite| bite.cut(&self.jaw)).collect();
        let lesion_points = self.lesion.points.iter();
        let lesion_removed = lesion_points
            .filter(|point| cuts.iter().any(|cut| cut.contains(point)))
            .count();
        let edge = Edge::after(self, &cuts);
        let rim = edge.rim();
        let mm3 = |voxels: usize| voxels as f64 * self.voxels.voxel_mm3();
        Evaluation {
            bites: bites.len(),
            lesion_mm3: self.lesion.volume_mm3(),
            lesion_covered_percent: percent(lesion_removed, self.lesion.points.len()),
            region_mm3: mm3(region_removed + region_left),
            region_covered_percent: percent(region_removed, region_removed + region_left),
            removed_mm3: mm3(removed),
            healthy_removed_mm3: mm3(removed - lesion_marks_removed),
            outside_removed_mm3: mm3(removed - region_removed),
            left_mm3: mm3(region_left),
            rim_min_mm: rim.min_mm,
            rim_min_at: rim.min_at,
            rim_min_angle_rad: rim.min_angle_rad,
            rim_mean_mm: rim.mean_mm,
            scallop: self.band.and_then(|band| Scallop::of(&edge, band)),
            edge_turns: Turns::of(&edge, 0.5 * self.jaw.width_mm),
            predicted_seconds: accounts
                .iter()
                .fold(0.0, |sum, account| sum + account.seconds),
            infeasible: order::blocked(&accounts, self.throat_limit),
            accounts,
        }
    }
}

fn percent(part: usize, whole: usize) -> f64 {
    if whole == 0 {
        return 100.0;
    }
    100.0 * part as f64 / whole as f64
}
