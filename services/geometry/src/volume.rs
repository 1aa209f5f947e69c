//! Solid voxels of a closed surface.
//!
//! A voxel is inside when its centre is: rays along the three axes of the grid count how often they
//! cross the surface, and the majority of the three decides. A ray that crosses an odd number of
//! times went through a hole and has no say, so that a surface with a few missing triangles still
//! becomes the solid that everybody sees; one with many is refused.

use crate::{Mesh, Point3, Vector3};

/// Most voxels a grid may have.
pub const MAX_VOXELS: usize = 50_000_000;
/// Largest share of rays that may find the surface open, percent.
pub const MAX_OPEN_PERCENT: f64 = 2.0;

/// Cubes in rows along the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Centre of voxel (0, 0, 0), mm.
    pub origin: Point3,
    /// Edge of a voxel, mm.
    pub voxel_mm: f64,
    /// How many voxels along x, y and z.
    pub size: [usize; 3],
}

/// The voxels whose centres are inside a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Where the voxels are.
    pub grid: Grid,
    inside: Vec<bool>,
}

/// Why a surface has no solid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// No triangle.
    #[error("the mesh has no triangle")]
    Empty,
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle} names vertex {vertex} of {vertices}")]
    NoSuchVertex {
        /// Which triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite")]
    NotFinite {
        /// Which vertex.
        vertex: usize,
    },
    /// The edge of a voxel is not a positive length.
    #[error("voxel edge is {voxel_mm} mm and must be greater than 0")]
    Voxel {
        /// The edge asked for, mm.
        voxel_mm: f64,
    },
    /// The grid would not fit into memory.
    #[error("{voxels} voxels of {voxel_mm} mm are needed, the limit is {MAX_VOXELS}")]
    TooManyVoxels {
        /// How many would be needed.
        voxels: f64,
        /// Their edge, mm.
        voxel_mm: f64,
    },
    /// Too many holes to tell inside from outside.
    #[error(
        "the surface is open: {open_percent:.1} % of the rays leave it more or less often than they enter, the limit is {MAX_OPEN_PERCENT} %"
    )]
    Open {
        /// Share of the rays, percent.
        open_percent: f64,
    },
}

impl Grid {
    /// The grid that covers the box from `low` to `high`, with a margin of one voxel.
    pub fn covering(low: &Point3, high: &Point3, voxel_mm: f64) -> Result<Self, Error> {
        if !(voxel_mm > 0.0 && voxel_mm.is_finite()) {
            return Err(Error::Voxel { voxel_mm });
        }
        let counts = ((high - low) / voxel_mm).map(|cells| cells.ceil() + 2.0);
        let voxels = counts.product();
        if !voxels.is_finite() || voxels > MAX_VOXELS as f64 {
            return Err(Error::TooManyVoxels { voxels, voxel_mm });
        }
        Ok(Self {
            origin: low - Vector3::repeat(0.5 * voxel_mm),
            voxel_mm,
            size: [0, 1, 2].map(|axis| counts[axis] as usize),
        })
    }

    /// How many voxels.
    pub fn len(&self) -> usize {
        self.size.iter().product()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of a voxel in a list that runs along x first.
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.size[0] * (j + self.size[1] * k)
    }

    /// The voxel at a position of that list.
    pub fn cell(&self, index: usize) -> [usize; 3] {
        let row = index / self.size[0];
        [index % self.size[0], row % self.size[1], row / self.size[1]]
    }

    /// Centre of a voxel, mm.
    pub fn center(&self, cell: [usize; 3]) -> Point3 {
        self.origin + Vector3::from(cell.map(|count| count as f64)) * self.voxel_mm
    }

    /// The voxel that holds `point`; `None` outside the grid.
    pub fn cell_at(&self, point: &Point3) -> Option<[usize; 3]> {
        let position = (point - self.origin) / self.voxel_mm;
        let mut cell = [0; 3];
        for axis in 0..3 {
            let nearest = position[axis].round();
            if !(nearest >= 0.0 && nearest < self.size[axis] as f64) {
                return None;
            }
            cell[axis] = nearest as usize;
        }
        Some(cell)
    }
}

impl Solid {
    /// The voxels inside `mesh`, on a grid that covers it.
    pub fn of(mesh: &Mesh, voxel_mm: f64) -> Result<Self, Error> {
        check(mesh)?;
        let (low, high) = mesh.bounds().ok_or(Error::Empty)?;
        Self::on(Grid::covering(&low, &high, voxel_mm)?, mesh)
    }

