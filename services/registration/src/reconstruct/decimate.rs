//! Fewer triangles by edge collapse with quadric errors (Garland and Heckbert, SIGGRAPH 1997).
//!
//! The cheapest edge is collapsed to the point that is nearest to the planes of all triangles merged there, until the
//! target is reached. A collapse that would open the surface, pinch it or fold it over is not made, so that a
//! watertight manifold stays one.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use arthro_geometry::nalgebra::center;
use arthro_geometry::scan::Lattice;
use arthro_geometry::{Mesh, Point3, Vector3};
use rayon::prelude::*;

use crate::budget::Budget;
use crate::error::{Error, Violation};

mod quadric;
mod rings;

use quadric::Quadric;
use rings::Rings;

/// How far a mesh is simplified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Decimation {
    /// Not at all.
    None,
    /// Until no more than so many triangles are left, or none can go without harm.
    Triangles(usize),
    /// As far as the distances to the planes merged into a vertex stay below this, mm: the root of the sum of
    /// their squares.
    WithinMm(f64),
    /// The same, as a share of the shortest step between voxels.
    WithinVoxels(f64),
}

/// Fewest triangles that may be asked for.
pub const MIN_TRIANGLES: usize = 100;
/// Largest error, mm.
pub const MAX_ERROR_MM: f64 = 10.0;
/// A triangle beside a collapsed edge may turn by no more than the angle with this cosine, 60 degrees.
const MIN_TURN_COSINE: f64 = 0.5;
/// Share of an edge's squared length in its cost: where the surface is flat, short edges go first.
const LENGTH_SHARE: f64 = 1e-6;
/// Collapses between two looks at the cancellation.
const COLLAPSES_BETWEEN_CHECKS: usize = 1024;

impl Default for Decimation {
    /// Far below what the voxels resolve.
    fn default() -> Self {
        Self::WithinVoxels(0.1)
    }
}

impl Decimation {
    pub(super) fn violation(&self) -> Option<Violation> {
        match *self {
            Self::Triangles(triangles) if triangles < MIN_TRIANGLES => Some(Violation::new(
                "triangles",
                format!("is {triangles}, must be at least {MIN_TRIANGLES}"),
            )),
            Self::WithinMm(error) if !(0.0..=MAX_ERROR_MM).contains(&error) => {
                Some(Violation::new(
                    "max_error_mm",
                    format!("is {error}, must be 0 to {MAX_ERROR_MM}"),
                ))
            }
            Self::WithinVoxels(error) if !(0.0..=1.0).contains(&error) => Some(Violation::new(
                "max_error_voxels",
                format!("is {error}, must be 0 to 1"),
            )),
            _ => None,
        }
    }
}

/// The mesh with fewer triangles.
pub(super) fn decimate(
    mesh: &Mesh,
    decimation: Decimation,
    lattice: &Lattice,
    budget: &Budget,
) -> Result<Mesh, Error> {
    let (triangles, error_mm) = match decimation {
        Decimation::None => return Ok(mesh.clone()),
        Decimation::Triangles(triangles) => (triangles, f64::INFINITY),
        Decimation::WithinMm(error_mm) => (0, error_mm),
        Decimation::WithinVoxels(share) => {
            let shortest = lattice
                .spacing_mm()
                .into_iter()
                .fold(f64::INFINITY, f64::min);
            (0, share * shortest)
        }
    };
    let mut collapsing = Collapsing::of(mesh, error_mm * error_mm);
    for collapses in 0usize.. {
        if collapses.is_multiple_of(COLLAPSES_BETWEEN_CHECKS) {
            budget.check()?;
        }
        if collapsing.rings.triangle_count() <= triangles {
            break;
        }
        match collapsing.waiting.pop() {
            Some(Reverse(edge)) => collapsing.try_collapse(&edge),
            None => break,
        }
    }
    Ok(collapsing.into_mesh())
}

/// A mesh under collapse.
struct Collapsing {
    vertices: Vec<Point3>,
    quadrics: Vec<Quadric>,
    /// How often a vertex has changed; a waiting edge of an earlier vertex is void.
    changes: Vec<u32>,
    rings: Rings,
    /// Edges that cost no more than the limit, cheapest first.
    waiting: BinaryHeap<Reverse<Edge>>,
    limit2_mm2: f64,
}

/// An edge that waits to be collapsed. The derived order puts the cheapest first and is total, so that the same mesh
/// is always simplified the same way.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    /// The cost in mm2, as the bits of a float32: of numbers that are not negative the larger has the larger bits.
    cost: u32,
    ends: [u32; 2],
    /// Changes of both ends together; they only grow.
    changes: u32,
}

