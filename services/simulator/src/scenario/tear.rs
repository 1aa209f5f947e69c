//! A small radial tear in the middle of the body, and the part of the free edge around it that the
//! resection may take.

use arthro_geometry::Point3;

use super::crescent::{Crescent, Sector, polar};
use super::spec::TearSpec;
use crate::voxels::Voxels;

/// A cleft from the free edge towards the rim through the full thickness, in the knee's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tear {
    /// Across the cleft, mm.
    pub width_mm: f64,
    /// Where the cleft ends, from the middle of the hole, mm.
    pub end_mm: f64,
}

impl Tear {
    /// In the middle of the body.
    pub fn in_body(crescent: &Crescent, spec: &TearSpec) -> Self {
        let body = edge_near(crescent, 0.0);
        let depth_mm = spec.depth_fraction * body.width_mm();
        let deepest_mm = (body.width_mm() - spec.rim_min_mm).max(0.0);
        Self {
            width_mm: spec.width_mm,
            end_mm: body.free_edge_mm + depth_mm.min(deepest_mm),
        }
    }

    /// Whether tissue at this point of the knee's frame is damaged.
    pub fn contains(&self, at: &Point3) -> bool {
        let (phi_rad, radius_mm) = polar(at);
        phi_rad.cos() > 0.0
            && (radius_mm * phi_rad.sin()).abs() <= 0.5 * self.width_mm
            && radius_mm <= self.end_mm
    }

    /// The middle of the free edge at an angle from the tear, ct.
    pub fn end_of_contour(&self, crescent: &Crescent, voxels: &Voxels, phi_deg: f64) -> Point3 {
        // Half a millimetre into the tissue, so that the point lies on it however it is voxelised.
        const INTO_TISSUE_MM: f64 = 0.5;
        let phi_rad = phi_deg.to_radians();
        let radius_mm = edge_near(crescent, phi_rad).free_edge_mm + INTO_TISSUE_MM;
        let column = crescent.point(phi_rad, radius_mm, 0.0);
        let knee_from_ct = crescent.ct_from_knee.inverse();
        let seed = knee_from_ct * column;
        let heights: Vec<f64> = voxels
            .solid_cells()
            .map(|cell| knee_from_ct * voxels.center(cell))
            .filter(|at| (at.xy() - seed.xy()).norm() < INTO_TISSUE_MM)
            .map(|at| at.z)
            .collect();
        let height_mm = if heights.is_empty() {
            0.5 * crescent.height_mm
        } else {
            heights.iter().sum::<f64>() / heights.len() as f64
        };
        crescent.point(phi_rad, radius_mm, height_mm)
    }

    /// Lowest and highest corner in ct of the tissue within `reach_deg` of the tear.
    pub fn neighbourhood(
        &self,
        crescent: &Crescent,
        voxels: &Voxels,
        reach_deg: f64,
    ) -> (Point3, Point3) {
        // The ends of the contour lie on the border of the reach; targets may be set a jaw beyond.
        const MARGIN_MM: f64 = 3.0;
        let knee_from_ct = crescent.ct_from_knee.inverse();
        let near: Vec<Point3> = voxels
            .solid_cells()
            .map(|cell| voxels.center(cell))
            .filter(|point| polar(&(knee_from_ct * *point)).0.abs() <= reach_deg.to_radians())
            .collect();
        let (low, high) = arthro_geometry::cloud::bounds(&near).unwrap_or((
            crescent.ct_from_knee.origin(),
            crescent.ct_from_knee.origin(),
        ));
        (
            low.map(|value| value - MARGIN_MM),
            high.map(|value| value + MARGIN_MM),
        )
    }
}

/// Free edge and rim at `phi_rad`: the median over the rays within 4 degrees, so that one cell that
/// sticks out does not move the tear.
fn edge_near(crescent: &Crescent, phi_rad: f64) -> Sector {
    const WITHIN_RAD: f64 = 0.07;
    let near: Vec<Sector> = crescent
        .sectors()
        .filter(|sector| (sector.phi_rad - phi_rad).abs() <= WITHIN_RAD)
        .collect();
    let median = |value: fn(&Sector) -> f64| {
        let mut values: Vec<f64> = near.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    Sector {
        phi_rad,
        free_edge_mm: median(|sector| sector.free_edge_mm),
        rim_mm: median(|sector| sector.rim_mm),
    }
}