    /// The voxels inside `mesh`, on a given grid.
    pub fn on(grid: Grid, mesh: &Mesh) -> Result<Self, Error> {
        check(mesh)?;
        let mut votes = vec![0i8; grid.len()];
        let (mut rays, mut open) = (0usize, 0usize);
        for axis in 0..3 {
            let crossings = crossings_along(axis, &grid, mesh);
            for (ray, heights) in crossings.iter().enumerate() {
                rays += usize::from(!heights.is_empty());
                if heights.len() % 2 == 1 {
                    open += 1;
                    continue;
                }
                vote(axis, ray, heights, &grid, &mut votes);
            }
        }
        let open_percent = 100.0 * open as f64 / rays.max(1) as f64;
        if open_percent > MAX_OPEN_PERCENT {
            return Err(Error::Open { open_percent });
        }
        let inside = votes.into_iter().map(|sum| sum > 0).collect();
        Ok(Self { grid, inside })
    }

    /// Whether a voxel is inside.
    pub fn is_inside(&self, cell: [usize; 3]) -> bool {
        self.inside[self.grid.index(cell)]
    }

    /// Whether the voxel that holds `point` is inside.
    pub fn contains(&self, point: &Point3) -> bool {
        self.grid
            .cell_at(point)
            .is_some_and(|cell| self.is_inside(cell))
    }

    /// The voxels inside.
    pub fn cells(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let inside = self
            .inside
            .iter()
            .enumerate()
            .filter(|(_, inside)| **inside);
        inside.map(|(index, _)| self.grid.cell(index))
    }

    /// Volume of all voxels inside, mm3.
    pub fn volume_mm3(&self) -> f64 {
        let count = self.inside.iter().filter(|inside| **inside).count();
        count as f64 * self.grid.voxel_mm.powi(3)
    }
}

/// Refuses a mesh that has no triangle, a vertex that is not finite or a triangle without its vertices.
pub fn check(mesh: &Mesh) -> Result<(), Error> {
    if mesh.triangles.is_empty() {
        return Err(Error::Empty);
    }
    let finite = |vertex: &Point3| vertex.iter().all(|value| value.is_finite());
    if let Some(vertex) = mesh.vertices.iter().position(|vertex| !finite(vertex)) {
        return Err(Error::NotFinite { vertex });
    }
    let vertices = mesh.vertices.len();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&corner| corner as usize >= vertices) {
            return Err(Error::NoSuchVertex {
                triangle,
                vertex,
                vertices,
            });
        }
    }
    Ok(())
}

/// The two axes across `axis`.
fn across(axis: usize) -> (usize, usize) {
    ((axis + 1) % 3, (axis + 2) % 3)
}

/// For each ray along `axis` through the centres of a row of voxels: where it crosses the surface, in
/// ascending order, mm.
fn crossings_along(axis: usize, grid: &Grid, mesh: &Mesh) -> Vec<Vec<f64>> {
    let (u, v) = across(axis);
    let mut crossings = vec![Vec::new(); grid.size[u] * grid.size[v]];
    let rows = |low: f64, high: f64, side: usize| {
        let first = ((low - grid.origin[side]) / grid.voxel_mm).ceil().max(0.0) as usize;
        let last = ((high - grid.origin[side]) / grid.voxel_mm).floor();
        let end = (last + 1.0).clamp(0.0, grid.size[side] as f64) as usize;
        first..end
    };
    for index in 0..mesh.triangles.len() {
        let corners = mesh.corners(index);
        let [a, b, c] = corners;
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        let normal = (b - a).cross(&(c - a));
        for j in rows(low[v], high[v], v) {
            for i in rows(low[u], high[u], u) {
                let at_u = grid.origin[u] + i as f64 * grid.voxel_mm;
                let at_v = grid.origin[v] + j as f64 * grid.voxel_mm;
                if !covers(&corners, (u, v), (at_u, at_v)) {
                    continue;
                }
                // A covered ray is never parallel to the triangle's plane, but may come close.
                let rise = (normal[u] * (at_u - a[u]) + normal[v] * (at_v - a[v])) / normal[axis];
                let height = (a[axis] - rise).clamp(low[axis], high[axis]);
                crossings[i + grid.size[u] * j].push(height);
            }
        }
    }
    for heights in &mut crossings {
        heights.sort_by(f64::total_cmp);
    }
    crossings
}

