//! Scores a list of bites: what they take of the lesion, of the planned region and of healthy tissue,
//! and what rim they leave.

use arthro_geometry::Point3;

use crate::band::Band;
use crate::crescent::Crescent;
use crate::jaw::{Bite, Cut, Jaw};
use crate::lesion::Lesion;
use crate::voxels::Voxels;

/// Step along a ray on which the rim is measured, mm.
const RIM_STEP_MM: f64 = 0.1;

/// What is scored, in the axes of the crescent.
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
}

/// What a list of bites does to the tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// How many bites.
    pub bites: usize,
    /// Volume of the lesion, mm3.
    pub lesion_mm3: f64,
    /// Share of it that the bites cover.
    pub lesion_covered_percent: f64,
    /// Volume of the planned region, mm3.
    pub region_mm3: f64,
    /// Share of it that the bites cover.
    pub region_covered_percent: f64,
    /// Tissue removed outside the lesion, mm3.
    pub healthy_removed_mm3: f64,
    /// Tissue removed outside the planned region, mm3.
    pub outside_removed_mm3: f64,
    /// Narrowest rim left where something is removed, mm.
    pub rim_min_mm: f64,
    /// Where, in the axes of the crescent.
    pub rim_min_at: Point3,
    /// Mean rim left where something is removed, mm.
    pub rim_mean_mm: f64,
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

    /// Scores the bites.
    pub fn evaluate(&self, bites: &[Bite]) -> Evaluation {
        let cuts: Vec<Cut> = bites.iter().map(|bite| bite.cut(&self.jaw)).collect();
        let removed_at = |point: &Point3| cuts.iter().any(|cut| cut.contains(point));
        let region = self.region();
        let (mut in_region, mut region_removed, mut healthy, mut outside) = (0, 0, 0, 0);
        for (voxel, center) in self.voxels.centers().iter().enumerate() {
            in_region += usize::from(region[voxel]);
            if removed_at(center) {
                region_removed += usize::from(region[voxel]);
                outside += usize::from(!region[voxel]);
                healthy += usize::from(!self.lesion.marks[voxel]);
            }
        }
        let lesion_points = &self.lesion.points;
        let lesion_removed = lesion_points
            .iter()
            .filter(|point| removed_at(point))
            .count();
        let (rim_min_mm, rim_min_at, rim_mean_mm) = self.rim(&removed_at);
        let mm3 = |voxels: usize| voxels as f64 * self.voxels.voxel_mm3();
        Evaluation {
            bites: bites.len(),
            lesion_mm3: self.lesion.volume_mm3(),
            lesion_covered_percent: percent(lesion_removed, lesion_points.len()),
            region_mm3: mm3(in_region),
            region_covered_percent: percent(region_removed, in_region),
            healthy_removed_mm3: mm3(healthy),
            outside_removed_mm3: mm3(outside),
            rim_min_mm,
            rim_min_at,
            rim_mean_mm,
        }
    }

    /// Narrowest rim, its place and the mean rim over the rays on which something is removed, or over
    /// all rays if nothing is.
    fn rim(&self, removed_at: &impl Fn(&Point3) -> bool) -> (f64, Point3, f64) {
        let mut rays: Vec<(f64, Point3, bool)> = Vec::new();
        let (mut height_mm, voxel_mm) = (0.0, self.voxels.voxel_mm());
        for angle_rad in self.crescent.rays() {
            let edges = self
                .crescent
                .edge_mm(angle_rad)
                .zip(self.crescent.rim_mm(angle_rad));
            let Some((edge_mm, rim_mm)) = edges else {
                continue;
            };
            let steps = ((rim_mm - edge_mm) / RIM_STEP_MM).floor() as usize;
            let mut at = |radius_mm: f64| {
                let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
                height_mm = self.voxels.middle_mm(x, y, voxel_mm).unwrap_or(height_mm);
                Point3::new(x, y, height_mm)
            };
            let points = (0..=steps).map(|step| at(rim_mm - step as f64 * RIM_STEP_MM));
            let found = points.enumerate().find(|(_, point)| removed_at(point));
            rays.push(match found {
                Some((step, point)) => (step as f64 * RIM_STEP_MM, point, true),
                None => {
                    let (x, y) = (edge_mm * angle_rad.cos(), edge_mm * angle_rad.sin());
                    (rim_mm - edge_mm, Point3::new(x, y, 0.0), false)
                }
            });
        }
        let anything = rays.iter().any(|ray| ray.2);
        rays.retain(|ray| ray.2 == anything);
        let narrowest = rays.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let sum: f64 = rays.iter().map(|ray| ray.0).sum();
        match narrowest {
            Some(&(rim_mm, point, _)) => (rim_mm, point, sum / rays.len() as f64),
            None => (0.0, Point3::origin(), 0.0),
        }
    }
}

fn percent(part: usize, whole: usize) -> f64 {
    if whole == 0 {
        return 100.0;
    }
    100.0 * part as f64 / whole as f64
}
