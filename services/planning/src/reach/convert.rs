//! Where nalgebra meets glam, of which parry's API is made. Nothing else converts.

use arthro_geometry::{Mesh, Point3};
use parry3d_f64::math::Vector;
use parry3d_f64::shape::{TriMesh, TriMeshBuilderError};

pub(super) fn to_glam(point: &Point3) -> Vector {
    Vector::from(*point)
}

pub(super) fn from_glam(point: Vector) -> Point3 {
    Point3::from(point)
}

pub(super) fn trimesh(mesh: &Mesh) -> Result<TriMesh, TriMeshBuilderError> {
    let vertices = mesh.vertices.iter().map(to_glam).collect();
    TriMesh::new(vertices, mesh.triangles.clone())
}
