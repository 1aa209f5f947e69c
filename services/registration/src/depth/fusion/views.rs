//! Clouds from several viewpoints in one frame: near points of one surface become one, weighted by their noise.

use std::collections::HashMap;

use arthro_geometry::frame::{Camera, Frame};
use arthro_geometry::{Rigid, Vector3};
use rayon::prelude::*;

use super::super::deproject::SeenPoint;
use crate::error::Violation;

/// Edges of the cells that points are brought together in, mm.
pub const VOXELS_MM: std::ops::RangeInclusive<f64> = 0.05..=10.0;

/// What is wrong with a cell's edge.
pub fn voxel_violation(voxel_mm: f64) -> Option<Violation> {
    (!VOXELS_MM.contains(&voxel_mm)).then(|| {
        Violation::new(
            "header.voxel_mm",
            format!(
                "is {voxel_mm}, must be {} to {}",
                VOXELS_MM.start(),
                VOXELS_MM.end()
            ),
        )
    })
}

/// The points of a camera in frame `F`.
pub fn moved<F: Frame>(f_from_camera: &Rigid<F, Camera>, points: &[SeenPoint]) -> Vec<SeenPoint> {
    points
        .iter()
        .map(|point| SeenPoint {
            position: *f_from_camera * point.position,
            normal: f_from_camera.direction(&point.normal),
            ..*point
        })
        .collect()
}

/// One point for all that lie together on one side of a surface: the mean by 1 / sigma².
///
/// What lies in one cell of a grid is brought together, and then what lies in neighbouring cells because noise carried
/// it over their border: means nearer than 0.7 cells along the surface, whose distance across it is noise. Points whose
/// normals are more than a right angle apart are two sides of something thin, and stay two. `view` and `pixel` are those
/// of the most certain point. The points must be finite; their order does not matter for more than the last digits.
pub fn merged(points: &[SeenPoint], voxel_mm: f64) -> Vec<SeenPoint> {
    let mut order: Vec<(Cell, usize)> = points
        .par_iter()
        .enumerate()
        .map(|(index, point)| {
            // Within i64: a cast saturates.
            let cell = [0, 1, 2].map(|axis| (point.position[axis] / voxel_mm).floor() as i64);
            (cell, index)
        })
        .collect();
    order.par_sort_unstable();
    let mut sides: Vec<(Cell, Side<'_>)> = order
        .par_chunk_by(|(a, _), (b, _)| a == b)
        .flat_map_iter(|cell| {
            sides(points, cell)
                .into_iter()
                .map(|side| (cell[0].0, side))
        })
        .collect();
    drop(order);
    let is_kept = absorb(&mut sides, voxel_mm);
    sides
        .iter()
        .zip(is_kept)
        .filter(|(_, is_kept)| *is_kept)
        .map(|((_, side), _)| side.mean())
        .collect()
}

type Cell = [i64; 3];

/// Means nearer than this along the surface are one point, in cells.
const NEAR: f64 = 0.7;
/// Noise that is no distance, in standard deviations of one point.
const SIGNIFICANT: f64 = 4.0;

/// The sides of what lies in one cell.
fn sides<'a>(points: &'a [SeenPoint], cell: &[(Cell, usize)]) -> Vec<Side<'a>> {
    let mut certain: Vec<&SeenPoint> = cell.iter().map(|(_, index)| &points[*index]).collect();
    certain.sort_by(|a, b| a.sigma_mm.total_cmp(&b.sigma_mm));
    let mut sides: Vec<Side<'_>> = Vec::new();
    for point in certain {
        match sides
            .iter_mut()
            .find(|side| side.normal.dot(&point.normal) > 0.0)
        {
            Some(side) => side.add(point),
            None => sides.push(Side::new(point)),
        }
    }
    sides
}

