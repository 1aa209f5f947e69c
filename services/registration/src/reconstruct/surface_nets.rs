//! Surface nets (Gibson 1998): a vertex in every cell of eight voxels that has some inside and some outside, at the mean
//! of the places where the surface crosses the cell's edges, and a quad across every such edge.
//!
//! A cell through which the surface passes more than once has a vertex for each of its `patches`, so that the net is
//! closed and manifold whatever the voxels are. Cells are visited layer by layer: memory goes with the surface, not
//! with the volume.

use arthro_geometry::scan::{Lattice, Scan, Value, Visit};
use arthro_geometry::{Mesh, Point3, Vector3};

use super::Inside;
use super::body::{AtLeast, Body, Is, Rule};
use crate::budget::Budget;
use crate::error::{Error, Violation};

mod layers;
mod patches;

use layers::Layers;
use patches::{EDGES, Patches, edge_along};

/// Most quads of a net: its triangles and vertices fit into a file of [`arthro_geometry::ply`].
pub const MAX_QUADS: usize = 1_800_000;

/// A closed net of quads in fractional voxel indices.
#[derive(Clone, Debug, Default)]
pub(super) struct Net {
    /// Positions of the vertices.
    pub(super) positions: Vec<[f32; 3]>,
    /// Middle of the cell that each vertex lies in; the cell reaches half a voxel to every side.
    pub(super) middles: Vec<[f32; 3]>,
    /// Corners, counter-clockwise from outside in a right-handed lattice.
    pub(super) quads: Vec<[u32; 4]>,
}

/// Lays the net around what is inside; `None` if nothing is.
pub(super) fn net(
    scan: &Scan,
    inside: Inside,
    budget: &Budget,
) -> Result<Option<(Net, Body)>, Error> {
    scan.voxels().visit(Build {
        scan,
        inside,
        budget,
    })
}

struct Build<'a> {
    scan: &'a Scan,
    inside: Inside,
    budget: &'a Budget,
}

impl Visit for Build<'_> {
    type Output = Result<Option<(Net, Body)>, Error>;

    fn visit<T: Value>(self, values: &[T]) -> Self::Output {
        match self.inside {
            Inside::Label(label) => match T::exactly(label as f64) {
                Some(value) => self.build(values, Is(value)),
                None => Ok(None),
            },
            Inside::Threshold(threshold) => self.build(values, AtLeast(threshold)),
        }
    }
}

impl Build<'_> {
    fn build<T: Value>(
        self,
        values: &[T],
        rule: impl Rule<T>,
    ) -> Result<Option<(Net, Body)>, Error> {
        let size = self.scan.lattice().size();
        let Some(body) = Body::find(values, size, rule) else {
            return Ok(None);
        };
        let patches = Patches::new();
        let mut layers = Layers::new(values, size, &body, rule, &patches);
        let mut net = Net::default();
        while layers.advance() {
            self.budget.check()?;
            add_vertices(&mut layers, &mut net);
            add_quads(&layers, &mut net);
            if net.quads.len() > MAX_QUADS {
                return Err(Error::Invalid(vec![too_large(self.inside)]));
            }
        }
        Ok(Some((net, body)))
    }
}

fn add_vertices<T: Value, R: Rule<T>>(layers: &mut Layers<'_, T, R>, net: &mut Net) {
    for place in 0..layers.active().len() {
        let cell = layers.active()[place];
        layers.set_first_vertex(cell, net.positions.len() as u32);
        let patches = layers.patches_of(cell);
        let mut sums = [[0.0; 3]; 4];
        let mut counts = [0.0; 4];
        for edge in 0..EDGES {
            if let Some(patch) = patches.of_edge(edge) {
                let crossing = layers.crossing(cell, edge);
                for axis in 0..3 {
                    sums[patch][axis] += crossing[axis];
                }
                counts[patch] += 1.0;
            }
        }
        let corner = layers.lowest_voxel(cell);
        for patch in 0..patches.count() {
            let position = |axis: usize| corner[axis] + sums[patch][axis] / counts[patch];
            net.positions.push([position(0), position(1), position(2)]);
            net.middles.push(corner.map(|c| c + 0.5));
        }
    }
}

/// A quad across each edge that begins at the lowest voxel of a cell: the four cells around it are known by then.
fn add_quads<T: Value, R: Rule<T>>(layers: &Layers<'_, T, R>, net: &mut Net) {
    /// Steps back along the two other axes to the cells around an edge, counter-clockwise from its far end.
    const AROUND: [(usize, usize); 4] = [(1, 1), (0, 1), (0, 0), (1, 0)];
    for &cell in layers.active() {
        for axis in 0..3 {
            let Some(is_low_inside) = layers.low_inside_of_crossed_edge(cell, axis) else {
                continue;
            };
            let mut quad =
                AROUND.map(|back| layers.vertex_of(cell, axis, back, edge_along(axis, back)));
            if !is_low_inside {
                quad.reverse();
            }
            net.quads.push(quad);
        }
    }
}

fn too_large(inside: Inside) -> Violation {
    let (field, advice) = match inside {
        Inside::Label(_) => ("label", "crop the volume"),
        Inside::Threshold(_) => (
            "threshold",
            "crop the volume, or is the threshold in the noise?",
        ),
    };
    Violation::new(
        field,
        format!("has a surface of more than {MAX_QUADS} voxel faces, which is the limit; {advice}"),
    )
}

// === impl Net ===

impl Net {
    /// The volume that the voxels themselves say, mm3: for a label that of its voxels, for a threshold that of the
    /// interpolated surface.
    pub(super) fn volume_mm3(&self, lattice: &Lattice, inside: Inside) -> f64 {
        match inside {
            // With every vertex in the middle of its cell the quads are the faces of the voxels.
            Inside::Label(_) => volume(&self.middles, &self.quads) * lattice.voxel_mm3(),
            Inside::Threshold(_) => volume(&self.positions, &self.quads) * lattice.voxel_mm3(),
        }
    }

    /// The net in space, each quad cut along its shorter diagonal, facing outwards.
    pub(super) fn mesh(&self, lattice: &Lattice) -> Mesh {
        let vertices: Vec<Point3> = self
            .positions
            .iter()
            .map(|position| lattice.point(Vector3::from(position.map(f64::from))))
            .collect();
        let mut triangles = Vec::with_capacity(2 * self.quads.len());
        for &[a, b, c, d] in &self.quads {
            let length2 = |from: u32, to: u32| {
                (vertices[from as usize] - vertices[to as usize]).norm_squared()
            };
            if length2(a, c) <= length2(b, d) {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
        if lattice.is_left_handed() {
            for triangle in &mut triangles {
                triangle.swap(1, 2);
            }
        }
        Mesh {
            vertices,
            triangles,
        }
    }
}

/// Volume enclosed by quads that are flat, or by the mean of both ways to cut them, in voxels.
fn volume(positions: &[[f32; 3]], quads: &[[u32; 4]]) -> f64 {
    quads.iter().map(|quad| cone(positions, quad)).sum()
}

/// Volume between the origin and a quad, in voxels.
pub(super) fn cone(positions: &[[f32; 3]], quad: &[u32; 4]) -> f64 {
    let [a, b, c, d] = quad.map(|corner| Vector3::from(positions[corner as usize].map(f64::from)));
    // Six times a cut along one diagonal plus six times one along the other.
    (a.dot(&b.cross(&c)) + a.dot(&c.cross(&d)) + a.dot(&b.cross(&d)) + b.dot(&c.cross(&d))) / 12.0
}
