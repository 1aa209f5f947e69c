//! Evenly spread samples of a cloud: one averaged point a voxel, and normals fitted to neighbourhoods.

use arthro_geometry::{Point3, Vector3};
use rayon::prelude::*;

use crate::cells::Cells;
use crate::moments::Moments;
use crate::neighbours::Neighbours;

/// Averages the points that share a voxel of `edge_mm`. The order of the answer depends on positions alone.
pub fn voxel_average(points: &[Point3], edge_mm: f64) -> Vec<Point3> {
    let mut keyed: Vec<([i32; 3], u32)> = points
        .iter()
        .enumerate()
        .map(|(index, point)| {
            let cell = |c: f64| (c / edge_mm).floor() as i32;
            ([cell(point.x), cell(point.y), cell(point.z)], index as u32)
        })
        .collect();
    keyed.sort_unstable();
    keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|voxel| {
            let sum: Vector3 = voxel.iter().map(|(_, i)| points[*i as usize].coords).sum();
            Point3::from(sum / voxel.len() as f64)
        })
        .collect()
}

/// At most `count` points spread evenly: the finest voxels, in steps of a fifth, that leave no more than `count`.
pub fn spread(points: &[Point3], count: usize) -> Vec<Point3> {
    let Some((low, high)) = arthro_geometry::cloud::bounds(points) else {
        return Vec::new();
    };
    // Averaging more than a few points a voxel gains nothing and costs a sort of all of them.
    let stride = points.len() / (16 * count) + 1;
    let dense: Vec<Point3> = points
        .chunks(stride)
        .enumerate()
        .map(|(index, chunk)| chunk[scattered(index) % chunk.len()])
        .collect();
    let mut sample = dense.clone();
    // A surface fills about the square of its box's diagonal; begin well below the spacing that follows.
    let mut edge_mm = 0.3 * (high - low).norm() / (count as f64).sqrt();
    while sample.len() > count {
        sample = voxel_average(&dense, edge_mm);
        edge_mm *= 1.2;
    }
    sample
}

/// A whole number that looks random (splitmix64): every so-many-th point of an organised cloud may be one of its columns.
fn scattered(index: usize) -> usize {
    let mut bits = (index as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (bits ^ (bits >> 31)) as usize
}

/// Fewer points than this, the place itself among them, give no normal.
const LEAST_NEIGHBOURS: f64 = 4.0;

/// Unit normals of the planes that best fit the neighbours within `radius_mm` of each point; signs are arbitrary.
/// Where they are too few, the normal is that of the points within twice the radius, and so on.
pub fn fitted_normals(points: &[Point3], cells: &Cells, radius_mm: f64) -> Vec<Vector3> {
    points
        .par_iter()
        .with_min_len(64)
        .map(|point| {
            let mut reach_mm = radius_mm;
            loop {
                match Moments::around(point, points, cells, reach_mm) {
                    Some(moments) if moments.count >= LEAST_NEIGHBOURS.min(points.len() as f64) => {
                        break moments.plane().normal;
                    }
                    _ => reach_mm *= 2.0,
                }
            }
        })
        .collect()
}

/// Neighbours whose distance tells the spacing.
const SPACING_NEIGHBOURS: usize = 8;

/// Spacing of points on a surface, mm: one over the root of their density, median over the surface. The nearest
/// neighbour's distance would tell how irregular they are, not how dense: the eighth's circle holds eight.
pub fn spacing_mm(points: &[Point3]) -> f64 {
    let tree = Neighbours::new(points);
    let count = SPACING_NEIGHBOURS.min(points.len().saturating_sub(1));
    let mut distances: Vec<f64> = points
        .iter()
        .step_by(points.len() / 300 + 1)
        .filter_map(|point| Some(tree.nearest_many(point, count + 1).get(count)?.distance2))
        .collect();
    (median(&mut distances) * std::f64::consts::PI / count.max(1) as f64).sqrt()
}

/// The middle value, the upper one of two; 0 of nothing.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane() -> Vec<Point3> {
        (0..40)
            .flat_map(|i| (0..40).map(move |j| Point3::new(i as f64 * 0.5, j as f64 * 0.5, 3.0)))
            .collect()
    }

    #[test]
    fn a_spread_sample_keeps_to_its_count_and_to_the_surface() {
        let sample = spread(&plane(), 200);
        assert!((100..=200).contains(&sample.len()), "{}", sample.len());
        assert!(sample.iter().all(|p| (p.z - 3.0).abs() < 1e-12));
    }

    #[test]
    fn a_column_of_an_organised_cloud_is_not_taken_for_the_cloud() {
        // 64 columns, row by row: every 64th point would be of one column.
        let grid: Vec<Point3> = (0..64 * 1000)
            .map(|i| Point3::new(f64::from(i % 64), f64::from(i / 64) * 0.064, 0.0))
            .collect();
        let (low, high) = arthro_geometry::cloud::bounds(&spread(&grid, 62)).unwrap();
        assert!(
            (high - low).x > 45.0 && (high - low).y > 45.0,
            "{low} {high}"
        );
    }

    #[test]
    fn fitted_normals_of_a_plane_are_perpendicular_to_it() {
        let points = plane();
        assert!((spacing_mm(&points) - 0.5).abs() < 0.07);
        for normal in fitted_normals(&points, &Cells::new(&points, 1.0), 1.0) {
            assert!((normal.z.abs() - 1.0).abs() < 1e-9);
        }
    }
}
