//! The distance to a bone's surface on a grid, made once so that looking it up costs eight reads.
//!
//! Farther than [`MARGIN_MM`] only that is stored: nobody asks for more, and the nearest of many
//! triangles is the dearer to find the farther they all are. A sample is exact; between samples the distance is interpolated. Distance changes by at most 1 mm
//! a mm, so the interpolated value is wrong by at most the root of 3/4 of the spacing: the mean of
//! |p - corner| over the weights of the corners is at most the root of its mean square, which is
//! greatest in the middle of a cell. On surfaces as smooth as a bone it is wrong by far less.

use rayon::prelude::*;

use arthro_geometry::volume::{self, Grid, Solid};
use arthro_geometry::{Mesh, Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::convert::to_glam;
use crate::error::Error;

/// Distance between two samples, mm.
pub const SPACING_MM: f64 = 1.0;
/// Most that an interpolated value can be wrong, mm.
pub const ERROR_MM: f64 = 0.867 * SPACING_MM;
/// How far around the bone the grid reaches and the greatest distance that is stored, outside and
/// inside, mm.
pub const MARGIN_MM: f64 = 8.0;
/// Most samples, 16 MB.
pub const MAX_SAMPLES: usize = 4_000_000;

/// Distance to a surface up to [`MARGIN_MM`], negative in what it encloses.
#[derive(Clone, Debug)]
pub struct DistanceField {
    grid: Grid,
    samples_mm: Vec<f32>,
    low: Point3,
    high: Point3,
}

impl DistanceField {
    /// Samples the distance to `surface`, which is `mesh`, around it. `bone` names it in errors.
    ///
    /// # Errors
    /// When the mesh cannot be used or more than [`MAX_SAMPLES`] would be needed; [`Error::Cancelled`] once
    /// it is no longer `is_awaited`.
    pub fn of(
        bone: &'static str,
        mesh: &Mesh,
        surface: &TriMesh,
        is_awaited: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, Error> {
        let unusable = |error: volume::Error| Error::invalid(bone, error.to_string());
        let (low, high) = mesh.bounds().ok_or(unusable(volume::Error::Empty))?;
        let margin = Vector3::repeat(MARGIN_MM);
        let needed = ((high - low + margin * 2.0) / SPACING_MM).map(|cells| cells.ceil() + 2.0);
        let needed = needed.product();
        if needed > MAX_SAMPLES as f64 {
            return Err(Error::invalid(
                bone,
                format!(
                    "spans {:.0} x {:.0} x {:.0} mm, which needs {needed:.0} samples of {SPACING_MM} mm; the limit is {MAX_SAMPLES}: keep what is near the joint",
                    high.x - low.x,
                    high.y - low.y,
                    high.z - low.z
                ),
            ));
        }
        let grid = Grid::covering(&(low - margin), &(high + margin), SPACING_MM);
        let grid = grid.map_err(unusable)?;
        let inside = match Solid::on(grid.clone(), mesh) {
            Ok(solid) => Some(solid),
            // An open surface is a wall: on both sides of it the distance is positive.
            Err(volume::Error::Open { .. }) => None,
            Err(error) => return Err(unusable(error)),
        };
        let (grid_of, inside) = (&grid, inside.as_ref());
        let [width, depth, height] = grid.size;
        let row = |j: usize, k: usize| {
            // The sample before one bounds it, except where the row begins.
            let mut before_mm = MARGIN_MM;
            let samples = (0..width).map(move |i| {
                let cell = [i, j, k];
                let at = to_glam(&grid_of.center(cell));
                let bound_mm = MARGIN_MM.min(before_mm + 1.01 * SPACING_MM);
                let nearest = surface.project_local_point_with_max_dist(at, false, bound_mm);
                before_mm = nearest.map_or(MARGIN_MM, |nearest| (nearest.point - at).length());
                let is_inside = inside.is_some_and(|solid| solid.is_inside(cell));
                (if is_inside { -before_mm } else { before_mm }) as f32
            });
            samples.collect::<Vec<f32>>()
        };
        let plane = |k: usize| {
            let rows = is_awaited().then(|| (0..depth).flat_map(|j| row(j, k)).collect());
            rows.ok_or(Error::Cancelled)
        };
        let planes: Vec<Vec<f32>> = (0..height)
            .into_par_iter()
            .map(plane)
            .collect::<Result<_, _>>()?;
        let samples_mm = planes.concat();
        Ok(Self {
            grid,
            samples_mm,
            low,
            high,
        })
    }

    /// How many samples there are.
    pub fn samples(&self) -> usize {
        self.samples_mm.len()
    }

    /// Distance of a point to the surface, mm, negative inside, at most [`MARGIN_MM`] either way. Outside the grid it is the distance to
    /// the box around the surface, at least [`MARGIN_MM`] and at most the truth. A point that is not a
    /// number is at distance 0.
    pub fn distance_mm(&self, point: &Point3) -> f64 {
        let position = (point - self.grid.origin) / self.grid.voxel_mm;
        let [width, depth, height] = self.grid.size;
        let within = |value: f64, size: usize| value >= 0.0 && value < (size - 1) as f64;
        if !(within(position.x, width) && within(position.y, depth) && within(position.z, height)) {
            let outside = (self.low - point).sup(&(point - self.high));
            return outside.map(|value| value.max(0.0)).norm();
        }
        let (i, j, k) = (
            position.x as usize,
            position.y as usize,
            position.z as usize,
        );
        let share = [
            (position.x - i as f64) as f32,
            (position.y - j as f64) as f32,
            (position.z - k as f64) as f32,
        ];
        let first = self.grid.index([i, j, k]);
        let along_x = |row: usize| {
            let (a, b) = (self.samples_mm[row], self.samples_mm[row + 1]);
            a + share[0] * (b - a)
        };
        let along_y = |plane: usize| {
            let (a, b) = (along_x(plane), along_x(plane + width));
            a + share[1] * (b - a)
        };
        let (a, b) = (along_y(first), along_y(first + width * depth));
        f64::from(a + share[2] * (b - a))
    }
}
