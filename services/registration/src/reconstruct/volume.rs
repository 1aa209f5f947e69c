//! Gives a mesh the volume it must have: smoothing and simplification both shave off what is rounded.

use arthro_geometry::scan::Lattice;
use arthro_geometry::{Mesh, Point3, Vector3};
use rayon::prelude::*;

use super::smooth::REACH;
use super::surface_nets::Net;

/// Most moves along the normals.
const MAX_ROUNDS: usize = 30;
/// Longest move at once, as a share of the shortest step between voxels: where all is thin, the area that the move is
/// computed from changes with it.
const MAX_MOVE: f64 = 0.25;
/// Volume is right up to this share.
const TOLERANCE: f64 = 1e-5;
/// Vertices that a thread takes at a time.
const CHUNK: usize = 4096;

/// Moves the vertices of the mesh of a net along their normals, within their cells, until it encloses `volume_mm3`.
pub(super) fn restore_within_cells(mesh: &mut Mesh, volume_mm3: f64, net: &Net, lattice: &Lattice) {
    let reach = Vector3::repeat(REACH.into());
    restore_by(mesh, volume_mm3, lattice, |vertex, moved| {
        let middle = Vector3::from(net.middles[vertex].map(f64::from));
        let index = lattice.index(&moved);
        lattice.point(index.sup(&(middle - reach)).inf(&(middle + reach)))
    });
}

/// Moves the vertices of a mesh along their normals until it encloses `volume_mm3`.
pub(super) fn restore(mesh: &mut Mesh, volume_mm3: f64, lattice: &Lattice) {
    restore_by(mesh, volume_mm3, lattice, |_, moved| moved);
}

/// `hold` says where a vertex, by its number, may be instead of where it would be moved.
fn restore_by(
    mesh: &mut Mesh,
    volume_mm3: f64,
    lattice: &Lattice,
    hold: impl Fn(usize, Point3) -> Point3 + Sync,
) {
    let shortest_mm = lattice
        .spacing_mm()
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let longest_mm = MAX_MOVE * shortest_mm;
    for _ in 0..MAX_ROUNDS {
        let lacking_mm3 = volume_mm3 - mesh.volume_mm3();
        if lacking_mm3.abs() <= TOLERANCE * volume_mm3 {
            return;
        }
        let outwards_mm = (lacking_mm3 / mesh.area_mm2()).clamp(-longest_mm, longest_mm);
        let normals = mesh.vertex_normals();
        let vertices = mesh.vertices.par_iter_mut().zip(&normals).enumerate();
        let vertices = vertices.with_min_len(CHUNK);
        vertices.for_each(|(number, (vertex, normal))| {
            *vertex = hold(number, *vertex + normal * outwards_mm);
        });
    }
}
