//! `ReconstructSurface`: a volume comes in chunks, a mesh and a cloud go out in chunks.

use std::time::Instant;

use arthro_proto::registration::v1 as api;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tonic::{Response, Status, Streaming};

use super::{CancelOnDrop, Events, compute};
use crate::budget::Budget;
use crate::reconstruct::{reconstruct as domain, sample};

mod answer;
mod receive;

pub(super) async fn reconstruct(
    permit: OwnedSemaphorePermit,
    messages: Streaming<api::ReconstructSurfaceRequest>,
) -> Result<Response<Events<api::ReconstructSurfaceResponse>>, Status> {
    let upload = receive::volume(messages).await?;
    let began = Instant::now();
    let (events, received) = mpsc::unbounded_channel();
    let budget = Budget::default();
    let stream = CancelOnDrop {
        received,
        budget: budget.clone(),
        _timer: None,
    };
    compute(permit, events.clone(), move || {
        let surface = domain(&upload.scan, &upload.options, &budget)?;
        let cloud = (upload.cloud_points > 0).then(|| sample(&surface.mesh, upload.cloud_points));
        tracing::info!(
            voxels = upload.scan.lattice().len(),
            triangles = surface.mesh.triangles.len(),
            seconds = began.elapsed().as_secs_f64(),
            "reconstructed"
        );
        for message in answer::messages(&surface, cloud.as_ref(), began.elapsed()) {
            // The receiver is gone only when the client is.
            let _ = events.send(Ok(message));
        }
        Ok(())
    });
    Ok(Response::new(Box::pin(stream)))
}
