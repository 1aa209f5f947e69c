//! Where the model lies in the view, through the registration service.

use arthro_proto::registration::v1 as proto;
use arthro_proto::registration::v1::registration_service_client::RegistrationServiceClient;
use bytes::{Bytes, BytesMut};
use tonic::transport::Channel;

use super::replicas::{Event, Replicas, Run};
use super::{Failure, Peer, chunks, within};

const PEER: Peer = Peer::Registration;
/// A result holds four bytes a point of the view, of which there are two million at most.
const RESULT_MAX_BYTES: usize = 16 * 1024 * 1024;

/// A client of the registration service; clones share its replicas.
#[derive(Clone, Debug)]
pub struct Registration(Replicas);

/// A registration under way. Dropping it stops the computation.
pub type Registering = Run<proto::RegisterResponse>;

/// A cloud that came out of a depth image.
#[derive(Clone, Debug)]
pub struct Deprojected {
    /// How many points the service announced.
    pub point_count: u32,
    /// Whether each point carries a normal.
    pub has_normals: bool,
    /// Packed points.
    pub points: Bytes,
}

impl Registration {
    pub(super) fn new(replicas: Replicas) -> Self {
        Self(replicas)
    }

    /// Starts registering `source` (ct) to `target` (camera), both packed as the options announce.
    pub async fn register(
        &self,
        options: proto::RegisterOptions,
        source: Bytes,
        target: Bytes,
    ) -> Result<Registering, Failure> {
        use proto::register_request::Payload;
        let payloads = std::iter::once(Payload::Options(options))
            .chain(chunks(source).map(Payload::Source))
            .chain(chunks(target).map(Payload::Target));
        // The pieces share their bytes, so that sending them again costs no memory.
        let requests: Vec<_> = payloads
            .map(|payload| proto::RegisterRequest {
                payload: Some(payload),
            })
            .collect();
        Run::begin(
            &self.0,
            |answer: &proto::RegisterResponse| {
                matches!(
                    answer.event,
                    Some(proto::register_response::Event::Result(_))
                )
            },
            move |channel, remaining| {
                let call = within(remaining, tokio_stream::iter(requests.clone()));
                Box::pin(async move { client(channel).register(call).await })
            },
        )
        .await
    }

    /// Turns a depth image into a cloud of at most `max_bytes`.
    pub async fn deproject(
        &self,
        header: proto::DepthHeader,
        depth: Bytes,
        mask: Bytes,
        max_bytes: usize,
    ) -> Result<Deprojected, Failure> {
        use proto::deproject_depth_request::Payload;
        use proto::deproject_depth_response::Payload as Answer;
        let payloads = std::iter::once(Payload::Header(header))
            .chain(chunks(depth).map(Payload::Depth))
            .chain(chunks(mask).map(Payload::Mask));
        let requests: Vec<_> = payloads
            .map(|payload| proto::DeprojectDepthRequest {
                payload: Some(payload),
            })
            .collect();
        let mut answers = Run::begin(
            &self.0,
            |_| false,
            move |channel, remaining| {
                let call = within(remaining, tokio_stream::iter(requests.clone()));
                Box::pin(async move { client(channel).deproject_depth(call).await })
            },
        )
        .await?;
        let mut header = None;
        let mut points = BytesMut::new();
        while let Some(event) = answers.next().await? {
            let answer = match event {
                Event::Message(answer) => answer,
                Event::BegunAnew(_) => {
                    header = None;
                    points.clear();
                    continue;
                }
            };
            match answer.payload {
                Some(Answer::Header(announced)) => header = Some(announced),
                Some(Answer::Points(chunk)) => points.extend_from_slice(&chunk),
                // A case keeps the cloud alone.
                Some(Answer::Details(_) | Answer::Report(_)) | None => {}
            }
            if points.len() > max_bytes {
                return Err(Failure::unusable(PEER, "the cloud is too large"));
            }
        }
        let header = header.ok_or_else(|| Failure::unusable(PEER, "the cloud has no header"))?;
        Ok(Deprojected {
            point_count: header.point_count,
            has_normals: header.has_normals,
            points: points.freeze(),
        })
    }
}

fn client(channel: Channel) -> RegistrationServiceClient<Channel> {
    RegistrationServiceClient::new(channel).max_decoding_message_size(RESULT_MAX_BYTES)
}
