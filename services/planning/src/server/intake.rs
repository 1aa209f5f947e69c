//! Reads a stream of options, model, lesion and bone chunks.

use std::time::Duration;

use arthro_bootstrap::status;
use arthro_geometry::{Mesh, Point3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use tonic::{Status, Streaming};

use super::joint::Bones;
use super::options;
use super::packed::{self, Packed, Surface};
use crate::plan;

/// Longest pause between two messages of a request.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most points of a lesion.
const MAX_LESION_POINTS: u32 = 1_000_000;

pub(super) async fn plan(
    mut stream: Streaming<proto::PlanResectionRequest>,
) -> Result<plan::Request, Status> {
    use proto::plan_resection_request::Payload;
    let first = next(&mut stream).await?.and_then(|first| first.payload);
    let Some(Payload::Options(options)) = first else {
        return Err(options_first());
    };
    let mut parts = Parts::announced(options.model.as_ref(), options.lesion.as_ref())?;
    let mut bones = Bones::announced(options.joint.as_ref())?;
    let mut request = options::plan(&options)?;
    while let Some(message) = next(&mut stream).await? {
        match message.payload {
            Some(Payload::Model(chunk)) => parts.model.push(chunk)?,
            Some(Payload::Lesion(bytes)) => parts.lesion.push(&bytes)?,
            Some(Payload::Femur(chunk)) => bones.femur()?.push(chunk)?,
            Some(Payload::Tibia(chunk)) => bones.tibia()?.push(chunk)?,
            Some(Payload::Options(_)) => return Err(options_once()),
            None => return Err(status::invalid("payload", "is empty")),
        }
    }
    (request.model, request.lesion) = parts.complete()?;
    if let Some(knee) = &mut request.knee {
        (knee.femur, knee.tibia) = bones.complete()?;
    }
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
            Some(Payload::Model(chunk)) => parts.model.push(chunk)?,
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
    model: Surface,
    lesion: Packed,
}

impl Parts {
    fn announced(
        model: Option<&common::MeshHeader>,
        lesion: Option<&common::CloudHeader>,
    ) -> Result<Self, Status> {
        let model = model.ok_or_else(|| status::invalid("options.model", "is missing"))?;
        let lesion_points = match lesion {
            None => 0,
            Some(lesion) => {
                packed::in_ct("options.lesion.frame", lesion.frame)?;
                if lesion.has_normals {
                    return Err(status::invalid(
                        "options.lesion.has_normals",
                        "is true; a lesion has none",
                    ));
                }
                lesion.point_count
            }
        };
        let lesion = ("options.lesion.point_count", lesion_points);
        Ok(Self {
            model: Surface::announced(&packed::MODEL, model)?,
            lesion: Packed::announced("lesion", lesion, 0..=MAX_LESION_POINTS)?,
        })
    }

    fn complete(self) -> Result<(Mesh, Vec<Point3>), Status> {
        Ok((self.model.complete()?, self.lesion.points()?))
    }
}
