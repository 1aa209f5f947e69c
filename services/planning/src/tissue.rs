//! The joint's tissue, updated bite by bite.
//!
//! What a bite takes depends on the bites before it, and so does whether the jaw can close at all:
//! tissue that stands in the throat of the jaw blocks its hinge. Optimiser and evaluation ask the
//! same [`Tissue`], so that a plan is judged by the rule that it was made by.

use crate::jaw::{Cut, Throat};
use crate::voxels::Voxels;

/// Share of the throat's footprint that may hold tissue when the bite is made: an assumption, since
/// soft tissue gives way a little and no maker states a figure.
pub const THROAT_LIMIT: f64 = 0.5;
/// Distance between the lines through the throat's footprint, mm.
const LINE_SPACING_MM: f64 = 0.25;

/// The tissue that is left, in the axes of the crescent.
#[derive(Clone, Debug)]
pub struct Tissue<'a> {
    voxels: &'a Voxels,
    left: Vec<bool>,
}

impl<'a> Tissue<'a> {
    /// The tissue before the first bite.
    pub fn whole(voxels: &'a Voxels) -> Self {
        Self {
            voxels,
            left: vec![true; voxels.centers().len()],
        }
    }

    /// Bites; returns the voxels that went, ascending.
    pub fn bite(&mut self, cut: &Cut) -> Vec<u32> {
        let mut removed = cut_voxels(cut, self.voxels);
        removed.retain(|&voxel| std::mem::replace(&mut self.left[voxel as usize], false));
        removed
    }

    /// Whether a voxel is still there.
    pub fn is_left(&self, voxel: u32) -> bool {
        self.left[voxel as usize]
    }

    /// How many voxels are still there.
    pub fn left(&self) -> usize {
        self.left.iter().filter(|left| **left).count()
    }

    /// Share of the throat's footprint that tissue blocks now, 0..1.
    pub fn throat_share(&self, throat: &Throat) -> f64 {
        self.share_left(&throat_weights(throat, self.voxels))
    }

    /// Sum of the weights of the voxels that are still there: with the weights of
    /// [`throat_weights`], the blocked share of the throat.
    pub fn share_left(&self, weights: &[(u32, f64)]) -> f64 {
        let left = weights.iter().filter(|(voxel, _)| self.is_left(*voxel));
        left.fold(0.0, |sum, (_, weight)| sum + weight)
    }
}

/// The voxels of the whole tissue that a bite would cut, ascending.
pub fn cut_voxels(cut: &Cut, voxels: &Voxels) -> Vec<u32> {
    let center = cut.center();
    let height_mm = voxels.reach_mm() + center.z.abs();
    let centers = voxels.centers();
    voxels
        .columns_near(center.x, center.y, cut.reach_mm(height_mm))
        .filter(|column| cut.may_meet(&centers[column.start], height_mm))
        .flatten()
        .filter(|&voxel| cut.contains(&centers[voxel]))
        .map(|voxel| voxel as u32)
        .collect()
}

