//! Writes OBJ files tagged LPS and mm, with every digit of the coordinates.

use std::fmt::Write;

use crate::{Cloud, Mesh, Vector3};

const HEADER: &str = "# space LPS\n# unit mm\n";

/// A file of `v` and `f`, tagged LPS and mm.
pub fn write_mesh(mesh: &Mesh) -> Vec<u8> {
    let mut text = String::from(HEADER);
    for vertex in &mesh.vertices {
        put(&mut text, "v", &vertex.coords);
    }
    for [a, b, c] in &mesh.triangles {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text.into_bytes()
}

/// A file of `v`, and as many `vn` if the cloud has normals, tagged LPS and mm.
pub fn write_cloud(cloud: &Cloud) -> Vec<u8> {
    let mut text = String::from(HEADER);
    for point in &cloud.points {
        put(&mut text, "v", &point.coords);
    }
    if cloud.normals.len() == cloud.points.len() {
        for normal in &cloud.normals {
            put(&mut text, "vn", normal);
        }
    }
    text.into_bytes()
}

fn put(text: &mut String, word: &str, vector: &Vector3) {
    let _ = writeln!(text, "{word} {} {} {}", vector.x, vector.y, vector.z);
}
