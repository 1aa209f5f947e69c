//! Writes PLY files tagged LPS and mm, with float32 coordinates.

use super::{Encoding, VERTEX_FIELDS};
use crate::{Cloud, Mesh, Vector3};

/// A binary little-endian file tagged LPS and mm, float32 coordinates.
pub fn write_mesh(mesh: &Mesh) -> Vec<u8> {
    write_mesh_as(mesh, Encoding::BinaryLittleEndian)
}

/// A binary little-endian file tagged LPS and mm, float32 coordinates, with normals if the cloud has them.
pub fn write_cloud(cloud: &Cloud) -> Vec<u8> {
    write_cloud_as(cloud, Encoding::BinaryLittleEndian)
}

/// As [`write_mesh`], in any encoding.
pub fn write_mesh_as(mesh: &Mesh, encoding: Encoding) -> Vec<u8> {
    let mut file = File::begin(encoding, mesh.vertices.len(), 3, Some(mesh.triangles.len()));
    for vertex in &mesh.vertices {
        file.put_coordinates(&vertex.coords);
        file.end_element();
    }
    for triangle in &mesh.triangles {
        file.put(3_u8, u8::to_le_bytes, u8::to_be_bytes);
        for index in triangle {
            file.put(*index, u32::to_le_bytes, u32::to_be_bytes);
        }
        file.end_element();
    }
    file.bytes
}

/// As [`write_cloud`], in any encoding.
pub fn write_cloud_as(cloud: &Cloud, encoding: Encoding) -> Vec<u8> {
    let has_normals = !cloud.points.is_empty() && cloud.normals.len() == cloud.points.len();
    let fields = if has_normals { 6 } else { 3 };
    let mut file = File::begin(encoding, cloud.points.len(), fields, None);
    for (index, point) in cloud.points.iter().enumerate() {
        file.put_coordinates(&point.coords);
        if has_normals {
            file.put_coordinates(&cloud.normals[index]);
        }
        file.end_element();
    }
    file.bytes
}

/// A file being written.
struct File {
    bytes: Vec<u8>,
    encoding: Encoding,
}

impl File {
    fn begin(encoding: Encoding, vertices: usize, fields: usize, faces: Option<usize>) -> Self {
        let mut text = format!(
            "ply\nformat {} 1.0\ncomment space LPS\ncomment unit mm\nelement vertex {vertices}\n",
            encoding.word()
        );
        for field in &VERTEX_FIELDS[..fields] {
            text.push_str(&format!("property float {field}\n"));
        }
        if let Some(faces) = faces {
            text.push_str(&format!("element face {faces}\n"));
            text.push_str("property list uchar uint vertex_indices\n");
        }
        text.push_str("end_header\n");
        Self {
            bytes: text.into_bytes(),
            encoding,
        }
    }

    fn put_coordinates(&mut self, values: &Vector3) {
        for value in values.iter() {
            self.put(*value as f32, f32::to_le_bytes, f32::to_be_bytes);
        }
    }

    fn put<T: ToString, const SIZE: usize>(
        &mut self,
        value: T,
        to_le_bytes: fn(T) -> [u8; SIZE],
        to_be_bytes: fn(T) -> [u8; SIZE],
    ) {
        match self.encoding {
            Encoding::Ascii => {
                self.bytes.extend_from_slice(value.to_string().as_bytes());
                self.bytes.push(b' ');
            }
            Encoding::BinaryLittleEndian => self.bytes.extend_from_slice(&to_le_bytes(value)),
            Encoding::BinaryBigEndian => self.bytes.extend_from_slice(&to_be_bytes(value)),
        }
    }

    /// In a text each element has a line of its own.
    fn end_element(&mut self) {
        if self.encoding == Encoding::Ascii {
            self.bytes.pop();
            self.bytes.push(b'\n');
        }
    }
}