/// The voxels of the whole tissue in a throat, ascending, and what each blocks of its footprint.
///
/// Lines along the opening divide the footprint evenly; each blocks its part of it as far as the
/// tissue that it met in the whole meniscus is still there. A cut through the full thickness thus
/// frees exactly the footprint that it covers, a sliver left by a slanted cut blocks by its volume,
/// and the weights add up to the share that held tissue before the first bite.
pub fn throat_weights(throat: &Throat, voxels: &Voxels) -> Vec<(u32, f64)> {
    let mut lines = 0usize;
    let mut weights: Vec<(u32, f64)> = Vec::new();
    for point in throat.footprint(LINE_SPACING_MM) {
        lines += 1;
        let first = weights.len();
        let met = voxels.on_line(&point, &throat.opening);
        weights.extend(met.map(|voxel| (voxel as u32, 1.0)));
        let met = (weights.len() - first) as f64;
        for (_, weight) in &mut weights[first..] {
            *weight /= met;
        }
    }
    weights.sort_unstable_by_key(|(voxel, _)| *voxel);
    weights.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
    for (_, weight) in &mut weights {
        *weight /= lines.max(1) as f64;
    }
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crescent::Crescent;
    use crate::jaw::{Bite, Jaw};
    use arthro_geometry::{Point3, Vector3, phantom};

    fn phantom_voxels(voxel_mm: f64) -> (Crescent, Voxels) {
        let mesh = phantom::mesh();
        let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let voxels = Voxels::of(&mesh, &crescent, voxel_mm, 1.0).unwrap();
        (crescent, voxels)
    }

    fn jaw() -> Jaw {
        Jaw::new(3.0, 4.5)
    }

    /// A bite in the middle of the body whose shaft comes from the hollow, `depth_mm` between the
    /// free edge and the middle of the jaw.
    fn from_the_hollow(crescent: &Crescent, depth_mm: f64) -> Bite {
        let center = Point3::new(crescent.edge_mm(0.0).unwrap() + depth_mm, 0.0, 0.0);
        Bite::of_axis(center, &Vector3::x(), &Vector3::z()).unwrap()
    }

    #[test]
    fn tissue_goes_once() {
        let (crescent, voxels) = phantom_voxels(0.5);
        let cut = from_the_hollow(&crescent, 1.0).cut(&jaw());
        let mut tissue = Tissue::whole(&voxels);
        let removed = tissue.bite(&cut);
        assert_eq!(removed, cut_voxels(&cut, &voxels));
        assert!(removed.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(removed.iter().all(|&voxel| !tissue.is_left(voxel)));
        assert_eq!(tissue.bite(&cut), Vec::<u32>::new());
    }

    #[test]
    fn a_cut_takes_the_voxels_whose_centres_it_holds() {
        let (crescent, voxels) = phantom_voxels(0.5);
        let mut bite = from_the_hollow(&crescent, 3.0);
        for opening in [Vector3::z(), Vector3::y()] {
            bite.opening = opening;
            let cut = bite.cut(&jaw());
            let held = (0u32..).zip(voxels.centers());
            let held = held.filter(|(_, center)| cut.contains(center));
            let held: Vec<u32> = held.map(|(voxel, _)| voxel).collect();
            assert_eq!(cut_voxels(&cut, &voxels), held);
        }
    }

    #[test]
    fn a_throat_is_free_in_the_hollow_and_blocked_in_the_body() {
        let (crescent, voxels) = phantom_voxels(0.5);
        let tissue = Tissue::whole(&voxels);
        let share =
            |depth_mm| tissue.throat_share(&from_the_hollow(&crescent, depth_mm).throat(&jaw()));
        assert_eq!(share(1.0), 0.0);
        assert!((share(5.5) - 1.0).abs() < 1e-9);
    }

    /// Bites all over the body and the posterior horn, whichever way they point.
    fn scattered_bites() -> impl Iterator<Item = Bite> {
        (0..60).map(|step| {
            let step = f64::from(step);
            let (angle_rad, radius_mm) = (-1.2 + 0.03 * step, 13.0 + (step * 0.37) % 7.0);
            let center = Point3::new(
                radius_mm * angle_rad.cos(),
                radius_mm * angle_rad.sin(),
                1.0,
            );
            let axis = Vector3::new((step * 1.7).cos(), (step * 1.7).sin(), -0.2);
            Bite::of_axis(center, &axis, &Vector3::z()).unwrap()
        })
    }

    fn rms(errors: &[f64]) -> f64 {
        (errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64).sqrt()
    }

    #[test]
    fn the_share_before_the_first_bite_is_that_of_the_true_shape() {
        let (crescent, voxels) = phantom_voxels(0.5);
        let tissue = Tissue::whole(&voxels);
        let shape = phantom::Phantom::default();
        let mut errors = Vec::new();
        for bite in scattered_bites() {
            let throat = bite.throat(&jaw());
            let footprint: Vec<Point3> = throat.footprint(0.05).collect();
            let blocked = footprint.iter().filter(|point| {
                let mut line =
                    (-160..160).map(|step| *point + bite.opening * (f64::from(step) * 0.05));
                line.any(|point| shape.contains(&(crescent.ct_from_meniscal * point)))
            });
            let share = blocked.count() as f64 / footprint.len() as f64;
            errors.push(tissue.throat_share(&throat) - share);
        }
        assert!(rms(&errors) < 0.05, "{errors:.3?}");
    }

    #[test]
    fn a_bite_frees_the_part_of_the_throat_that_it_covers() {
        let (_, voxels) = phantom_voxels(0.5);
        let mut errors = Vec::new();
        for bite in scattered_bites() {
            let weights = throat_weights(&bite.throat(&jaw()), &voxels);
            let whole = Tissue::whole(&voxels).share_left(&weights);
            if whole < 1.0 - 1e-9 {
                continue;
            }
            // Over the throat in full, and 1.2 of its 3 mm to the side.
            let across = bite.opening.cross(&bite.approach);
            let other = bite.displaced(&(across * 1.2 - bite.approach * 2.75));
            let mut tissue = Tissue::whole(&voxels);
            tissue.bite(&other.cut(&jaw()));
            errors.push(tissue.share_left(&weights) - 0.4);
        }
        assert!(errors.len() > 20);
        assert!(rms(&errors) < 0.05, "{errors:.3?}");
    }

    #[test]
    fn a_sliver_blocks_by_its_volume() {
        let (crescent, voxels) = phantom_voxels(0.3);
        let throat = from_the_hollow(&crescent, 6.0).throat(&jaw());
        let weights = throat_weights(&throat, &voxels);
        assert!(weights.windows(2).all(|pair| pair[0].0 < pair[1].0));
        let upper = weights
            .iter()
            .filter(|(voxel, _)| voxels.centers()[*voxel as usize].z > 0.0);
        let upper: f64 = upper.map(|(_, weight)| weight).sum();
        let whole: f64 = weights.iter().map(|(_, weight)| weight).sum();
        assert!((whole - 1.0).abs() < 1e-9);
        assert!(upper > 0.1 && upper < 0.9, "{upper}");
    }
}
