//! Points and triangles as packed bytes. What is too large is refused by its header, before any of it
//! arrives, and nobody can send more than was announced.

use arthro_bootstrap::status;
use arthro_geometry::{Mesh, Point3};
use arthro_proto::common::v1 as common;
use arthro_proto::common::v1::mesh_chunk::Part;
use tonic::Status;

/// Most vertices of a surface.
const MAX_VERTICES: u32 = 1_000_000;
/// Most triangles of a surface.
const MAX_TRIANGLES: u32 = 2_000_000;
/// Three numbers of four bytes.
const TRIPLE_BYTES: usize = 12;

/// How the parts of a surface are named in refusals.
pub(super) struct Fields {
    pub(super) header: &'static str,
    frame: &'static str,
    vertex_count: &'static str,
    triangle_count: &'static str,
    vertices: &'static str,
    triangles: &'static str,
    part: &'static str,
}

macro_rules! fields {
    ($header:literal, $name:literal) => {
        Fields {
            header: $header,
            frame: concat!($header, ".frame"),
            vertex_count: concat!($header, ".vertex_count"),
            triangle_count: concat!($header, ".triangle_count"),
            vertices: concat!($name, ".vertices"),
            triangles: concat!($name, ".triangles"),
            part: concat!($name, ".part"),
        }
    };
}

pub(super) const MODEL: Fields = fields!("options.model", "model");
pub(super) const FEMUR: Fields = fields!("options.joint.femur", "femur");
pub(super) const TIBIA: Fields = fields!("options.joint.tibia", "tibia");

/// The packed parts of a surface.
pub(super) struct Surface {
    part: &'static str,
    vertices: Packed,
    triangles: Packed,
}

impl Surface {
    pub(super) fn announced(fields: &Fields, header: &common::MeshHeader) -> Result<Self, Status> {
        in_ct(fields.frame, header.frame)?;
        let vertices = (fields.vertex_count, header.vertex_count);
        let triangles = (fields.triangle_count, header.triangle_count);
        Ok(Self {
            part: fields.part,
            vertices: Packed::announced(fields.vertices, vertices, 4..=MAX_VERTICES)?,
            triangles: Packed::announced(fields.triangles, triangles, 4..=MAX_TRIANGLES)?,
        })
    }

    pub(super) fn push(&mut self, chunk: common::MeshChunk) -> Result<(), Status> {
        match chunk.part {
            Some(Part::Vertices(bytes)) => self.vertices.push(&bytes),
            Some(Part::Triangles(bytes)) => self.triangles.push(&bytes),
            None => Err(status::invalid(self.part, "is empty")),
        }
    }

    pub(super) fn complete(self) -> Result<Mesh, Status> {
        Ok(Mesh {
            vertices: self.vertices.points()?,
            triangles: self.triangles.triples(u32::from_le_bytes)?,
        })
    }
}

pub(super) fn in_ct(field: &str, frame: i32) -> Result<(), Status> {
    if frame == common::Frame::Ct as i32 {
        return Ok(());
    }
    let name = common::Frame::try_from(frame).map_or_else(
        |_| frame.to_string(),
        |frame| frame.as_str_name().to_owned(),
    );
    Err(status::invalid(
        field,
        format!("is {name}; must be FRAME_CT"),
    ))
}

/// Bytes of which it is known how many come.
pub(super) struct Packed {
    field: &'static str,
    expected: usize,
    bytes: Vec<u8>,
}

impl Packed {
    pub(super) fn announced(
        field: &'static str,
        (count_field, count): (&str, u32),
        limits: std::ops::RangeInclusive<u32>,
    ) -> Result<Self, Status> {
        if !limits.contains(&count) {
            return Err(status::invalid(
                count_field,
                format!("is {count}; must be {} .. {}", limits.start(), limits.end()),
            ));
        }
        Ok(Self {
            field,
            expected: count as usize * TRIPLE_BYTES,
            // Grows with what arrives: an announcement alone takes no memory.
            bytes: Vec::new(),
        })
    }

    pub(super) fn push(&mut self, bytes: &[u8]) -> Result<(), Status> {
        let total = self.bytes.len() + bytes.len();
        if total > self.expected {
            return Err(self.mismatch(total));
        }
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    fn mismatch(&self, total: usize) -> Status {
        let expected = self.expected;
        status::invalid(
            self.field,
            format!("has {total} bytes or more; {expected} were announced"),
        )
    }

    pub(super) fn triples<T>(&self, read: fn([u8; 4]) -> T) -> Result<Vec<[T; 3]>, Status> {
        if self.bytes.len() != self.expected {
            return Err(status::invalid(
                self.field,
                format!(
                    "has {} bytes; {} were announced",
                    self.bytes.len(),
                    self.expected
                ),
            ));
        }
        let (triples, _) = self.bytes.as_chunks::<TRIPLE_BYTES>();
        let triple = |b: &[u8; TRIPLE_BYTES]| {
            [
                read([b[0], b[1], b[2], b[3]]),
                read([b[4], b[5], b[6], b[7]]),
                read([b[8], b[9], b[10], b[11]]),
            ]
        };
        Ok(triples.iter().map(triple).collect())
    }

    pub(super) fn points(&self) -> Result<Vec<Point3>, Status> {
        let triples = self.triples(f32::from_le_bytes)?;
        let is_finite = |triple: &[f32; 3]| triple.iter().all(|value| value.is_finite());
        if let Some(index) = triples.iter().position(|triple| !is_finite(triple)) {
            let [x, y, z] = triples[index];
            return Err(status::invalid(
                format!("{}[{index}]", self.field),
                format!("is ({x}, {y}, {z}); must be finite"),
            ));
        }
        let points = triples.into_iter();
        Ok(points
            .map(|triple| Point3::from(triple.map(f64::from)))
            .collect())
    }
}
