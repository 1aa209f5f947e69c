//! Which bites to take, through the planning service.

use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use arthro_proto::planning::v1::planning_service_client::PlanningServiceClient;
use bytes::Bytes;

use super::replicas::{Replicas, Run};
use super::{Failure, Peer, chunks, within};

const PEER: Peer = Peer::Planning;

/// A client of the planning service; clones share its replicas.
#[derive(Clone, Debug)]
pub struct Planning(Replicas);

/// A plan under way. Dropping it stops the computation.
pub type PlanningRun = Run<proto::PlanResectionResponse>;

/// The packed surface and lesion that a plan is made on.
#[derive(Clone, Debug, Default)]
pub struct PackedModel {
    /// Packed vertices, ct.
    pub vertices: Bytes,
    /// Packed triangles.
    pub triangles: Bytes,
    /// Packed points inside the damaged tissue, ct; may be empty.
    pub lesion: Bytes,
}

impl Planning {
    pub(super) fn new(replicas: Replicas) -> Self {
        Self(replicas)
    }

    /// Starts planning on `model`, whose headers are filled in here.
    pub async fn plan(
        &self,
        options: proto::PlanResectionOptions,
        model: PackedModel,
    ) -> Result<PlanningRun, Failure> {
        use proto::plan_resection_request::Payload;
        let options = proto::PlanResectionOptions {
            model: Some(model.mesh_header()),
            lesion: model.lesion_header(),
            ..options
        };
        let payloads = std::iter::once(Payload::Options(options))
            .chain(model.mesh_chunks().map(Payload::Model))
            .chain(chunks(model.lesion.clone()).map(Payload::Lesion));
        let requests: Vec<_> = payloads
            .map(|payload| proto::PlanResectionRequest {
                payload: Some(payload),
            })
            .collect();
        Run::begin(
            &self.0,
            |answer: &proto::PlanResectionResponse| {
                matches!(
                    answer.event,
                    Some(proto::plan_resection_response::Event::Plan(_))
                )
            },
            move |channel, remaining| {
                let call = within(remaining, tokio_stream::iter(requests.clone()));
                Box::pin(async move {
                    PlanningServiceClient::new(channel)
                        .plan_resection(call)
                        .await
                })
            },
        )
        .await
    }

    /// Scores the bites of `options` on `model`, whose headers are filled in here.
    pub async fn evaluate(
        &self,
        options: proto::EvaluateResectionOptions,
        model: PackedModel,
    ) -> Result<proto::ResectionEvaluation, Failure> {
        use proto::evaluate_resection_request::Payload;
        let options = proto::EvaluateResectionOptions {
            model: Some(model.mesh_header()),
            lesion: model.lesion_header(),
            ..options
        };
        let payloads = std::iter::once(Payload::Options(options))
            .chain(model.mesh_chunks().map(Payload::Model))
            .chain(chunks(model.lesion.clone()).map(Payload::Lesion));
        let requests: Vec<_> = payloads
            .map(|payload| proto::EvaluateResectionRequest {
                payload: Some(payload),
            })
            .collect();
        self.0
            .ask(|channel, remaining| {
                let call = within(remaining, tokio_stream::iter(requests.clone()));
                async move {
                    PlanningServiceClient::new(channel)
                        .evaluate_resection(call)
                        .await
                }
            })
            .await?
            .evaluation
            .ok_or_else(|| Failure::unusable(PEER, "no evaluation was sent"))
    }
}

impl PackedModel {
    /// Counts fit in 32 bits: uploads are limited far below.
    fn mesh_header(&self) -> common::MeshHeader {
        common::MeshHeader {
            frame: common::Frame::Ct.into(),
            vertex_count: (self.vertices.len() / 12) as u32,
            triangle_count: (self.triangles.len() / 12) as u32,
        }
    }

    fn lesion_header(&self) -> Option<common::CloudHeader> {
        (!self.lesion.is_empty()).then(|| common::CloudHeader {
            frame: common::Frame::Ct.into(),
            point_count: (self.lesion.len() / 12) as u32,
            has_normals: false,
        })
    }

    fn mesh_chunks(&self) -> impl Iterator<Item = common::MeshChunk> + use<> {
        use common::mesh_chunk::Part;
        chunks(self.vertices.clone())
            .map(Part::Vertices)
            .chain(chunks(self.triangles.clone()).map(Part::Triangles))
            .map(|part| common::MeshChunk { part: Some(part) })
    }
}
