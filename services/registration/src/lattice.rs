//! The nearest sample of a surface looked up instead of searched: one index a cell of a grid around it.
//!
//! What stands in a cell is nearest to the cell's middle, or nearly so; the answer may be a sample beside the nearest
//! one. Samples carry planes, so a neighbour's plane tells nearly the same height, many times faster than a tree.

use arthro_geometry::Point3;
use arthro_geometry::cloud::bounds;

/// An index that stands for no sample yet.
const NONE: u32 = u32::MAX;

/// Index of the nearest sample for every cell of a grid.
#[derive(Clone, Debug)]
pub struct Lattice {
    low: [f32; 3],
    cells_per_mm: f32,
    size: [usize; 3],
    nearest: Vec<u32>,
}

impl Lattice {
    /// Fills the grid of `edge_mm` cells that reaches `margin_mm` beyond `points`. Not for no points.
    pub fn new(points: &[Point3], edge_mm: f64, margin_mm: f64) -> Self {
        let origin = (Point3::origin(), Point3::origin());
        let (low, high) = bounds(points).unwrap_or(origin);
        let low = low.map(|c| c - margin_mm);
        let size: [usize; 3] = (high - low)
            .map(|c| ((c + margin_mm) / edge_mm) as usize + 1)
            .into();
        let mut lattice = Self {
            low: low.cast::<f32>().coords.into(),
            cells_per_mm: (1.0 / edge_mm) as f32,
            size,
            nearest: vec![NONE; size.iter().product()],
        };
        let points: Vec<[f32; 3]> = points
            .iter()
            .map(|p| p.cast::<f32>().coords.into())
            .collect();
        lattice.sow(&points);
        // Two rounds settle all but the rarest cells; what is left is off by a sample.
        for _ in 0..2 {
            lattice.sweep(&points);
        }
        lattice
    }

    /// Index of a sample that is nearest to `query`, or nearly so; beyond the grid, of its outermost cell.
    #[inline]
    pub fn nearest(&self, query: [f32; 3]) -> usize {
        // A cast saturates: what lies below the grid is in its first cell.
        let along = |axis: usize| {
            let cell = ((query[axis] - self.low[axis]) * self.cells_per_mm) as usize;
            cell.min(self.size[axis] - 1)
        };
        let cell = (along(2) * self.size[1] + along(1)) * self.size[0] + along(0);
        self.nearest[cell] as usize
    }

    /// Whether `query` lies in the grid.
    #[inline]
    pub fn holds(&self, query: [f32; 3]) -> bool {
        (0..3).all(|axis| {
            let steps = (query[axis] - self.low[axis]) * self.cells_per_mm;
            steps >= 0.0 && steps < self.size[axis] as f32
        })
    }

    /// Each sample takes its own cell, the one nearest to the middle wins.
    fn sow(&mut self, points: &[[f32; 3]]) {
        for (index, point) in points.iter().enumerate() {
            let cell = [0, 1, 2].map(|axis| {
                let steps = ((point[axis] - self.low[axis]) * self.cells_per_mm) as usize;
                steps.min(self.size[axis] - 1)
            });
            self.offer(points, cell, index as u32);
        }
    }

    fn offer(&mut self, points: &[[f32; 3]], cell: [usize; 3], candidate: u32) {
        let middle = self.middle(cell);
        let place = self.place(cell);
        let holds = self.nearest[place];
        if holds == NONE
            || squared(&points[candidate as usize], &middle)
                < squared(&points[holds as usize], &middle)
        {
            self.nearest[place] = candidate;
        }
    }

    /// Carries samples from cell to cell, once forth and once back along every axis.
    fn sweep(&mut self, points: &[[f32; 3]]) {
        let [columns, rows, slices] = self.size;
        let strides = [1, columns, columns * rows];
        for backward in [false, true] {
            for step in 0..columns * rows * slices {
                let place = if backward {
                    columns * rows * slices - 1 - step
                } else {
                    step
                };
                let cell = [
                    place % columns,
                    place / columns % rows,
                    place / (columns * rows),
                ];
                let middle = self.middle(cell);
                let mut best = self.nearest[place];
                let mut best2 = if best == NONE {
                    f32::INFINITY
                } else {
                    squared(&points[best as usize], &middle)
                };
                for axis in 0..3 {
                    let neighbour = if backward {
                        (cell[axis] + 1 < self.size[axis]).then(|| place + strides[axis])
                    } else {
                        (cell[axis] > 0).then(|| place - strides[axis])
                    };
                    let Some(candidate) = neighbour.map(|at| self.nearest[at]) else {
                        continue;
                    };
                    if candidate != NONE && candidate != best {
                        let distance2 = squared(&points[candidate as usize], &middle);
                        if distance2 < best2 {
                            (best, best2) = (candidate, distance2);
                        }
                    }
                }
                self.nearest[place] = best;
            }
        }
    }

    fn middle(&self, cell: [usize; 3]) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.low[axis] + (cell[axis] as f32 + 0.5) / self.cells_per_mm)
    }

    fn place(&self, [column, row, slice]: [usize; 3]) -> usize {
        (slice * self.size[1] + row) * self.size[0] + column
    }
}

fn squared(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
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
        let lattice = Lattice::new(&points, 0.8, 6.0);
        let distance = |p: &Point3, q: &Point3| (p - q).norm();
        for i in 0..2000 {
            let t = f64::from(i);
            let query = Point3::new(
                15.0 + 18.0 * t.sin(),
                15.0 + 18.0 * (1.7 * t).cos(),
                5.0 * (0.3 * t).sin(),
            );
            let exact = points
                .iter()
                .map(|p| distance(p, &query))
                .fold(f64::INFINITY, f64::min);
            let looked_up = &points[lattice.nearest(query.cast::<f32>().coords.into())];
            let looked_up = distance(looked_up, &query);
            assert!(
                looked_up <= exact + 3f64.sqrt() * 0.8 + 0.1,
                "{looked_up} {exact}"
            );
        }
        assert!(lattice.nearest([-1e9, 1e9, f32::MAX]) < points.len());
    }
}
