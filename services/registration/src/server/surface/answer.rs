//! A reconstructed surface as messages: figures, mesh, cloud.

use std::time::Duration;

use arthro_geometry::{Cloud, Vector3};
use arthro_proto::common::v1::mesh_chunk::Part;
use arthro_proto::common::v1::{CloudHeader, Frame, MeshChunk, MeshHeader};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::reconstruct_surface_response::Payload;

use crate::reconstruct::Reconstruction;

/// Vertices, triangles, or points with normals a chunk of at most 256 KiB.
const PER_CHUNK: usize = 256 * 1024 / 24;

/// Figures, mesh header, mesh chunks, and the same of the cloud if there is one.
pub(super) fn messages<'a>(
    surface: &'a Reconstruction,
    cloud: Option<&'a Cloud>,
    elapsed: Duration,
) -> impl Iterator<Item = api::ReconstructSurfaceResponse> + 'a {
    let mesh = &surface.mesh;
    let header = MeshHeader {
        frame: Frame::Ct.into(),
        vertex_count: mesh.vertices.len() as u32,
        triangle_count: mesh.triangles.len() as u32,
    };
    let vertices = mesh.vertices.chunks(PER_CHUNK).map(|vertices| {
        let packed = vertices.iter().flat_map(|vertex| packed(&vertex.coords));
        Part::Vertices(packed.collect::<Vec<u8>>().into())
    });
    let triangles = mesh.triangles.chunks(PER_CHUNK).map(|triangles| {
        let packed = triangles
            .iter()
            .flatten()
            .flat_map(|corner| corner.to_le_bytes());
        Part::Triangles(packed.collect::<Vec<u8>>().into())
    });
    let chunks = vertices.chain(triangles);
    [
        Payload::Figures(figures(surface, elapsed)),
        Payload::Mesh(header),
    ]
    .into_iter()
    .chain(chunks.map(|part| Payload::Chunk(MeshChunk { part: Some(part) })))
    .chain(cloud.into_iter().flat_map(cloud_payloads))
    .map(|payload| api::ReconstructSurfaceResponse {
        payload: Some(payload),
    })
}

fn figures(surface: &Reconstruction, elapsed: Duration) -> api::SurfaceFigures {
    api::SurfaceFigures {
        volume_mm3: surface.mesh.volume_mm3(),
        voxel_volume_mm3: surface.voxel_volume_mm3,
        area_mm2: surface.mesh.area_mm2(),
        max_deviation_mm: surface.max_deviation_mm,
        dropped_pieces: surface.dropped_pieces as u32,
        touches_border: surface.touches_border,
        seconds: elapsed.as_secs_f64(),
    }
}

fn cloud_payloads(cloud: &Cloud) -> impl Iterator<Item = Payload> + '_ {
    let header = CloudHeader {
        frame: Frame::Ct.into(),
        point_count: cloud.points.len() as u32,
        has_normals: true,
    };
    let points = cloud.points.chunks(PER_CHUNK);
    let chunks = points.zip(cloud.normals.chunks(PER_CHUNK));
    let packed = chunks.map(|(points, normals)| {
        let both = points.iter().zip(normals);
        let packed = both.flat_map(|(p, n)| packed(&p.coords).into_iter().chain(packed(n)));
        Payload::Points(packed.collect::<Vec<u8>>().into())
    });
    std::iter::once(Payload::Cloud(header)).chain(packed)
}

/// Three little-endian float32.
fn packed(vector: &Vector3) -> [u8; 12] {
    let [x, y, z] = [0, 1, 2].map(|axis| (vector[axis] as f32).to_le_bytes());
    let mut bytes = [0; 12];
    for (place, byte) in bytes.iter_mut().zip(x.into_iter().chain(y).chain(z)) {
        *place = byte;
    }
    bytes
}
