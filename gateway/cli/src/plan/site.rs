//! The place of a resection: the crescent, and the tissue as columns along its superior axis.

use std::collections::BTreeMap;

use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::crescent::Crescent;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::tissue::Tissue;
use arthro_planning::voxels::Voxels;
use arthro_planning::{Error, plan};

/// Around the tissue the voxels leave this much, and so far beside it a mark may lie, mm.
pub const MARGIN_MM: f64 = 1.0;

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

    /// Share of each bite's throat that holds tissue when the bite is made, the bites before it done. The bites are in
    /// the axes of the crescent.
    pub fn throat_shares(&self, bites: &[Bite], jaw: &Jaw) -> Vec<f64> {
        let mut tissue = Tissue::whole(&self.voxels);
        let shares = bites.iter().map(|bite| {
            let share = tissue.throat_share(&bite.throat(jaw));
            tissue.bite(&bite.cut(jaw));
            share
        });
        shares.collect()
    }
}

fn place(x: f64, y: f64, voxel_mm: f64) -> (i64, i64) {
    ((x / voxel_mm).floor() as i64, (y / voxel_mm).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::phantom;

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
    fn a_throat_is_free_in_the_hole_held_in_tissue_and_freed_by_the_bite_before() {
        let site = site();
        let edge_mm = site.crescent.edge_mm(0.0).unwrap();
        let [first, second] = [bite(edge_mm + 1.0), bite(edge_mm + 4.5)];
        let jaw = Jaw::new(3.0, 4.5);
        assert_eq!(site.throat_shares(&[first], &jaw), [0.0]);
        assert!(site.throat_shares(&[second], &jaw)[0] > 0.9);
        assert!(site.throat_shares(&[first, second], &jaw)[1] < 0.1);
    }
}