/// Adds to each side, the weightiest first, those around that are the same surface; says which are left.
fn absorb(sides: &mut [(Cell, Side<'_>)], voxel_mm: f64) -> Vec<bool> {
    let mut of_cell: HashMap<Cell, Vec<usize>> = HashMap::with_capacity(sides.len());
    for (index, (cell, _)) in sides.iter().enumerate() {
        of_cell.entry(*cell).or_default().push(index);
    }
    let mut order: Vec<usize> = (0..sides.len()).collect();
    order.sort_by(|a, b| sides[*b].1.weight.total_cmp(&sides[*a].1.weight));
    let mut is_kept = vec![true; sides.len()];
    let mut is_done = vec![false; sides.len()];
    for index in order {
        if !is_kept[index] {
            continue;
        }
        is_done[index] = true;
        let (cell, own) = sides[index];
        for other in around(&cell)
            .filter_map(|near| of_cell.get(&near))
            .flatten()
        {
            let (_, side) = sides[*other];
            if !is_done[*other] && is_kept[*other] && own.is_same(&side, voxel_mm) {
                is_kept[*other] = false;
                sides[index].1.absorb(&side);
            }
        }
    }
    is_kept
}

/// A cell and the 26 around it.
fn around(cell: &Cell) -> impl Iterator<Item = Cell> {
    let [x, y, z] = *cell;
    let near = |middle: i64| middle.saturating_sub(1)..=middle.saturating_add(1);
    near(x).flat_map(move |x| near(y).flat_map(move |y| near(z).map(move |z| [x, y, z])))
}

/// Sums over the points of one side.
#[derive(Clone, Copy)]
struct Side<'a> {
    first: &'a SeenPoint,
    weight: f64,
    position: Vector3,
    normal_weight: f64,
    normal: Vector3,
}

impl<'a> Side<'a> {
    fn new(first: &'a SeenPoint) -> Self {
        let mut side = Self {
            first,
            weight: 0.0,
            position: Vector3::zeros(),
            normal_weight: 0.0,
            normal: Vector3::zeros(),
        };
        side.add(first);
        side
    }

    fn add(&mut self, point: &SeenPoint) {
        let (weight, normal_weight) = (point.sigma_mm.powi(-2), point.normal_sigma_rad.powi(-2));
        self.weight += weight;
        self.position += point.position.coords * weight;
        self.normal_weight += normal_weight;
        self.normal += point.normal * normal_weight;
    }

    fn absorb(&mut self, other: &Side<'_>) {
        self.weight += other.weight;
        self.position += other.position;
        self.normal_weight += other.normal_weight;
        self.normal += other.normal;
    }

    /// Whether `other` is the same piece of surface, apart from noise.
    fn is_same(&self, other: &Side<'_>, voxel_mm: f64) -> bool {
        let (mean, offset) = (
            self.mean(),
            other.position / other.weight - self.position / self.weight,
        );
        let across_mm = offset.dot(&mean.normal);
        let along_mm = (offset - mean.normal * across_mm).norm();
        let noise_mm = SIGNIFICANT * self.first.sigma_mm.max(other.first.sigma_mm);
        self.normal.dot(&other.normal) > 0.0
            && along_mm < NEAR * voxel_mm
            && across_mm.abs() < noise_mm
    }

    fn mean(&self) -> SeenPoint {
        SeenPoint {
            position: (self.position / self.weight).into(),
            normal: self.normal.try_normalize(0.0).unwrap_or(self.first.normal),
            sigma_mm: self.weight.powf(-0.5),
            normal_sigma_rad: self.normal_weight.powf(-0.5),
            ..*self.first
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::frame::Base;
    use arthro_geometry::{Point3, Rotation};

    fn seen(position: [f64; 3], normal: Vector3, sigma_mm: f64, view: u32) -> SeenPoint {
        SeenPoint {
            position: Point3::from(position),
            normal,
            sigma_mm,
            normal_sigma_rad: sigma_mm,
            view,
            pixel: 10 + view,
        }
    }

    #[test]
    fn near_points_become_one_and_the_more_certain_one_weighs_more() {
        let up = Vector3::z();
        let points = [
            seen([0.1, 0.1, 0.1], up, 0.2, 0),
            seen([0.1, 0.1, 0.4], up, 0.1, 1),
            seen([0.9, 0.1, 0.1], up, 0.1, 0),
        ];
        let merged = merged(&points, 0.5);
        assert_eq!(merged.len(), 2);
        // Weights 25 and 100.
        assert!((merged[0].position - Point3::new(0.1, 0.1, 0.34)).norm() < 1e-12);
        assert!((merged[0].sigma_mm - 125f64.powf(-0.5)).abs() < 1e-12);
        assert_eq!((merged[0].view, merged[0].pixel), (1, 11));
        assert!((merged[1].position - points[2].position).norm() < 1e-12);
        assert!((merged[1].sigma_mm - 0.1).abs() < 1e-12);
    }

    #[test]
    fn noise_across_the_border_of_a_cell_makes_no_second_sheet() {
        let up = Vector3::z();
        let sheet: Vec<SeenPoint> = (0..100)
            .map(|i| {
                let height = if i % 3 == 0 { 0.05 } else { -0.05 };
                seen([0.5 * f64::from(i) + 0.2, 0.2, height], up, 0.1, 0)
            })
            .collect();
        assert_eq!(merged(&sheet, 0.5).len(), 100);
        let means = merged(&sheet, 1.5);
        assert!(means.len() <= 34, "{}", means.len());
        for point in &means {
            assert!((point.position.z + 0.05 / 3.0).abs() < 0.02, "{point:?}");
        }
        // Two sheets that are farther apart than their noise stay two.
        let stairs = [
            seen([0.2, 0.2, -0.3], up, 0.05, 0),
            seen([0.2, 0.2, 0.3], up, 0.05, 0),
        ];
        assert_eq!(merged(&stairs, 0.5).len(), 2);
    }

    #[test]
    fn the_two_sides_of_a_thin_sheet_stay_two() {
        let points = [
            seen([0.1, 0.1, 0.2], Vector3::z(), 0.1, 0),
            seen([0.1, 0.1, 0.1], -Vector3::z(), 0.1, 1),
        ];
        assert_eq!(merged(&points, 0.5).len(), 2);
    }

    #[test]
    fn points_and_normals_are_moved_together() {
        let quarter = Rotation::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let base_from_camera = Rigid::<Base, _>::new(quarter, Vector3::new(1.0, 2.0, 3.0));
        let [point] = moved(
            &base_from_camera,
            &[seen([0.0, 0.0, 5.0], -Vector3::z(), 0.1, 0)],
        )[..] else {
            panic!("not one point");
        };
        assert!((point.position - Point3::new(1.0, -3.0, 3.0)).norm() < 1e-12);
        assert!((point.normal - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn a_cell_without_an_edge_is_refused() {
        assert!(voxel_violation(0.5).is_none());
        for bad in [0.0, -1.0, f64::NAN, 11.0] {
            assert!(voxel_violation(bad).is_some(), "{bad}");
        }
    }
}
