//! The new inner edge that a list of bites leaves, ray by ray about the centre of the crescent, and
//! the rim outboard of it.

use arthro_geometry::Point3;

use super::Task;
use crate::jaw::Cut;

/// Step along a ray on which the edge is looked for, mm.
const STEP_MM: f64 = 0.1;

/// The inner edge after the bites.
#[derive(Clone, Debug)]
pub struct Edge {
    /// The rays that meet tissue, by ascending angle.
    pub rays: Vec<Ray>,
}

/// Where the inner edge lies on one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Angle about the centre of the crescent, 0 in the middle of the body.
    pub angle_rad: f64,
    /// Distance of the free edge before the bites from the centre, mm.
    pub old_mm: f64,
    /// Distance of the new inner edge from the centre, mm. Seen from the rim it is the first tissue
    /// removed: a flap that is left inboard of a cut holds nothing.
    pub new_mm: f64,
    /// Width of the rim that is left, mm.
    pub rim_mm: f64,
    /// Whether a bite met the ray.
    pub is_bitten: bool,
    /// The place of the new edge in the axes of the crescent, mm.
    pub at: Point3,
}

/// The rim that is left, over the rays on which something is removed, or over all if nothing is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rim {
    /// Width where it is narrowest, mm.
    pub min_mm: f64,
    /// Where that is, in the axes of the crescent, mm.
    pub min_at: Point3,
    /// Angle about the centre of the crescent where that is.
    pub min_angle_rad: f64,
    /// Mean width, mm.
    pub mean_mm: f64,
}

impl Edge {
    /// The edge that the cuts of `task`'s jaw leave.
    pub fn after(task: &Task<'_>, cuts: &[Cut]) -> Self {
        let rays = task.crescent.rays();
        Self {
            rays: rays
                .filter_map(|angle_rad| ray(task, cuts, angle_rad))
                .collect(),
        }
    }

    /// The rim outboard of the edge.
    pub fn rim(&self) -> Rim {
        let is_bitten = self.rays.iter().any(|ray| ray.is_bitten);
        let counted = || self.rays.iter().filter(|ray| ray.is_bitten == is_bitten);
        let narrowest = counted().min_by(|a, b| a.rim_mm.total_cmp(&b.rim_mm));
        let sum_mm: f64 = counted().map(|ray| ray.rim_mm).sum();
        Rim {
            min_mm: narrowest.map_or(0.0, |ray| ray.rim_mm),
            min_at: narrowest.map_or_else(Point3::origin, |ray| ray.at),
            min_angle_rad: narrowest.map_or(0.0, |ray| ray.angle_rad),
            mean_mm: sum_mm / counted().count().max(1) as f64,
        }
    }
}

fn ray(task: &Task<'_>, cuts: &[Cut], angle_rad: f64) -> Option<Ray> {
    let old_mm = task.crescent.edge_mm(angle_rad)?;
    let outer_mm = task.crescent.rim_mm(angle_rad)?;
    let (sin, cos) = angle_rad.sin_cos();
    let voxel_mm = task.voxels.voxel_mm();
    let place = |radius_mm: f64| {
        let (x, y) = (radius_mm * cos, radius_mm * sin);
        let height_mm = task.voxels.middle_mm(x, y, voxel_mm);
        Point3::new(x, y, height_mm.unwrap_or(0.0))
    };

    // Only cuts that come near the ray, and only as far out as they reach.
    let mut near: Vec<&Cut> = Vec::new();
    let mut farthest_mm = f64::NEG_INFINITY;
    for cut in cuts {
        let center = cut.center();
        let reach_mm = cut.reach_mm(task.voxels.reach_mm() + center.z.abs());
        let (along_mm, aside_mm) = (
            center.x * cos + center.y * sin,
            center.y * cos - center.x * sin,
        );
        if aside_mm.abs() <= reach_mm && along_mm + reach_mm >= old_mm {
            near.push(cut);
            farthest_mm = farthest_mm.max(along_mm + reach_mm);
        }
    }
    let first = ((outer_mm - farthest_mm) / STEP_MM).floor().max(0.0) as usize;
    let last = ((outer_mm - old_mm) / STEP_MM).floor() as usize;
    let steps = if near.is_empty() { 0 } else { last + 1 };
    let points = (first..steps).map(|step| (step, place(outer_mm - step as f64 * STEP_MM)));
    let removed = points
        .into_iter()
        .find(|(_, point)| near.iter().any(|cut| cut.contains(point)));
    Some(match removed {
        Some((step, at)) => Ray {
            angle_rad,
            old_mm,
            new_mm: outer_mm - step as f64 * STEP_MM,
            rim_mm: step as f64 * STEP_MM,
            is_bitten: true,
            at,
        },
        None => Ray {
            angle_rad,
            old_mm,
            new_mm: old_mm,
            rim_mm: outer_mm - old_mm,
            is_bitten: false,
            at: place(old_mm),
        },
    })
}
