//! The place of a resection: the crescent, and the tissue as columns along its superior axis.

use std::collections::BTreeMap;

use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::crescent::Crescent;
use arthro_planning::jaw::{Bite, Cut, Jaw};
use arthro_planning::voxels::Voxels;
use arthro_planning::{Error, plan};

/// Around the tissue the voxels leave this much, mm.
const MARGIN_MM: f64 = 1.0;
/// How much of the shaft behind the jaw its hinge takes, mm.
pub const HINGE_MM: f64 = 1.0;
/// Share of the hinge's footprint that may hold tissue when the jaw closes.
pub const HINGE_SHARE_MAX: f64 = 0.5;
/// Step between the places of a hinge that are looked at, mm.
const HINGE_STEP_MM: f64 = 0.1;

/// Crescent and tissue of one meniscus.
#[derive(Clone, Debug)]
pub struct Site {
    /// Where free edge and rim are.
    pub crescent: Crescent,
    /// The tissue.
    pub voxels: Voxels,
    /// Lowest and highest tissue of each column, by its place in voxels.
    columns: BTreeMap<(i64, i64), (f64, f64)>,
}

impl Site {
    /// The place of a closed surface; `above` lies on its superior side.
    pub fn of(mesh: &Mesh, above: &Point3, voxel_mm: f64) -> Result<Self, Error> {
        let (crescent, voxels) = plan::model(mesh, above, voxel_mm, MARGIN_MM)?;
        let half_mm = 0.5 * voxels.voxel_mm();
        let mut columns = BTreeMap::new();
        for center in voxels.centers() {
            let (low, high) = (center.z - half_mm, center.z + half_mm);
            let column = columns
                .entry(place(center.x, center.y, voxels.voxel_mm()))
                .or_insert((low, high));
            *column = (column.0.min(low), column.1.max(high));
        }
        Ok(Self {
            crescent,
            voxels,
            columns,
        })
    }

    /// The superior direction in ct.
    pub fn superior(&self) -> Vector3 {
        self.crescent.ct_from_meniscal.direction(&Vector3::z())
    }

    /// Lowest and highest tissue at a place, mm.
    pub fn column(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let place = place(x, y, self.voxels.voxel_mm());
        self.columns.get(&place).copied()
    }

    /// The greatest thickness of the tissue, mm.
    pub fn thickest_mm(&self) -> f64 {
        let columns = self.columns.values();
        columns.map(|(low, high)| high - low).fold(0.0, f64::max)
    }

    /// Thickness of the tissue around a place, mm; `None` away from it.
    pub fn thickness_mm(&self, x: f64, y: f64) -> Option<f64> {
        let (i, j) = place(x, y, self.voxels.voxel_mm());
        let around = (-2..=2).flat_map(|di| (-2..=2).map(move |dj| (i + di, j + dj)));
        let (sum, count) = around
            .filter_map(|place| self.columns.get(&place))
            .fold((0.0, 0.0), |(sum, count), (low, high)| {
                (sum + high - low, count + 1.0)
            });
        (count > 0.0).then(|| sum / count)
    }

    /// Share of each bite's hinge that holds tissue when the bite is made, the bites before it done.
    pub fn hinge_shares(&self, bites: &[Bite], jaw: &Jaw) -> Vec<f64> {
        let cuts: Vec<Cut> = bites.iter().map(|bite| bite.cut(jaw)).collect();
        let shares = bites.iter().enumerate();
        shares
            .map(|(order, bite)| self.hinge_share(bite, jaw, &cuts[..order]))
            .collect()
    }

    fn hinge_share(&self, bite: &Bite, jaw: &Jaw, done: &[Cut]) -> f64 {
        let steps = |length_mm: f64| (length_mm / HINGE_STEP_MM).round().max(1.0) as usize;
        let (behind, across) = (steps(HINGE_MM), steps(jaw.width_mm));
        let middle = |step: usize, count: usize| (step as f64 + 0.5) / count as f64;
        let places = (0..behind).flat_map(|i| (0..across).map(move |j| (i, j)));
        let held = places.filter(|&(i, j)| {
            let back_mm = 0.5 * jaw.length_mm + HINGE_MM * middle(i, behind);
            let aside_mm = jaw.width_mm * (middle(j, across) - 0.5);
            let at = bite.center - bite.approach * back_mm
                + bite.opening.cross(&bite.approach) * aside_mm;
            let Some((low, high)) = self.column(at.x, at.y) else {
                return false;
            };
            let tissue = Point3::new(at.x, at.y, 0.5 * (low + high));
            !done.iter().any(|cut| cut.contains(&tissue))
        });
        held.count() as f64 / (behind * across) as f64
    }
}

fn place(x: f64, y: f64, voxel_mm: f64) -> (i64, i64) {
    ((x / voxel_mm).floor() as i64, (y / voxel_mm).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::phantom;

    const JAW: Jaw = Jaw {
        width_mm: 3.0,
        length_mm: 4.5,
    };

    fn site() -> Site {
        Site::of(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL, 0.5).unwrap()
    }

    /// A bite from the middle of the hole towards the middle of the body.
    fn bite(radius_mm: f64) -> Bite {
        let center = Point3::new(radius_mm, 0.0, 0.0);
        Bite {
            center,
            approach: Vector3::x(),
            opening: Vector3::z(),
            contour_point: center,
        }
    }

    #[test]
    fn tissue_is_thin_at_the_free_edge_and_thick_at_the_rim() {
        let site = site();
        let (edge_mm, rim_mm) = (
            site.crescent.edge_mm(0.0).unwrap(),
            site.crescent.rim_mm(0.0).unwrap(),
        );
        let thickness = |radius_mm: f64| site.thickness_mm(radius_mm, 0.0).unwrap();
        assert!(thickness(edge_mm + 0.8) < 2.8 && thickness(rim_mm - 0.8) > 4.6);
        assert_eq!(site.thickness_mm(0.0, 0.0), None);
    }

    #[test]
    fn a_hinge_is_free_in_the_hole_held_in_tissue_and_freed_by_the_bite_before() {
        let site = site();
        let edge_mm = site.crescent.edge_mm(0.0).unwrap();
        let [first, second] = [bite(edge_mm + 1.0), bite(edge_mm + 4.5)];
        assert_eq!(site.hinge_shares(&[first], &JAW), [0.0]);
        assert!(site.hinge_shares(&[second], &JAW)[0] > 0.9);
        assert!(site.hinge_shares(&[first, second], &JAW)[1] < 0.1);
    }
}
