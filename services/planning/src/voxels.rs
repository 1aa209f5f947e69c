//! The solid voxel space of the meniscus in the axes of its crescent.
//!
//! The voxels lie along the crescent's axes, not the scanner's, so that the same meniscus has the
//! same voxels however it lies in the CT.

use arthro_geometry::volume::{Grid, Solid};
use arthro_geometry::{Mesh, Point3, Vector3};

use crate::crescent::Crescent;
use crate::error::Error;

/// The tissue as voxels, column by column along the superior axis.
#[derive(Clone, Debug)]
pub struct Voxels {
    solid: Solid,
    /// Centres of the voxels of tissue, mm, column by column.
    centers: Vec<Point3>,
    /// First voxel of each column in `centers`, and one more at the end.
    columns: Vec<usize>,
    /// Half the greatest height of tissue above or below the origin, mm.
    reach_mm: f64,
}

impl Voxels {
    /// Fills a closed surface with voxels; around it the grid leaves `margin_mm`.
    pub fn of(
        mesh: &Mesh,
        crescent: &Crescent,
        voxel_mm: f64,
        margin_mm: f64,
    ) -> Result<Self, Error> {
        let mesh = crescent.localize(mesh);
        let (low, high) = mesh.bounds().ok_or(arthro_geometry::volume::Error::Empty)?;
        let margin = Vector3::repeat(margin_mm);
        let grid = Grid::covering(&(low - margin), &(high + margin), voxel_mm)?;
        let solid = Solid::on(grid, &mesh)?;
        let [width, depth, height] = solid.grid.size;
        let mut centers = Vec::new();
        let mut columns = vec![0];
        for j in 0..depth {
            for i in 0..width {
                let cells = (0..height).map(|k| [i, j, k]);
                centers.extend(
                    cells
                        .filter(|&cell| solid.is_inside(cell))
                        .map(|cell| solid.grid.center(cell)),
                );
                columns.push(centers.len());
            }
        }
        Ok(Self {
            solid,
            centers,
            columns,
            reach_mm: low.z.abs().max(high.z.abs()),
        })
    }

    /// Centres of all voxels of tissue, mm.
    pub fn centers(&self) -> &[Point3] {
        &self.centers
    }

    /// Edge of a voxel, mm.
    pub fn voxel_mm(&self) -> f64 {
        self.solid.grid.voxel_mm
    }

    /// Volume of a voxel, mm3.
    pub fn voxel_mm3(&self) -> f64 {
        self.voxel_mm().powi(3)
    }

    /// The greatest height of tissue above or below the origin, mm.
    pub fn reach_mm(&self) -> f64 {
        self.reach_mm
    }

