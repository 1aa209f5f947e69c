//! `DeprojectDepth`: receives images within what their header announces, computes off the async runtime, and stops
//! when the client goes.

use arthro_bootstrap::status::invalid;
use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Camera};
use arthro_proto::registration::v1 as api;
use tokio::sync::OwnedSemaphorePermit;
use tonic::{Status, Streaming};

use self::answer::Answer;
use self::header::Announced;
use super::receive::{complete, count_in};
use crate::budget::Budget;
use crate::depth::fusion::frames::Frame;
use crate::depth::{Capture, View, from_view, from_views};
use crate::error::Error;

mod answer;
mod header;

/// All messages of the answer, packed as they are taken.
pub(super) async fn deproject(
    permit: OwnedSemaphorePermit,
    messages: Streaming<api::DeprojectDepthRequest>,
) -> Result<impl Iterator<Item = api::DeprojectDepthResponse> + Send, Status> {
    let images = Images::receive(messages).await?;
    let with_details = images.announced.with_details;
    let budget = Budget::default();
    // Dropped with the call's future: when the client goes or its deadline passes.
    let raised = RaisedOnDrop(budget.clone());
    let answer = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        images.deproject(&budget)
    })
    .await
    .map_err(|error| Status::internal(format!("the deprojection failed: {error}")))??;
    drop(raised);
    tracing::info!(
        points = answer.points.len(),
        report = ?answer.report.dropped,
        "deprojected"
    );
    Ok(answer.messages(with_details))
}

struct RaisedOnDrop(Budget);

impl Drop for RaisedOnDrop {
    fn drop(&mut self) {
        self.0.cancel();
    }
}

/// What came: as much as was announced.
struct Images {
    announced: Announced,
    depth: Vec<u16>,
    mask: Vec<u8>,
}

impl Images {
    async fn receive(mut messages: Streaming<api::DeprojectDepthRequest>) -> Result<Self, Status> {
        use api::deproject_depth_request::Payload;
        let Some(Payload::Header(header)) = messages.message().await?.and_then(|m| m.payload)
        else {
            return Err(invalid("header", "must come in the first message"));
        };
        let announced = Announced::read(header)?;
        let (depth_bytes, mask_bytes) = (announced.depth_bytes(), announced.mask_bytes());
        let (mut depth, mut mask) = (DepthChunks::default(), Vec::new());
        while let Some(message) = messages.message().await? {
            match message.payload {
                Some(Payload::Depth(bytes)) => {
                    count_in("depth", depth.received, bytes.len(), depth_bytes)?;
                    depth.push(&bytes);
                }
                Some(Payload::Mask(bytes)) => {
                    count_in("mask", mask.len(), bytes.len(), mask_bytes)?;
                    mask.extend_from_slice(&bytes);
                }
                Some(Payload::Header(_)) => {
                    return Err(invalid("header", "must come once, in the first message"));
                }
                None => return Err(invalid("payload", "is not set")),
            }
        }
        complete("depth", depth.received, depth_bytes)?;
        complete("mask", mask.len(), mask_bytes)?;
        Ok(Self {
            announced,
            depth: depth.values,
            mask,
        })
    }

    fn deproject(&self, budget: &Budget) -> Result<Answer, Error> {
        let options = &self.announced.options;
        let Some(poses) = &self.announced.base_from_camera else {
            return from_view(&self.capture(0), options, budget).map(Answer::in_camera);
        };
        let views: Vec<View<'_, Base>> = poses
            .iter()
            .enumerate()
            .map(
                |(view, base_from_camera): (usize, &Rigid<Base, Camera>)| View {
                    f_from_camera: *base_from_camera,
                    capture: self.capture(view),
                },
            )
            .collect();
        from_views(&views, options, budget).map(Answer::in_base)
    }

    /// What one viewpoint took.
    fn capture(&self, view: usize) -> Capture<'_> {
        let (pixels, frames) = (self.announced.pixels(), self.announced.frames);
        Capture {
            frames: self
                .depth
                .chunks_exact(pixels)
                .skip(view * frames)
                .take(frames)
                .map(|depth| Frame {
                    lens: &self.announced.lens,
                    depth_unit_mm: self.announced.depth_unit_mm,
                    depth,
                })
                .collect(),
            mask: self.mask.chunks_exact(pixels).nth(view),
        }
    }
}

/// Depth values under way; a chunk may end in the middle of one.
#[derive(Default)]
struct DepthChunks {
    received: usize,
    low_byte: Option<u8>,
    values: Vec<u16>,
}

impl DepthChunks {
    fn push(&mut self, mut bytes: &[u8]) {
        self.received += bytes.len();
        if let (Some(low), Some((high, rest))) = (self.low_byte, bytes.split_first()) {
            self.values.push(u16::from_le_bytes([low, *high]));
            self.low_byte = None;
            bytes = rest;
        }
        let pairs = bytes.chunks_exact(2);
        if let [low] = pairs.remainder() {
            self.low_byte = Some(*low);
        }
        self.values
            .extend(pairs.map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_values_cut_anywhere_come_out_whole() {
        let expected: Vec<u16> = (0..20).map(|i| i * 3001).collect();
        let bytes: Vec<u8> = expected.iter().flat_map(|v| v.to_le_bytes()).collect();
        for size in 1..bytes.len() {
            let mut chunks = DepthChunks::default();
            for chunk in bytes.chunks(size) {
                chunks.push(chunk);
                chunks.push(&[]);
            }
            assert_eq!(chunks.values, expected, "chunks of {size}");
            assert_eq!(chunks.received, bytes.len());
        }
    }
}
