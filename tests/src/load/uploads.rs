//! Uploads of 4 GiB, whatever they said before.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use arthro_proto::common::v1::mesh_chunk::Part;
use arthro_proto::common::v1::{Frame, MeshChunk, MeshHeader};
use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::upload_model_request::Payload;
use arthro_proto::gateway::v1::{ModelHeader, UploadModelRequest};
use bytes::Bytes;
use tokio::task::JoinSet;
use tonic::transport::Channel;
use tonic::{Code, Status};

const UPLOAD_BYTES: u64 = 4 << 30;
const CHUNK_BYTES: usize = 256 * 1024;
/// Bytes of a packed vertex.
const VERTEX_BYTES: u64 = 12;

/// What the header of an upload says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lie {
    /// That 4 GiB come.
    None,
    /// That a small model comes.
    Small,
}

/// Clients that upload again and again until this is dropped.
#[derive(Debug)]
pub struct Uploads {
    _clients: JoinSet<()>,
    refused: Arc<AtomicU64>,
    strange: Arc<AtomicU64>,
}

impl Uploads {
    /// So many at the same time, half of which announce what they send.
    pub async fn to(gateway: &str, case_id: &str, clients: usize) -> Self {
        let refused = Arc::new(AtomicU64::new(0));
        let strange = Arc::new(AtomicU64::new(0));
        let mut uploading = JoinSet::new();
        for number in 0..clients {
            let mut client = CaseServiceClient::connect(gateway.to_owned())
                .await
                .expect("the gateway takes a connection");
            let lie = [Lie::None, Lie::Small][number % 2];
            let (case_id, refused, strange) =
                (case_id.to_owned(), refused.clone(), strange.clone());
            uploading.spawn(async move {
                loop {
                    let refusal = upload(&mut client, &case_id, lie).await;
                    let counter = if is_refusal(&refusal) {
                        &refused
                    } else {
                        &strange
                    };
                    counter.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        Self {
            _clients: uploading,
            refused,
            strange,
        }
    }

    /// Uploads that were refused as they should be.
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// Uploads that ended otherwise.
    pub fn strange(&self) -> u64 {
        self.strange.load(Ordering::Relaxed)
    }
}

/// Tries to upload 4 GiB; answers how that ended.
pub async fn upload(
    client: &mut CaseServiceClient<Channel>,
    case_id: &str,
    lie: Lie,
) -> Result<(), Status> {
    let vertices = match lie {
        Lie::None => UPLOAD_BYTES / VERTEX_BYTES,
        Lie::Small => 1000,
    };
    let header = Payload::Header(ModelHeader {
        case_id: case_id.to_owned(),
        mesh: Some(MeshHeader {
            frame: Frame::Ct.into(),
            vertex_count: u32::try_from(vertices).unwrap_or(u32::MAX),
            triangle_count: 1000,
        }),
        ..ModelHeader::default()
    });
    let chunk = Bytes::from(vec![0; CHUNK_BYTES]);
    let chunks = UPLOAD_BYTES / CHUNK_BYTES as u64;
    let messages = std::iter::once(header).chain((0..chunks).map(move |_| {
        Payload::Mesh(MeshChunk {
            part: Some(Part::Vertices(chunk.clone())),
        })
    }));
    let requests = messages.map(|payload| UploadModelRequest {
        payload: Some(payload),
    });
    client
        .upload_model(tokio_stream::iter(requests))
        .await
        .map(drop)
}

/// Told the limit, or that as many as are taken are under way.
fn is_refusal(answer: &Result<(), Status>) -> bool {
    match answer {
        Ok(()) => false,
        Err(status) => match status.code() {
            Code::InvalidArgument => {
                status.message().contains("must be within")
                    || status.message().contains("the header announced")
            }
            Code::ResourceExhausted => true,
            _ => false,
        },
    }
}
