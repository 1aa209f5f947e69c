//! The damaged tissue: points on a grid, each of which stands for the same volume.
//!
//! It comes from such points, from points or a closed curve that somebody set on the meniscus
//! ([`mod@marked`]), or from a label of a segmentation ([`mod@label`]).

pub mod label;
pub mod marked;

use arthro_geometry::Point3;

use crate::band::Band;
use crate::crescent::Crescent;
use crate::error::Error;
use crate::voxels::Voxels;

/// Largest share of the lesion that may lie outside the model, percent.
const MAX_OUTSIDE_PERCENT: f64 = 5.0;
/// Radius of a lesion point in grid spacings: a little more than the ball of a cell's volume, so
/// that neighbours leave no gap whichever way the grid is turned.
const POINT_RADIUS: f64 = 0.7;

/// The damaged tissue in the axes of the crescent.
#[derive(Clone, Debug)]
pub struct Lesion {
    /// Points in tissue, mm.
    pub points: Vec<Point3>,
    /// What each point stands for, mm3.
    pub point_mm3: f64,
    /// Which voxels are damaged, one flag a voxel.
    pub marks: Vec<bool>,
}

impl Lesion {
    /// From points in ct on a grid of `spacing_mm`. Those beside the tissue are left out; too many of
    /// them, or one further than `tolerance_mm`, is an error.
    pub fn of(
        points_in_ct: &[Point3],
        spacing_mm: f64,
        crescent: &Crescent,
        voxels: &Voxels,
        tolerance_mm: f64,
    ) -> Result<Self, Error> {
        let points = on_tissue(points_in_ct, crescent, voxels, tolerance_mm)?;
        let beside_mm = 0.5 * voxels.voxel_mm();
        let radius_mm = (POINT_RADIUS * spacing_mm).max(beside_mm);
        let mut marks = vec![false; voxels.centers().len()];
        for point in &points {
            for voxel in voxels.near(point.x, point.y, radius_mm) {
                let offset = voxels.centers()[voxel] - point;
                marks[voxel] |= offset.norm_squared() <= radius_mm * radius_mm;
            }
        }
        Ok(Self {
            points,
            point_mm3: spacing_mm.powi(3),
            marks,
        })
    }

    /// All tissue inboard of a contour.
    pub fn inboard_of(band: &Band, crescent: &Crescent, voxels: &Voxels) -> Self {
        let centers = voxels.centers().iter();
        let marks = centers.map(|center| band.contains(center, crescent));
        Self::of_voxels(marks.collect(), voxels)
    }

    /// The lesion that is a set of whole voxels.
    pub fn of_voxels(marks: Vec<bool>, voxels: &Voxels) -> Self {
        let damaged = voxels
            .centers()
            .iter()
            .zip(&marks)
            .filter(|(_, mark)| **mark);
        Self {
            points: damaged.map(|(center, _)| *center).collect(),
            point_mm3: voxels.voxel_mm3(),
            marks,
        }
    }

    /// The points in ct, mm, for a request that takes a lesion as such; they are apart by
    /// [`Lesion::spacing_mm`].
    pub fn points_in_ct(&self, crescent: &Crescent) -> Vec<Point3> {
        let points = self.points.iter();
        points
            .map(|point| crescent.ct_from_meniscal * *point)
            .collect()
    }

    /// Distance between the points of the grid, mm.
    pub fn spacing_mm(&self) -> f64 {
        self.point_mm3.cbrt()
    }

    /// Volume, mm3.
    pub fn volume_mm3(&self) -> f64 {
        self.points.len() as f64 * self.point_mm3
    }
}

/// The points that lie on the tissue, in the axes of the crescent. Too many beside it are an error.
fn on_tissue(
    points_in_ct: &[Point3],
    crescent: &Crescent,
    voxels: &Voxels,
    tolerance_mm: f64,
) -> Result<Vec<Point3>, Error> {
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let beside_mm = 0.5 * voxels.voxel_mm();
    let (mut points, mut farthest_mm, mut outside) = (Vec::new(), 0f64, 0usize);
    for point in points_in_ct {
        let point = meniscal_from_ct * *point;
        match voxels.distance_mm(&point, tolerance_mm) {
            Some(distance_mm) if distance_mm <= beside_mm => points.push(point),
            distance_mm => {
                outside += 1;
                farthest_mm = farthest_mm.max(distance_mm.unwrap_or(tolerance_mm));
            }
        }
    }
    let outside_percent = 100.0 * outside as f64 / points_in_ct.len().max(1) as f64;
    if outside_percent > MAX_OUTSIDE_PERCENT {
        return Err(Error::LesionOutsideModel {
            outside_percent,
            farthest_mm,
            limit_percent: MAX_OUTSIDE_PERCENT,
        });
    }
    Ok(points)
}

#[cfg(test)]
mod tests;
