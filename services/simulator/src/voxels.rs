//! A closed surface turned into cells of equal size, so that tissue can be counted and taken away.

use arthro_geometry::{Mesh, Point3, Vector3};

/// Cells on a regular grid aligned to the axes of the mesh's frame.
#[derive(Clone, Debug)]
pub struct Voxels {
    lowest: Point3,
    edge_mm: f64,
    counts: [usize; 3],
    solid: Vec<bool>,
}

impl Voxels {
    /// The cells whose centres lie inside `mesh`, judged by the parity of surface crossings along
    /// each of the three axes and a majority vote, so that a small hole in the surface spoils one
    /// vote and not the tissue.
    pub fn from_mesh(mesh: &Mesh, edge_mm: f64) -> Self {
        let Some((low, high)) = mesh.bounds() else {
            return Self {
                lowest: Point3::origin(),
                edge_mm,
                counts: [0; 3],
                solid: Vec::new(),
            };
        };
        let lowest = low - Vector3::repeat(edge_mm);
        let size = high - low + Vector3::repeat(2.0 * edge_mm);
        let counts = [0, 1, 2].map(|axis| (size[axis] / edge_mm).ceil() as usize);
        let mut voxels = Self {
            lowest,
            edge_mm,
            counts,
            solid: Vec::new(),
        };
        let mut votes = vec![0_u8; counts.iter().product()];
        for axis in 0..3 {
            voxels.vote_along(mesh, axis, &mut votes);
        }
        voxels.solid = votes.into_iter().map(|votes| votes >= 2).collect();
        voxels
    }

    /// Edge of a cell, mm.
    pub fn edge_mm(&self) -> f64 {
        self.edge_mm
    }

    /// Volume of one cell, mm3.
    pub fn cell_mm3(&self) -> f64 {
        self.edge_mm.powi(3)
    }

    /// How many cells the grid has, solid or not.
    pub fn len(&self) -> usize {
        self.solid.len()
    }

    /// Whether the grid has no cell at all.
    pub fn is_empty(&self) -> bool {
        self.solid.is_empty()
    }

    /// Whether the cell of this index is inside the surface.
    pub fn solid(&self, index: usize) -> bool {
        self.solid[index]
    }

