//! Evenly spread samples of a cloud: one averaged point a voxel, and normals fitted to neighbourhoods.

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Point3, Vector3};
use rayon::prelude::*;

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
    let dense: Vec<Point3> = points.iter().step_by(stride).copied().collect();
    let mut sample = dense.clone();
    // A surface fills about the square of its box's diagonal; begin well below the spacing that follows.
    let mut edge_mm = 0.3 * (high - low).norm() / (count as f64).sqrt();
    while sample.len() > count {
        sample = voxel_average(&dense, edge_mm);
        edge_mm *= 1.2;
    }
    sample
}

/// Unit normals of the planes that best fit the `count` nearest neighbours of each point; signs are arbitrary.
pub fn fitted_normals(points: &[Point3], tree: &Neighbours, count: usize) -> Vec<Vector3> {
    points
        .par_iter()
        .map(|point| {
            let near = tree.nearest_many(point, count);
            let mean: Vector3 =
                near.iter().map(|n| points[n.index].coords).sum::<Vector3>() / near.len() as f64;
            let covariance: Matrix3<f64> = near
                .iter()
                .map(|n| points[n.index].coords - mean)
                .map(|d| d * d.transpose())
                .sum();
            let eigen = SymmetricEigen::new(covariance);
            eigen.eigenvectors.column(eigen.eigenvalues.imin()).into()
        })
        .collect()
}

/// Median distance from a point to its nearest other point, mm: the spacing of the sample.
pub fn spacing_mm(points: &[Point3], tree: &Neighbours) -> f64 {
    let mut distances: Vec<f64> = points
        .iter()
        .step_by(points.len() / 500 + 1)
        .filter_map(|point| Some(tree.nearest_many(point, 2).get(1)?.distance2))
        .collect();
    median(&mut distances).sqrt()
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
    fn fitted_normals_of_a_plane_are_perpendicular_to_it() {
        let points = plane();
        let tree = Neighbours::new(&points);
        assert!((spacing_mm(&points, &tree) - 0.5).abs() < 1e-12);
        for normal in fitted_normals(&points, &tree, 12) {
            assert!((normal.z.abs() - 1.0).abs() < 1e-9);
        }
    }
}
