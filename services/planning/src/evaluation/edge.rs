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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crescent::Crescent;
    use crate::evaluation::time::Timing;
    use crate::jaw::{Bite, Jaw};
    use crate::lesion::Lesion;
    use crate::tissue::THROAT_LIMIT;
    use crate::voxels::Voxels;
    use arthro_geometry::{Vector3, phantom};

    fn edge_after(bites: impl Fn(&Crescent) -> Vec<Bite>) -> (Crescent, Edge) {
        let mesh = phantom::mesh();
        let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let voxels = Voxels::of(&mesh, &crescent, 0.5, 1.0).unwrap();
        let lesion = Lesion::of_voxels(vec![false; voxels.centers().len()], &voxels);
        let jaw = Jaw::new(3.0, 4.5);
        let task = Task {
            crescent: &crescent,
            voxels: &voxels,
            lesion: &lesion,
            band: None,
            jaw,
            portals: &[],
            timing: Timing::default(),
            throat_limit: THROAT_LIMIT,
        };
        let bites = bites(&crescent);
        let cuts: Vec<Cut> = bites.iter().map(|bite| bite.cut(&jaw)).collect();
        let edge = Edge::after(&task, &cuts);
        (crescent, edge)
    }

    fn outwards(angle_rad: f64, radius_mm: f64) -> Bite {
        let axis = Vector3::new(angle_rad.cos(), angle_rad.sin(), 0.0);
        let center = Point3::from(axis * radius_mm);
        Bite::of_axis(center, &axis, &Vector3::z()).unwrap()
    }

    fn nearest(edge: &Edge, angle_rad: f64) -> Ray {
        let off = |ray: &&Ray| (ray.angle_rad - angle_rad).abs();
        let nearest = edge.rays.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        *nearest.unwrap()
    }

    #[test]
    fn the_new_edge_is_where_the_jaw_ends() {
        for angle_rad in [-0.9, 0.0, 0.7] {
            let (crescent, edge) = edge_after(|_| vec![outwards(angle_rad, 14.0)]);
            let ray = nearest(&edge, angle_rad);
            assert!(ray.is_bitten);
            assert!((ray.new_mm - 16.25).abs() < 2.0 * STEP_MM, "{ray:?}");
            let rim_mm = crescent.rim_mm(ray.angle_rad).unwrap() - 16.25;
            assert!((edge.rim().min_mm - rim_mm).abs() < 0.3, "{:?}", edge.rim());
            assert!((edge.rim().min_angle_rad - angle_rad).abs() < 0.15);
        }
    }

    #[test]
    fn a_flap_inboard_of_a_cut_is_no_rim() {
        let (crescent, edge) = edge_after(|_| vec![outwards(0.0, 13.5)]);
        let ray = nearest(&edge, 0.0);
        let flap_mm = 13.5 - 2.25 - crescent.edge_mm(0.0).unwrap();
        assert!(flap_mm > 3.0);
        assert!((ray.new_mm - 15.75).abs() < 2.0 * STEP_MM, "{ray:?}");
    }

    #[test]
    fn rays_that_no_bite_meets_keep_the_free_edge() {
        let (crescent, edge) = edge_after(|_| vec![outwards(0.0, 14.0)]);
        let (bitten, whole): (Vec<Ray>, Vec<Ray>) = edge.rays.iter().partition(|ray| ray.is_bitten);
        assert!(bitten.iter().all(|ray| ray.angle_rad.abs() < 0.15));
        assert!(whole.len() > 400);
        for ray in whole {
            assert_eq!(Some(ray.new_mm), crescent.edge_mm(ray.angle_rad));
        }
        let mean_mm = bitten.iter().map(|ray| ray.rim_mm).sum::<f64>() / bitten.len() as f64;
        assert!((edge.rim().mean_mm - mean_mm).abs() < 1e-12);
    }
}