/// Whether the projection of a triangle covers a point. Every edge is computed from its lower corner
/// on, so that two triangles that share it agree to the last bit and a ray through an edge crosses
/// exactly one of them.
fn covers(corners: &[Point3; 3], (u, v): (usize, usize), (at_u, at_v): (f64, f64)) -> bool {
    let mut inside = false;
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let (mut a, mut b) = (&corners[from], &corners[to]);
        if (b[v], b[u]) < (a[v], a[u]) {
            (a, b) = (b, a);
        }
        if (a[v] > at_v) != (b[v] > at_v)
            && at_u < a[u] + (b[u] - a[u]) * ((at_v - a[v]) / (b[v] - a[v]))
        {
            inside = !inside;
        }
    }
    inside
}

/// Adds what one ray says: in for the voxels between its first and second crossing and so on, out for
/// the others.
fn vote(axis: usize, ray: usize, heights: &[f64], grid: &Grid, votes: &mut [i8]) {
    let (u, v) = across(axis);
    let mut cell = [0; 3];
    cell[u] = ray % grid.size[u];
    cell[v] = ray / grid.size[u];
    let mut passed = 0;
    for step in 0..grid.size[axis] {
        let height = grid.origin[axis] + step as f64 * grid.voxel_mm;
        while heights
            .get(passed)
            .is_some_and(|&crossing| crossing <= height)
        {
            passed += 1;
        }
        cell[axis] = step;
        votes[grid.index(cell)] += if passed % 2 == 1 { 1 } else { -1 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Rotation, phantom};

    fn turned(mut mesh: Mesh) -> Mesh {
        let rotation = Rotation::from_scaled_axis(Vector3::new(0.4, -1.1, 0.7));
        for vertex in &mut mesh.vertices {
            *vertex = rotation * *vertex;
        }
        mesh
    }

    #[test]
    fn the_solid_has_the_volume_of_the_surface() {
        for mesh in [phantom::mesh(), turned(phantom::mesh())] {
            let solid = Solid::of(&mesh, 0.25).unwrap();
            let off = solid.volume_mm3() / mesh.volume_mm3() - 1.0;
            assert!(off.abs() < 0.01, "{off}");
        }
    }

    #[test]
    fn every_voxel_agrees_with_the_phantoms_formula() {
        let shape = phantom::Phantom::default();
        let solid = Solid::of(&phantom::mesh(), 0.5).unwrap();
        let wrong = (0..solid.grid.len())
            .map(|index| solid.grid.cell(index))
            .filter(|&cell| solid.is_inside(cell) != shape.contains(&solid.grid.center(cell)))
            .count();
        // Only centres within the chord error of the facets may differ.
        assert!(wrong * 200 < solid.cells().count(), "{wrong} voxels");
    }

    #[test]
    fn a_few_missing_triangles_change_next_to_nothing() {
        let mut mesh = turned(phantom::mesh());
        let whole = Solid::of(&mesh, 0.5).unwrap();
        for triangle in [900, 2500, 4100, 5000] {
            mesh.triangles.swap_remove(triangle);
        }
        let holed = Solid::on(whole.grid.clone(), &mesh).unwrap();
        let differ = whole
            .inside
            .iter()
            .zip(&holed.inside)
            .filter(|(a, b)| a != b);
        assert!(differ.count() <= 2);
    }

    #[test]
    fn a_sheet_is_refused_as_open() {
        let mut mesh = phantom::mesh();
        mesh.triangles.truncate(4000);
        assert!(matches!(Solid::of(&mesh, 0.5), Err(Error::Open { .. })));
    }

    #[test]
    fn what_cannot_be_a_grid_is_refused() {
        let mut mesh = phantom::mesh();
        assert_eq!(Solid::of(&Mesh::default(), 0.5), Err(Error::Empty));
        assert!(matches!(Solid::of(&mesh, 0.0), Err(Error::Voxel { .. })));
        assert!(matches!(
            Solid::of(&mesh, 0.001),
            Err(Error::TooManyVoxels { .. })
        ));
        mesh.vertices[7].y = f64::NAN;
        assert_eq!(Solid::of(&mesh, 0.5), Err(Error::NotFinite { vertex: 7 }));
        mesh.vertices[7].y = 0.0;
        mesh.triangles[3][1] = 1_000_000;
        assert!(matches!(
            Solid::of(&mesh, 0.5),
            Err(Error::NoSuchVertex { triangle: 3, .. })
        ));
    }
}
