//! Symmetric positive definite systems whose entries lie within a few rows of the diagonal, as the
//! normal equations of a spline do: Cholesky in linear time and memory.

use arthro_geometry::Vector3;

/// The lower half of a symmetric banded matrix.
pub(crate) struct Banded {
    size: usize,
    width: usize,
    /// Row by row, `width + 1` entries each, the diagonal last.
    entries: Vec<f64>,
}

impl Banded {
    /// All zero; entries may be `width` rows away from the diagonal.
    pub(crate) fn zeros(size: usize, width: usize) -> Self {
        Self {
            size,
            width,
            entries: vec![0.0; size * (width + 1)],
        }
    }

    fn slot(&self, row: usize, column: usize) -> usize {
        row * (self.width + 1) + self.width + column - row
    }

    /// Adds to an entry of the lower half: `row - width <= column <= row`.
    pub(crate) fn add(&mut self, row: usize, column: usize, value: f64) {
        let slot = self.slot(row, column);
        self.entries[slot] += value;
    }

    /// Solves for three right-hand sides at once; `None` if the matrix is not positive definite.
    pub(crate) fn solve(mut self, mut right: Vec<Vector3>) -> Option<Vec<Vector3>> {
        for row in 0..self.size {
            let first = row.saturating_sub(self.width);
            for column in first..=row {
                let shared = first.max(column.saturating_sub(self.width));
                let mut value = self.entries[self.slot(row, column)];
                for before in shared..column {
                    value -= self.entries[self.slot(row, before)]
                        * self.entries[self.slot(column, before)];
                }
                let slot = self.slot(row, column);
                self.entries[slot] = if column < row {
                    value / self.entries[self.slot(column, column)]
                } else if value > 1e-14 {
                    value.sqrt()
                } else {
                    return None;
                };
            }
        }
        for row in 0..self.size {
            for column in row.saturating_sub(self.width)..row {
                let known = right[column];
                right[row] -= known * self.entries[self.slot(row, column)];
            }
            right[row] /= self.entries[self.slot(row, row)];
        }
        for row in (0..self.size).rev() {
            for below in row + 1..(row + self.width + 1).min(self.size) {
                let known = right[below];
                right[row] -= known * self.entries[self.slot(below, row)];
            }
            right[row] /= self.entries[self.slot(row, row)];
        }
        Some(right)
    }
}