impl Collapsing {
    fn of(mesh: &Mesh, limit2_mm2: f64) -> Self {
        let mut quadrics = vec![Quadric::default(); mesh.vertices.len()];
        for (index, triangle) in mesh.triangles.iter().enumerate() {
            let plane = Quadric::of_plane(&mesh.corners(index));
            for corner in triangle {
                quadrics[*corner as usize] += plane;
            }
        }
        let mut collapsing = Self {
            vertices: mesh.vertices.clone(),
            quadrics,
            changes: vec![0; mesh.vertices.len()],
            rings: Rings::of(mesh),
            waiting: BinaryHeap::new(),
            limit2_mm2,
        };
        // Each edge is met from both sides and taken once.
        let edges = mesh.triangles.par_iter().flat_map_iter(|[a, b, c]| {
            let sides = [[*a, *b], [*b, *c], [*c, *a]];
            sides.into_iter().filter(|[from, to]| from < to)
        });
        let waiting: Vec<Reverse<Edge>> = edges
            .map(|ends| collapsing.edge(ends))
            .filter(|edge| edge.error2_mm2() <= limit2_mm2)
            .map(Reverse)
            .collect();
        collapsing.waiting = waiting.into();
        collapsing
    }

    fn edge(&self, ends: [u32; 2]) -> Edge {
        let (quadric, target) = self.merged(ends);
        let [a, b] = ends.map(|end| self.vertices[end as usize]);
        let cost = quadric.error2(&target) + LENGTH_SHARE * (b - a).norm_squared();
        Edge {
            cost: (cost as f32).to_bits(),
            ends,
            changes: self.changes_of(ends),
        }
    }

    fn changes_of(&self, [a, b]: [u32; 2]) -> u32 {
        self.changes[a as usize] + self.changes[b as usize]
    }

    /// What both ends become.
    fn merged(&self, ends: [u32; 2]) -> (Quadric, Point3) {
        let [a, b] = ends.map(|end| end as usize);
        let quadric = self.quadrics[a] + self.quadrics[b];
        let middle = center(&self.vertices[a], &self.vertices[b]);
        (quadric, quadric.best_near(&middle))
    }

    fn try_collapse(&mut self, edge: &Edge) {
        let [kept, gone] = edge.ends;
        if self.changes_of(edge.ends) != edge.changes {
            return;
        }
        let (quadric, target) = self.merged(edge.ends);
        if !self.rings.may_merge(kept, gone)
            || self.folds(kept, gone, &target)
            || self.folds(gone, kept, &target)
        {
            return;
        }
        self.rings.merge(kept, gone);
        self.vertices[kept as usize] = target;
        self.quadrics[kept as usize] = quadric;
        self.changes[kept as usize] += 1;
        self.changes[gone as usize] += 1;
        for neighbour in self.rings.neighbours(kept) {
            let edge = self.edge([kept.min(neighbour), kept.max(neighbour)]);
            if edge.error2_mm2() <= self.limit2_mm2 {
                self.waiting.push(Reverse(edge));
            }
        }
    }

    /// Whether moving `moved` to `target` turns one of its triangles too far, those that also hold `other` left out.
    fn folds(&self, moved: u32, other: u32, target: &Point3) -> bool {
        self.rings.triangles_at(moved).any(|triangle| {
            if triangle.contains(&other) {
                return false;
            }
            let before = triangle.map(|corner| self.vertices[corner as usize]);
            let after = triangle.map(|corner| {
                if corner == moved {
                    *target
                } else {
                    self.vertices[corner as usize]
                }
            });
            let (before, after) = (twice_area(&before), twice_area(&after));
            before.dot(&after) <= MIN_TURN_COSINE * before.norm() * after.norm()
        })
    }

    fn into_mesh(self) -> Mesh {
        let mut number = vec![u32::MAX; self.vertices.len()];
        let mut mesh = Mesh::default();
        for triangle in self.rings.triangles() {
            mesh.triangles.push(triangle.map(|corner| {
                let number = &mut number[corner as usize];
                if *number == u32::MAX {
                    *number = mesh.vertices.len() as u32;
                    mesh.vertices.push(self.vertices[corner as usize]);
                }
                *number
            }));
        }
        mesh
    }
}

fn twice_area([a, b, c]: &[Point3; 3]) -> Vector3 {
    (b - a).cross(&(c - a))
}

// === impl Edge ===

impl Edge {
    fn error2_mm2(&self) -> f64 {
        f32::from_bits(self.cost).into()
    }
}
