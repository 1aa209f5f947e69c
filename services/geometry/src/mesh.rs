//! Triangle meshes: vertices in mm and counter-clockwise triangles whose normals point outwards.

use crate::cloud::bounds;
use crate::{Point3, Vector3};

mod nearest;

pub use nearest::NearestOnMesh;

/// A triangle mesh in one frame, mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions, mm.
    pub vertices: Vec<Point3>,
    /// Indices into `vertices`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Corners of triangle `index`. Panics if the index is not below `triangles.len()`.
    pub fn corners(&self, index: usize) -> [Point3; 3] {
        self.triangles[index].map(|vertex| self.vertices[vertex as usize])
    }

    /// Lowest and highest corner of the axis-aligned bounding box, mm; `None` for an empty mesh.
    pub fn bounds(&self) -> Option<(Point3, Point3)> {
        bounds(&self.vertices)
    }

    /// Signed volume in mm3 by the divergence theorem; positive when the triangles face outwards.
    pub fn volume_mm3(&self) -> f64 {
        (0..self.triangles.len())
            .map(|index| {
                let [a, b, c] = self.corners(index);
                a.coords.dot(&b.coords.cross(&c.coords)) / 6.0
            })
            .sum()
    }

    /// Area of all triangles, mm2.
    pub fn area_mm2(&self) -> f64 {
        (0..self.triangles.len())
            .map(|index| {
                let [a, b, c] = self.corners(index);
                (b - a).cross(&(c - a)).norm() / 2.0
            })
            .sum()
    }

    /// How many edges are not shared by exactly two triangles that run along it in opposite directions; none in a
    /// watertight mesh.
    pub fn open_edges(&self) -> usize {
        let mut sides: Vec<(u32, u32, bool)> = self
            .triangles
            .iter()
            .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
            .map(|(from, to)| (from.min(to), from.max(to), from < to))
            .collect();
        sides.sort_unstable();
        let is_open =
            |edge: &&[(u32, u32, bool)]| !matches!(edge, [(a, b, false), (_, _, true)] if a != b);
        sides
            .chunk_by(|one, other| (one.0, one.1) == (other.0, other.1))
            .filter(is_open)
            .count()
    }

    /// Whether the mesh encloses a volume without any open edge. It may have several pieces.
    pub fn is_watertight(&self) -> bool {
        !self.triangles.is_empty() && self.open_edges() == 0
    }

    /// Area-weighted unit normal of each vertex; zero where no triangle touches it.
    pub fn vertex_normals(&self) -> Vec<Vector3> {
        let mut normals = vec![Vector3::zeros(); self.vertices.len()];
        for (index, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(index);
            let twice_area = (b - a).cross(&(c - a));
            for vertex in triangle {
                normals[*vertex as usize] += twice_area;
            }
        }
        for normal in &mut normals {
            *normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> Mesh {
        let corner = |i: u32| Point3::new((i & 1).into(), (i >> 1 & 1).into(), (i >> 2).into());
        Mesh {
            vertices: (0..8).map(corner).collect(),
            triangles: [
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
            ]
            .to_vec(),
        }
    }

    #[test]
    fn a_cube_is_watertight_with_its_volume_and_area() {
        let cube = cube();
        assert!(cube.is_watertight());
        assert!((cube.volume_mm3() - 1.0).abs() < 1e-12);
        assert!((cube.area_mm2() - 6.0).abs() < 1e-12);
    }

    #[test]
    fn holes_turned_triangles_and_fins_leave_open_edges() {
        let mut holed = cube();
        holed.triangles.pop();
        assert_eq!(holed.open_edges(), 3);
        let mut turned = cube();
        turned.triangles[5].swap(0, 1);
        assert_eq!(turned.open_edges(), 3);
        let mut finned = cube();
        finned.triangles.push([0, 1, 7]);
        assert_eq!(finned.open_edges(), 3);
        let mut doubled = cube();
        doubled.triangles.extend(cube().triangles);
        assert_eq!(doubled.open_edges(), 18);
        assert!(!Mesh::default().is_watertight());
    }
}
