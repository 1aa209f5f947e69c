//! The triangles around each vertex of a closed mesh, kept as edges are collapsed.
//!
//! The corners of a vertex form a circular list; merging two vertices joins their lists by one exchange.

use arthro_geometry::Mesh;

/// No corner, or no vertex.
const NONE: u32 = u32::MAX;

/// Triangles and the rings of corners at their vertices. Corner `3 t + i` is corner `i` of triangle `t`.
pub(super) struct Rings {
    triangles: Vec<[u32; 3]>,
    /// The next corner at the same vertex.
    next: Vec<u32>,
    /// A corner of each vertex.
    first: Vec<u32>,
    alive: usize,
}

impl Rings {
    pub(super) fn of(mesh: &Mesh) -> Self {
        let mut first = vec![NONE; mesh.vertices.len()];
        let mut next: Vec<u32> = (0..3 * mesh.triangles.len() as u32).collect();
        for (corner, vertex) in mesh.triangles.iter().flatten().enumerate() {
            let first = &mut first[*vertex as usize];
            if *first == NONE {
                *first = corner as u32;
            } else {
                next.swap(*first as usize, corner);
            }
        }
        Self {
            triangles: mesh.triangles.clone(),
            next,
            first,
            alive: mesh.triangles.len(),
        }
    }

    /// How many triangles are left.
    pub(super) fn triangle_count(&self) -> usize {
        self.alive
    }

    /// The triangles that are left.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles
            .iter()
            .copied()
            .filter(|triangle| triangle[0] != NONE)
    }

    /// The triangles at a vertex.
    pub(super) fn triangles_at(&self, vertex: u32) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.corners_at(vertex)
            .map(|corner| self.triangles[corner as usize / 3])
    }

    /// The vertices joined to a vertex by an edge: in a closed mesh each one follows it in exactly one triangle.
    pub(super) fn neighbours(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        self.corners_at(vertex).map(|corner| {
            let (triangle, place) = (corner as usize / 3, corner as usize % 3);
            self.triangles[triangle][(place + 1) % 3]
        })
    }

    /// Whether merging two ends of an edge leaves a closed manifold: their only common neighbours are the two opposite
    /// the edge (the link condition, Dey et al. 1999), and each of those keeps at least three triangles.
    pub(super) fn may_merge(&self, kept: u32, gone: u32) -> bool {
        let is_theirs = |vertex: &u32| self.neighbours(gone).any(|other| other == *vertex);
        let mut common = self.neighbours(kept).filter(is_theirs);
        let keeps_three = |vertex: u32| self.corners_at(vertex).nth(3).is_some();
        match (common.next(), common.next(), common.next()) {
            (Some(one), Some(other), None) => keeps_three(one) && keeps_three(other),
            _ => false,
        }
    }

    /// Merges the ends of an edge; its two triangles go.
    pub(super) fn merge(&mut self, kept: u32, gone: u32) {
        let beside: Vec<usize> = self
            .corners_at(gone)
            .map(|corner| corner as usize / 3)
            .filter(|triangle| self.triangles[*triangle].contains(&kept))
            .collect();
        for triangle in beside {
            self.remove(triangle);
        }
        let corners: Vec<u32> = self.corners_at(gone).collect();
        for corner in corners {
            self.triangles[corner as usize / 3][corner as usize % 3] = kept;
        }
        let (here, there) = (self.first[kept as usize], self.first[gone as usize]);
        self.next.swap(here as usize, there as usize);
        self.first[gone as usize] = NONE;
    }

    fn remove(&mut self, triangle: usize) {
        for (place, vertex) in self.triangles[triangle].into_iter().enumerate() {
            let corner = (3 * triangle + place) as u32;
            let before = self
                .corners_at(vertex)
                .find(|other| self.next[*other as usize] == corner)
                .unwrap_or(corner);
            let after = self.next[corner as usize];
            self.next[before as usize] = after;
            if self.first[vertex as usize] == corner {
                self.first[vertex as usize] = if after == corner { NONE } else { after };
            }
        }
        self.triangles[triangle] = [NONE; 3];
        self.alive -= 1;
    }

    fn corners_at(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.first[vertex as usize];
        let mut corner = first;
        std::iter::from_fn(move || {
            if corner == NONE {
                return None;
            }
            let this = corner;
            let following = self.next[this as usize];
            corner = if following == first { NONE } else { following };
            Some(this)
        })
    }
}
