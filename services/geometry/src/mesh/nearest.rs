//! The point of a mesh that is nearest to a point: a tree of boxes around triangles.

use super::Mesh;
use crate::{Point3, Vector3};

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// Triangles arranged for looking up nearest points.
#[derive(Clone, Debug)]
pub struct NearestOnMesh {
    nodes: Vec<Node>,
    corners: Vec<[Point3; 3]>,
}

/// A box and what is inside: the triangles `first..end`, halved between the node that follows and `second` unless
/// they are a leaf.
#[derive(Clone, Debug)]
struct Node {
    low: Point3,
    high: Point3,
    first: usize,
    end: usize,
    second: usize,
}

impl NearestOnMesh {
    /// Arranges the triangles of `mesh`, which must be finite.
    pub fn new(mesh: &Mesh) -> Self {
        let mut corners: Vec<[Point3; 3]> = (0..mesh.triangles.len())
            .map(|index| mesh.corners(index))
            .collect();
        let mut nodes = Vec::with_capacity(corners.len());
        if !corners.is_empty() {
            let end = corners.len();
            split(&mut corners, 0, end, &mut nodes);
        }
        Self { nodes, corners }
    }

    /// The nearest point of the surface; `None` if the mesh has no triangle.
    pub fn nearest(&self, point: &Point3) -> Option<Point3> {
        let mut best = (f64::INFINITY, None);
        let mut waiting = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            waiting.push((0.0, 0));
        }
        while let Some((box_distance2, index)) = waiting.pop() {
            if box_distance2 >= best.0 {
                continue;
            }
            let node = &self.nodes[index];
            if node.second == 0 {
                for corners in &self.corners[node.first..node.end] {
                    let foot = nearest_of_triangle(corners, point);
                    let distance2 = (foot - point).norm_squared();
                    if distance2 < best.0 {
                        best = (distance2, Some(foot));
                    }
                }
                continue;
            }
            let mut halves =
                [index + 1, node.second].map(|half| (self.nodes[half].distance2(point), half));
            // The nearer half is looked at first: it is pushed last.
            halves.sort_by(|a, b| b.0.total_cmp(&a.0));
            waiting.extend(halves);
        }
        best.1
    }

    /// Distance to the surface, mm; infinite if the mesh has no triangle.
    pub fn distance_mm(&self, point: &Point3) -> f64 {
        self.nearest(point)
            .map_or(f64::INFINITY, |foot| (foot - point).norm())
    }
}

impl Node {
    /// Squared distance to the box, mm2; 0 inside.
    fn distance2(&self, point: &Point3) -> f64 {
        let outside = (self.low - point).sup(&(point - self.high));
        outside.sup(&Vector3::zeros()).norm_squared()
    }
}

/// Appends the node of the triangles `first..end` and those below it.
fn split(corners: &mut [[Point3; 3]], first: usize, end: usize, nodes: &mut Vec<Node>) {
    let part = &mut corners[first..end];
    let start = part[0][0];
    let (low, high) = part
        .iter()
        .flatten()
        .fold((start, start), |(low, high), p| (low.inf(p), high.sup(p)));
    let index = nodes.len();
    nodes.push(Node {
        low,
        high,
        first,
        end,
        second: 0,
    });
    if part.len() <= LEAF {
        return;
    }
    let axis = (high - low).imax();
    let middle = part.len() / 2;
    let place = |triangle: &[Point3; 3]| triangle.iter().map(|p| p[axis]).sum::<f64>();
    part.select_nth_unstable_by(middle, |a, b| place(a).total_cmp(&place(b)));
    split(corners, first, first + middle, nodes);
    nodes[index].second = nodes.len();
    split(corners, first + middle, end, nodes);
}

/// The point of a triangle that is nearest to `p`, by the region of its corners, edges or inside that `p` lies over
/// (Ericson, Real-Time Collision Detection, section 5.1.5).
fn nearest_of_triangle([a, b, c]: &[Point3; 3], p: &Point3) -> Point3 {
    let (ab, ac) = (b - a, c - a);
    let ap = p - a;
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    a + (ab * vb + ac * vc) / (va + vb + vc)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom;
    use proptest::prelude::*;

    /// Distance to a triangle by dense sampling of it.
    fn sampled_distance(corners: &[Point3; 3], p: &Point3) -> f64 {
        let [a, b, c] = corners;
        let mut best = f64::INFINITY;
        for i in 0..=200 {
            for j in 0..=200 - i {
                let foot = a + (b - a) * f64::from(i) / 200.0 + (c - a) * f64::from(j) / 200.0;
                best = best.min((foot - p).norm());
            }
        }
        best
    }

    proptest! {
        #[test]
        fn the_nearest_point_of_a_triangle_is_as_near_as_any(
            numbers in prop::collection::vec(-1.0..1.0f64, 12),
        ) {
            let at = |i: usize| Point3::new(numbers[i], numbers[i + 1], numbers[i + 2]);
            let corners = [at(0), at(3), at(6)];
            let p = at(9);
            let distance = (nearest_of_triangle(&corners, &p) - p).norm();
            let sampled = sampled_distance(&corners, &p);
            prop_assert!(distance <= sampled + 1e-9 && sampled < distance + 0.03, "{} {}", distance, sampled);
        }

        #[test]
        fn the_tree_finds_what_a_search_through_all_triangles_finds(
            numbers in prop::collection::vec(-30.0..30.0f64, 3),
        ) {
            let mesh = phantom::mesh();
            let tree = NearestOnMesh::new(&mesh);
            let p = Point3::new(numbers[0], numbers[1], numbers[2]);
            let searched = (0..mesh.triangles.len())
                .map(|index| (nearest_of_triangle(&mesh.corners(index), &p) - p).norm())
                .fold(f64::INFINITY, f64::min);
            prop_assert!((tree.distance_mm(&p) - searched).abs() < 1e-12);
        }
    }

    #[test]
    fn a_mesh_without_triangles_is_infinitely_far() {
        let tree = NearestOnMesh::new(&Mesh::default());
        assert_eq!(tree.distance_mm(&Point3::origin()), f64::INFINITY);
    }
}
