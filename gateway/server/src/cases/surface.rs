//! The model as registration wants it: points spread evenly over the surface, each with its outward
//! normal, because a mesh's vertices are dense where it is curved and sparse where it is flat.

use arthro_geometry::{Mesh, sampled};
use bytes::{BufMut as _, Bytes, BytesMut};

use crate::cases::upload;

/// Distance between neighbouring points, mm.
const SPACING_MM: f64 = 0.5;
/// Most points, so that a large mesh given in a wrong unit does not fill the memory.
const POINTS_MAX: usize = 500_000;

/// Points on a surface as packed bytes with normals.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceCloud {
    /// How many points.
    pub point_count: u32,
    /// Packed points with normals.
    pub packed: Bytes,
}

/// Unpacks a stored mesh.
pub fn mesh(vertices: &[u8], triangles: &[u8]) -> Mesh {
    Mesh {
        vertices: upload::positions(vertices, false),
        triangles: upload::triangles(triangles).collect(),
    }
}

/// Spreads points over the surface, at most [`SPACING_MM`] apart.
pub fn sample(mesh: &Mesh) -> SurfaceCloud {
    let cloud = sampled::sample(mesh, SPACING_MM, POINTS_MAX);
    let mut packed = BytesMut::with_capacity(cloud.points.len() * 24);
    for (point, normal) in cloud.points.iter().zip(&cloud.normals) {
        for value in point.coords.iter().chain(normal.iter()) {
            packed.put_f32_le(*value as f32);
        }
    }
    SurfaceCloud {
        point_count: cloud.points.len() as u32,
        packed: packed.freeze(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::Point3;

    #[test]
    fn the_points_are_packed_with_their_normals() {
        let mesh = Mesh {
            vertices: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
                .map(|[x, y]| Point3::new(x, y, 7.0))
                .to_vec(),
            triangles: vec![[0, 1, 2]],
        };
        let cloud = sample(&mesh);
        assert_eq!(cloud.packed.len(), 24 * cloud.point_count as usize);
        let points = upload::positions(&cloud.packed, true);
        assert!(points.iter().all(|point| point.z == 7.0));
        let normal_z = f32::from_le_bytes(cloud.packed[20..24].try_into().unwrap());
        assert_eq!(normal_z, 1.0);
    }
}