    /// Indices of the voxels that an endless line meets, looked at once in each layer across the
    /// axis that it follows most.
    pub fn on_line(
        &self,
        through: &Point3,
        direction: &Vector3,
    ) -> impl Iterator<Item = usize> + '_ {
        let grid = &self.solid.grid;
        let axis = direction.iamax();
        let step = direction / direction[axis];
        // Half a cell on, so that a cell's own range is 0..1 and cutting off finds it.
        let position = (through - grid.origin) / grid.voxel_mm + Vector3::repeat(0.5);
        let first = position + step * (0.5 - position[axis]);
        (0..grid.size[axis]).filter_map(move |layer| self.voxel_in(first + step * layer as f64))
    }

    /// Index of the voxel of tissue that holds a point.
    pub fn at(&self, point: &Point3) -> Option<usize> {
        let grid = &self.solid.grid;
        self.voxel_in((point - grid.origin) / grid.voxel_mm + Vector3::repeat(0.5))
    }

    /// Index of the voxel at a position in cells from the grid's lowest corner.
    fn voxel_in(&self, position: Vector3) -> Option<usize> {
        let grid = &self.solid.grid;
        let inside = (0..3).all(|axis| (0.0..grid.size[axis] as f64).contains(&position[axis]));
        if !inside {
            return None;
        }
        let cell = [0, 1, 2].map(|axis| position[axis] as usize);
        if !self.solid.is_inside(cell) {
            return None;
        }
        let column = cell[1] * grid.size[0] + cell[0];
        let voxels = self.columns[column]..self.columns[column + 1];
        let floor_mm = grid.origin.z + (cell[2] as f64 - 0.5) * grid.voxel_mm;
        let below = self.centers[voxels.clone()].partition_point(|center| center.z < floor_mm);
        Some(voxels.start + below)
    }

    /// Distance of a point to the nearest voxel of tissue as far as `limit_mm`; 0 inside.
    pub fn distance_mm(&self, point: &Point3, limit_mm: f64) -> Option<f64> {
        let grid = &self.solid.grid;
        let reach = (limit_mm / grid.voxel_mm).ceil() + 1.0;
        let position = (point - grid.origin) / grid.voxel_mm;
        let range = |axis: usize| {
            let end = grid.size[axis] as f64;
            let low = (position[axis] - reach).round().clamp(0.0, end) as usize;
            let high = (position[axis] + reach + 1.0).round().clamp(0.0, end) as usize;
            low..high
        };
        let half = 0.5 * grid.voxel_mm;
        let mut nearest = f64::INFINITY;
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    if self.solid.is_inside([i, j, k]) {
                        let offset = point - grid.center([i, j, k]);
                        let outside = offset.map(|value| (value.abs() - half).max(0.0));
                        nearest = nearest.min(outside.norm_squared());
                    }
                }
            }
        }
        let distance_mm = nearest.sqrt();
        (distance_mm <= limit_mm).then_some(distance_mm)
    }

    /// Whether a point is in tissue or within `limit_mm` of a voxel of it.
    pub fn is_within(&self, point: &Point3, limit_mm: f64) -> bool {
        let own = self.solid.grid.cell_at(point);
        // Most points asked for are in tissue: the window around them need not be scanned.
        own.is_some_and(|cell| self.solid.is_inside(cell))
            || self.distance_mm(point, limit_mm).is_some()
    }

    /// Height of the middle of the tissue at a place in the plane, mm; beside the tissue that of the
    /// nearest column within `limit_mm`.
    pub fn middle_mm(&self, x: f64, y: f64, limit_mm: f64) -> Option<f64> {
        let mut nearest = (f64::INFINITY, 0.0);
        self.for_columns_near(x, y, limit_mm, |column| {
            let (low, high) = (&column[0], &column[column.len() - 1]);
            let squared = (low.x - x).powi(2) + (low.y - y).powi(2);
            if squared < nearest.0 {
                nearest = (squared, 0.5 * (low.z + high.z));
            }
        });
        nearest.0.is_finite().then_some(nearest.1)
    }

    /// Indices of the voxels in the columns within `radius_mm` (along each axis) of a place.
    pub fn near(&self, x: f64, y: f64, radius_mm: f64) -> impl Iterator<Item = usize> + '_ {
        let width = self.solid.grid.size[0];
        let (columns, rows) = self.window(x, y, radius_mm);
        rows.flat_map(move |j| {
            let row = j * width;
            self.columns[row + columns.start]..self.columns[row + columns.end]
        })
    }

    /// The columns of tissue within `radius_mm` (along each axis) of a place, as ranges of indices.
    pub fn columns_near(
        &self,
        x: f64,
        y: f64,
        radius_mm: f64,
    ) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let width = self.solid.grid.size[0];
        let (columns, rows) = self.window(x, y, radius_mm);
        let all = rows.flat_map(move |j| columns.clone().map(move |i| j * width + i));
        let ranges = all.map(|column| self.columns[column]..self.columns[column + 1]);
        ranges.filter(|column| !column.is_empty())
    }

    fn for_columns_near(&self, x: f64, y: f64, radius_mm: f64, mut visit: impl FnMut(&[Point3])) {
        for column in self.columns_near(x, y, radius_mm) {
            visit(&self.centers[column]);
        }
    }

    fn window(
        &self,
        x: f64,
        y: f64,
        radius_mm: f64,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let grid = &self.solid.grid;
        let range = |axis: usize, value: f64| {
            let end = grid.size[axis] as f64;
            let position = |at: f64| (at - grid.origin[axis]) / grid.voxel_mm;
            let low = position(value - radius_mm).ceil().clamp(0.0, end) as usize;
            let high = (position(value + radius_mm).floor() + 1.0).clamp(0.0, end) as usize;
            low..high.max(low)
        };
        (range(0, x), range(1, y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::phantom;

    fn phantom_voxels() -> (Crescent, Voxels) {
        let mesh = phantom::mesh();
        let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let voxels = Voxels::of(&mesh, &crescent, 0.5, 1.0).unwrap();
        (crescent, voxels)
    }

    #[test]
    fn the_voxels_have_the_volume_of_the_mesh() {
        let (_, voxels) = phantom_voxels();
        let volume_mm3 = voxels.centers().len() as f64 * voxels.voxel_mm3();
        assert!((volume_mm3 / phantom::mesh().volume_mm3() - 1.0).abs() < 0.02);
    }

    #[test]
    fn distance_is_zero_inside_and_grows_outside() {
        let (crescent, voxels) = phantom_voxels();
        let local = |point: Point3| crescent.ct_from_meniscal.inverse() * point;
        assert_eq!(voxels.distance_mm(&local(phantom::START), 1.0), Some(0.0));
        let below = local(phantom::GOAL - phantom::SUPERIOR * 2.8);
        let distance_mm = voxels.distance_mm(&below, 1.5).unwrap();
        assert!((distance_mm - 0.8).abs() < 0.4, "{distance_mm} mm");
        assert_eq!(voxels.distance_mm(&Point3::origin(), 1.0), None);
        assert_eq!(voxels.distance_mm(&Point3::new(1e9, 0.0, 0.0), 1.0), None);
    }

    #[test]
    fn a_line_meets_each_voxel_on_its_way_once() {
        let (_, voxels) = phantom_voxels();
        let through = voxels.centers()[voxels.centers().len() / 2] - Vector3::z() * 100.0;
        let met: Vec<usize> = voxels.on_line(&through, &Vector3::z()).collect();
        let column: Vec<usize> = voxels.near(through.x, through.y, 0.2).collect();
        assert_eq!(met, column);
        for center in voxels.centers() {
            let slanted = Vector3::new(0.7, -0.6, 1.1);
            let met: Vec<usize> = voxels.on_line(center, &slanted).collect();
            assert!(met.iter().any(|&voxel| voxels.centers()[voxel] == *center));
        }
        for nowhere in [Vector3::zeros(), Vector3::repeat(f64::NAN)] {
            assert_eq!(voxels.on_line(&through, &nowhere).count(), 0);
        }
        let beside = Point3::new(500.0, 0.0, 0.0);
        assert_eq!(voxels.on_line(&beside, &Vector3::z()).count(), 0);
    }
}
