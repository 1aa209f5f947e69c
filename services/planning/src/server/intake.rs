//! Reads a stream of options, model chunks and lesion chunks. What is too large is refused by its
//! header, before any of it arrives, and nobody can send more than was announced.

use std::time::Duration;

use arthro_bootstrap::status;
use arthro_geometry::{Mesh, Point3};
use arthro_proto::common::v1 as common;
use arthro_proto::common::v1::mesh_chunk::Part;
use arthro_proto::planning::v1 as proto;
use tonic::{Status, Streaming};

use super::options;
use crate::plan;

/// Longest pause between two messages of a request.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most vertices of a model.
pub(super) const MAX_VERTICES: u32 = 1_000_000;
/// Most triangles of a model.
pub(super) const MAX_TRIANGLES: u32 = 2_000_000;
/// Most points of a lesion.
const MAX_LESION_POINTS: u32 = 1_000_000;
/// Three numbers of four bytes.
const TRIPLE_BYTES: usize = 12;

pub(super) async fn plan(
    mut stream: Streaming<proto::PlanResectionRequest>,
) -> Result<plan::Request, Status> {
    use proto::plan_resection_request::Payload;
    let first = next(&mut stream).await?.and_then(|first| first.payload);
    let Some(Payload::Options(options)) = first else {
        return Err(options_first());
    };
    let mut parts = Parts::announced(options.model.as_ref(), options.lesion.as_ref())?;
    let mut request = options::plan(&options)?;
    while let Some(message) = next(&mut stream).await? {
        match message.payload {
            Some(Payload::Model(chunk)) => parts.model(chunk)?,
            Some(Payload::Lesion(bytes)) => parts.lesion.push(&bytes)?,
            Some(Payload::Options(_)) => return Err(options_once()),
            None => return Err(status::invalid("payload", "is empty")),
        }
    }
    (request.model, request.lesion) = parts.complete()?;
    Ok(request)
}

pub(super) async fn evaluation(
    mut stream: Streaming<proto::EvaluateResectionRequest>,
) -> Result<plan::EvaluationRequest, Status> {
    use proto::evaluate_resection_request::Payload;
    let first = next(&mut stream).await?.and_then(|first| first.payload);
    let Some(Payload::Options(options)) = first else {
        return Err(options_first());
    };
    let mut parts = Parts::announced(options.model.as_ref(), options.lesion.as_ref())?;
    let mut request = options::evaluation(&options)?;
    while let Some(message) = next(&mut stream).await? {
        match message.payload {
            Some(Payload::Model(chunk)) => parts.model(chunk)?,
            Some(Payload::Lesion(bytes)) => parts.lesion.push(&bytes)?,
            Some(Payload::Options(_)) => return Err(options_once()),
            None => return Err(status::invalid("payload", "is empty")),
        }
    }
    (request.model, request.lesion) = parts.complete()?;
    Ok(request)
}

/// The next message. A client that falls silent must not keep a computation's turn.
pub(super) async fn next<T>(stream: &mut Streaming<T>) -> Result<Option<T>, Status> {
    tokio::time::timeout(PATIENCE, stream.message())
        .await
        .map_err(|_| {
            let seconds = PATIENCE.as_secs();
            Status::deadline_exceeded(format!("no part of the request came for {seconds} s"))
        })?
}

pub(super) fn options_first() -> Status {
    status::invalid("options", "must be the first message of the stream")
}

pub(super) fn options_once() -> Status {
    status::invalid("options", "may be sent once only")
}

/// The packed parts of a request.
struct Parts {
    vertices: Packed,
    triangles: Packed,
    lesion: Packed,
}

impl Parts {
    fn announced(
        model: Option<&common::MeshHeader>,
        lesion: Option<&common::CloudHeader>,
    ) -> Result<Self, Status> {
        let model = model.ok_or_else(|| status::invalid("options.model", "is missing"))?;
        in_ct("options.model.frame", model.frame)?;
        let lesion_points = match lesion {
            None => 0,
            Some(lesion) => {
                in_ct("options.lesion.frame", lesion.frame)?;
                if lesion.has_normals {
                    return Err(status::invalid(
                        "options.lesion.has_normals",
                        "is true; a lesion has none",
                    ));
                }
                lesion.point_count
            }
        };
        let vertices = ("options.model.vertex_count", model.vertex_count);
        let triangles = ("options.model.triangle_count", model.triangle_count);
        let lesion = ("options.lesion.point_count", lesion_points);
        Ok(Self {
            vertices: Packed::announced("model.vertices", vertices, 4..=MAX_VERTICES)?,
            triangles: Packed::announced("model.triangles", triangles, 4..=MAX_TRIANGLES)?,
            lesion: Packed::announced("lesion", lesion, 0..=MAX_LESION_POINTS)?,
        })
    }

    fn model(&mut self, chunk: common::MeshChunk) -> Result<(), Status> {
        match chunk.part {
            Some(Part::Vertices(bytes)) => self.vertices.push(&bytes),
            Some(Part::Triangles(bytes)) => self.triangles.push(&bytes),
            None => Err(status::invalid("model.part", "is empty")),
        }
    }

    fn complete(self) -> Result<(Mesh, Vec<Point3>), Status> {
        let mesh = Mesh {
            vertices: self.vertices.points()?,
            triangles: self.triangles.triples(u32::from_le_bytes)?,
        };
        Ok((mesh, self.lesion.points()?))
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
