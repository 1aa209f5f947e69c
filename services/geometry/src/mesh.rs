//! Triangle meshes: vertices in mm and counter-clockwise triangles whose normals point outwards.

use crate::cloud::bounds;
use crate::{Point3, Vector3};

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
