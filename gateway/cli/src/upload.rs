//! Clouds and meshes as the packed, chunked streams of the contract.

use arthro_geometry::{Cloud, Mesh};
use arthro_proto::common::v1::{CloudHeader, Frame, MeshChunk, MeshHeader, mesh_chunk};
use bytes::Bytes;

/// The contract's largest chunk.
const CHUNK_BYTES: usize = 256 * 1024;

/// Announces `cloud`.
pub fn cloud_header(cloud: &Cloud, frame: Frame) -> CloudHeader {
    CloudHeader {
        frame: frame.into(),
        point_count: cloud.points.len() as u32,
        has_normals: !cloud.normals.is_empty(),
    }
}

/// The points of `cloud`, packed and cut into chunks.
pub fn cloud_chunks(cloud: &Cloud) -> impl Iterator<Item = Bytes> + use<> {
    let mut packed = Vec::with_capacity(cloud.points.len() * 24);
    for (index, point) in cloud.points.iter().enumerate() {
        push(&mut packed, point.coords.iter());
        if let Some(normal) = cloud.normals.get(index) {
            push(&mut packed, normal.iter());
        }
    }
    chunks(packed)
}

/// Announces `mesh`.
pub fn mesh_header(mesh: &Mesh) -> MeshHeader {
    MeshHeader {
        frame: Frame::Ct.into(),
        vertex_count: mesh.vertices.len() as u32,
        triangle_count: mesh.triangles.len() as u32,
    }
}

/// The vertices, then the triangles of `mesh`, packed and cut into chunks.
pub fn mesh_chunks(mesh: &Mesh) -> impl Iterator<Item = MeshChunk> + use<> {
    let mut vertices = Vec::with_capacity(mesh.vertices.len() * 12);
    for vertex in &mesh.vertices {
        push(&mut vertices, vertex.coords.iter());
    }
    let triangles: Vec<u8> = mesh
        .triangles
        .iter()
        .flatten()
        .flat_map(|index| index.to_le_bytes())
        .collect();
    let vertices = chunks(vertices).map(mesh_chunk::Part::Vertices);
    let triangles = chunks(triangles).map(mesh_chunk::Part::Triangles);
    vertices
        .chain(triangles)
        .map(|part| MeshChunk { part: Some(part) })
}

/// `packed` cut into chunks without copying.
pub fn chunks(packed: Vec<u8>) -> impl Iterator<Item = Bytes> {
    let mut rest = Bytes::from(packed);
    std::iter::from_fn(move || {
        (!rest.is_empty()).then(|| rest.split_to(rest.len().min(CHUNK_BYTES)))
    })
}

fn push<'a>(packed: &mut Vec<u8>, numbers: impl Iterator<Item = &'a f64>) {
    for number in numbers {
        packed.extend_from_slice(&(*number as f32).to_le_bytes());
    }
}
