//! Surfaces for the tests of the formats, with coordinates that are float32 numbers.

use proptest::prelude::*;

use crate::{Cloud, Mesh, Point3, Vector3};

pub(crate) fn point() -> impl Strategy<Value = Point3> {
    let coordinate = || (-500.0..500.0_f32).prop_map(f64::from);
    (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| Point3::new(x, y, z))
}

/// Points with normals along an axis, which float32 holds exactly, or without normals.
pub(crate) fn cloud() -> impl Strategy<Value = Cloud> {
    let normal = (0..3_usize, any::<bool>()).prop_map(|(axis, is_up)| {
        let mut normal = Vector3::zeros();
        normal[axis] = if is_up { 1.0 } else { -1.0 };
        normal
    });
    (
        prop::collection::vec((point(), normal), 1..40),
        any::<bool>(),
    )
        .prop_map(|(vertices, has_normals)| {
            let (points, normals): (_, Vec<Vector3>) = vertices.into_iter().unzip();
            Cloud {
                points,
                normals: if has_normals { normals } else { Vec::new() },
            }
        })
}

/// Any triangles between different points, each point in at least one of them and named in the order of the triangles.
pub(crate) fn mesh() -> impl Strategy<Value = Mesh> {
    prop::collection::hash_set((-5000..5000_i16, -5000..5000_i16, -5000..5000_i16), 3..40).prop_map(
        |points| {
            let vertices: Vec<Point3> = points
                .into_iter()
                .map(|(x, y, z)| Point3::new(x.into(), y.into(), z.into()) / 16.0)
                .collect();
            let count = vertices.len() as u32;
            Mesh {
                vertices,
                triangles: (2..count).map(|index| [0, index - 1, index]).collect(),
            }
        },
    )
}