    /// Indices of the solid cells.
    pub fn solid_cells(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.solid.len()).filter(|&index| self.solid[index])
    }

    /// Middle of the cell.
    pub fn center(&self, index: usize) -> Point3 {
        let [nx, ny, _] = self.counts;
        self.center_at([index % nx, index / nx % ny, index / (nx * ny)])
    }

    /// Indices of all cells whose centres lie in the axis-aligned box.
    pub fn cells_in(&self, low: Point3, high: Point3) -> impl Iterator<Item = usize> + use<'_> {
        let range = [0, 1, 2].map(|axis| {
            let first = (low[axis] - self.lowest[axis]) / self.edge_mm - 0.5;
            let last = (high[axis] - self.lowest[axis]) / self.edge_mm - 0.5;
            let first = first.ceil().clamp(0.0, self.counts[axis] as f64) as usize;
            let end = (last.floor() + 1.0).clamp(0.0, self.counts[axis] as f64) as usize;
            first..end.max(first)
        });
        let [xs, ys, zs] = range;
        zs.flat_map(move |z| {
            let xs = xs.clone();
            ys.clone()
                .flat_map(move |y| xs.clone().map(move |x| self.index([x, y, z])))
        })
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.counts[1] + y) * self.counts[0] + x
    }

    fn center_at(&self, cell: [usize; 3]) -> Point3 {
        let offset = cell.map(|count| (count as f64 + 0.5) * self.edge_mm);
        self.lowest + Vector3::from(offset)
    }

    /// Adds a vote for each cell that has an odd number of crossings below it along `axis`.
    fn vote_along(&self, mesh: &Mesh, axis: usize, votes: &mut [u8]) {
        // Off the cell centres by an odd fraction, so that no line runs through a vertex or an edge of
        // a surface that was itself made on a grid.
        const OFF_GRID: [f64; 2] = [1.234_567e-4, 2.345_678e-4];
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut crossings = vec![Vec::new(); self.counts[u] * self.counts[v]];
        for triangle in 0..mesh.triangles.len() {
            let corners = mesh.corners(triangle);
            let flat = corners.map(|corner| [corner[u], corner[v]]);
            let [first_u, end_u] = self.columns(u, flat.map(|corner| corner[0]));
            let [first_v, end_v] = self.columns(v, flat.map(|corner| corner[1]));
            for column_v in first_v..end_v {
                for column_u in first_u..end_u {
                    let at = [
                        self.lowest[u] + (column_u as f64 + 0.5 + OFF_GRID[0]) * self.edge_mm,
                        self.lowest[v] + (column_v as f64 + 0.5 + OFF_GRID[1]) * self.edge_mm,
                    ];
                    if let Some(weights) = barycentric(&flat, at) {
                        let height = (0..3).map(|i| weights[i] * corners[i][axis]).sum::<f64>();
                        crossings[column_v * self.counts[u] + column_u].push(height);
                    }
                }
            }
        }
        for column_v in 0..self.counts[v] {
            for column_u in 0..self.counts[u] {
                let heights = &mut crossings[column_v * self.counts[u] + column_u];
                heights.sort_by(f64::total_cmp);
                for pair in heights.chunks_exact(2) {
                    let from = ((pair[0] - self.lowest[axis]) / self.edge_mm - 0.5)
                        .ceil()
                        .max(0.0);
                    let to = (pair[1] - self.lowest[axis]) / self.edge_mm - 0.5;
                    let mut along = from as usize;
                    while along < self.counts[axis] && along as f64 <= to {
                        let mut cell = [0; 3];
                        cell[axis] = along;
                        cell[u] = column_u;
                        cell[v] = column_v;
                        votes[self.index(cell)] += 1;
                        along += 1;
                    }
                }
            }
        }
    }

    /// First and one past the last column along `axis` that `values` can touch.
    fn columns(&self, axis: usize, values: [f64; 3]) -> [usize; 2] {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let column = |value: f64| ((value - self.lowest[axis]) / self.edge_mm).max(0.0) as usize;
        [
            column(low).saturating_sub(1),
            (column(high) + 1).min(self.counts[axis]),
        ]
    }
}

/// Barycentric weights of `at` in a flat triangle; `None` outside it.
fn barycentric([a, b, c]: &[[f64; 2]; 3], at: [f64; 2]) -> Option<[f64; 3]> {
    let area = |p: &[f64; 2], q: &[f64; 2], r: &[f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    let whole = area(a, b, c);
    if whole == 0.0 {
        return None;
    }
    let weights = [area(b, c, &at), area(c, a, &at), area(a, b, &at)].map(|part| part / whole);
    weights
        .iter()
        .all(|weight| *weight >= 0.0)
        .then_some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(edge_mm: f64) -> Mesh {
        let vertices = (0..8)
            .map(|i| Point3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64) * edge_mm)
            .collect();
        let triangles = vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        Mesh {
            vertices,
            triangles,
        }
    }

    #[test]
    fn a_cube_fills_its_volume() {
        let voxels = Voxels::from_mesh(&cube(6.0), 0.3);
        let volume = voxels.solid_cells().count() as f64 * voxels.cell_mm3();
        assert!((volume - 216.0).abs() < 0.05 * 216.0, "{volume}");
    }

    #[test]
    fn a_hole_in_the_surface_costs_no_tissue() {
        let mut mesh = cube(6.0);
        mesh.triangles.pop();
        let voxels = Voxels::from_mesh(&mesh, 0.3);
        let volume = voxels.solid_cells().count() as f64 * voxels.cell_mm3();
        assert!((volume - 216.0).abs() < 0.05 * 216.0, "{volume}");
    }

    #[test]
    fn a_box_names_the_cells_whose_centres_it_holds() {
        let voxels = Voxels::from_mesh(&cube(6.0), 0.5);
        let (low, high) = (Point3::new(1.0, 1.0, 1.0), Point3::new(3.0, 2.0, 2.0));
        let cells: Vec<_> = voxels.cells_in(low, high).collect();
        assert_eq!(cells.len(), 4 * 2 * 2);
        for cell in cells {
            let center = voxels.center(cell);
            assert!((0..3).all(|i| (low[i]..=high[i]).contains(&center[i])));
        }
    }
}
