//! Writes STL files tagged LPS and mm.

use std::fmt::Write;

use super::{Encoding, HEADER_BYTES, STATEMENT};
use crate::{Mesh, Point3, Vector3};

/// A binary file tagged LPS and mm, float32 coordinates. Vertices that no triangle has are lost.
pub fn write_mesh(mesh: &Mesh) -> Vec<u8> {
    write_mesh_as(mesh, Encoding::Binary)
}

/// As [`write_mesh`], in either encoding; ascii keeps every digit of the coordinates.
pub fn write_mesh_as(mesh: &Mesh, encoding: Encoding) -> Vec<u8> {
    let facets = (0..mesh.triangles.len()).map(|index| {
        let corners = mesh.corners(index);
        (normal(&corners), corners)
    });
    match encoding {
        Encoding::Ascii => {
            let mut text = format!("solid {STATEMENT}\n");
            for (normal, corners) in facets {
                put_facet(&mut text, &normal, &corners);
            }
            text.push_str("endsolid\n");
            text.into_bytes()
        }
        Encoding::Binary => {
            let mut bytes = STATEMENT.as_bytes().to_vec();
            bytes.resize(HEADER_BYTES - 4, 0);
            bytes.extend_from_slice(&(mesh.triangles.len() as u32).to_le_bytes());
            for (normal, corners) in facets {
                for vector in [
                    normal,
                    corners[0].coords,
                    corners[1].coords,
                    corners[2].coords,
                ] {
                    for value in vector.iter() {
                        bytes.extend_from_slice(&(*value as f32).to_le_bytes());
                    }
                }
                bytes.extend_from_slice(&[0; 2]);
            }
            bytes
        }
    }
}

fn put_facet(text: &mut String, normal: &Vector3, corners: &[Point3; 3]) {
    let words = |v: &Vector3| format!("{} {} {}", v.x, v.y, v.z);
    let _ = writeln!(text, "facet normal {}\nouter loop", words(normal));
    for corner in corners {
        let _ = writeln!(text, "vertex {}", words(&corner.coords));
    }
    text.push_str("endloop\nendfacet\n");
}

/// Unit normal of a facet; zero, as STL writers do it, where the facet has no area.
fn normal([a, b, c]: &[Point3; 3]) -> Vector3 {
    (b - a)
        .cross(&(c - a))
        .try_normalize(1e-12)
        .unwrap_or_else(Vector3::zeros)
}
