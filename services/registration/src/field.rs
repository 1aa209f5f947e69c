//! The nearest sample of a surface looked up instead of searched: one index a cell of a grid around it.
//!
//! What stands in a cell is nearest to the cell's middle, so the answer may be a sample or two off; good enough to
//! judge and improve many rough poses, and many times faster than the tree that finishes the few good ones.

use arthro_geometry::Point3;
use rayon::prelude::*;

use crate::neighbours::Neighbours;

/// Cells along the diagonal of the samples' bounding box.
const CELLS_ALONG_DIAGONAL: f64 = 50.0;
/// The grid reaches this share of the diagonal beyond the box; farther queries take the outermost cell.
const MARGIN: f64 = 0.1;

/// Index of the nearest sample for every cell of a grid.
#[derive(Clone, Debug)]
pub struct Field {
    low: Point3,
    cells_per_mm: f64,
    size: [usize; 3],
    nearest: Vec<u32>,
}

impl Field {
    /// Fills the grid around `points`, which `tree` was built from. Not for an empty tree.
    pub fn new(points: &[Point3], tree: &Neighbours) -> Self {
        let origin = (Point3::origin(), Point3::origin());
        let (low, high) = arthro_geometry::cloud::bounds(points).unwrap_or(origin);
        let diagonal = (high - low).norm().max(f64::MIN_POSITIVE);
        let cell = diagonal / CELLS_ALONG_DIAGONAL;
        let low = low.map(|c| c - MARGIN * diagonal);
        let size: [usize; 3] = (high - low)
            .map(|c| ((c + MARGIN * diagonal) / cell) as usize + 1)
            .into();
        let [columns, rows, slices] = size;
        let nearest = (0..slices * rows)
            .into_par_iter()
            .flat_map_iter(|line| {
                let (slice, row) = (line / rows, line % rows);
                (0..columns).map(move |column| {
                    let steps = [column, row, slice].map(|c| (c as f64 + 0.5) * cell);
                    let middle = low + arthro_geometry::Vector3::from(steps);
                    tree.nearest(&middle).map_or(0, |found| found.index as u32)
                })
            })
            .collect();
        Self {
            low,
            cells_per_mm: 1.0 / cell,
            size,
            nearest,
        }
    }

    /// Index of a sample that is nearest to `query`, or nearly so.
    pub fn nearest(&self, query: &Point3) -> usize {
        // A cast saturates: what lies below the grid is in its first cell.
        let along = |axis: usize| {
            let cell = ((query[axis] - self.low[axis]) * self.cells_per_mm) as usize;
            cell.min(self.size[axis] - 1)
        };
        let cell = (along(2) * self.size[1] + along(1)) * self.size[0] + along(0);
        self.nearest[cell] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_looked_up_sample_is_no_farther_than_the_nearest_one_and_a_cell() {
        let points: Vec<Point3> = (0..900)
            .map(|i| (f64::from(i % 30), f64::from(i / 30)))
            .map(|(x, y)| Point3::new(x, y, 4.0 * (0.3 * x).sin()))
            .collect();
        let tree = Neighbours::new(&points);
        let field = Field::new(&points, &tree);
        let cell_mm = 1.0 / field.cells_per_mm;
        for i in 0..500 {
            let t = f64::from(i);
            let query = Point3::new(
                15.0 + 18.0 * t.sin(),
                15.0 + 18.0 * (1.7 * t).cos(),
                5.0 * (0.3 * t).sin(),
            );
            let exact = tree.nearest(&query).unwrap().distance2.sqrt();
            let looked_up = (points[field.nearest(&query)] - query).norm();
            assert!(
                looked_up <= exact + 3f64.sqrt() * cell_mm,
                "{looked_up} {exact}"
            );
        }
        let far = Point3::new(-1e9, 1e9, f64::from(f32::MAX));
        assert!(field.nearest(&far) < points.len());
    }
}
