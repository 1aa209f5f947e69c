//! Receives clouds and images in chunks: refused by their header before anything is buffered, and never more than announced.

use arthro_bootstrap::status::{invalid, invalid_all};
use arthro_geometry::{Cloud, Point3};
use arthro_proto::common::v1::{CloudHeader, Frame};
use arthro_proto::registration::v1 as api;
use tonic::{Status, Streaming};

use crate::depth::{self, Intrinsics};
use crate::error::{Error, Violation};
use crate::input;
use crate::pipeline::Options;

/// What a registration starts from.
pub(super) struct Upload {
    pub(super) source: Cloud,
    pub(super) target: Cloud,
    pub(super) options: Options,
}

/// What a deprojection starts from.
pub(super) struct DepthImage {
    pub(super) intrinsics: Intrinsics,
    pub(super) depth_unit_mm: f64,
    pub(super) depth: Vec<u16>,
    pub(super) mask: Option<Vec<u8>>,
}

pub(super) async fn registration(
    mut messages: Streaming<api::RegisterRequest>,
) -> Result<Upload, Status> {
    use api::register_request::Payload;
    let Some(Payload::Options(announced)) = messages.message().await?.and_then(|m| m.payload)
    else {
        return Err(invalid("options", "must come in the first message"));
    };
    let (options, mut source, mut target) = announced_clouds(announced)?;
    while let Some(message) = messages.message().await? {
        match message.payload {
            Some(Payload::Source(bytes)) if target.received == 0 => source.push(&bytes)?,
            Some(Payload::Source(_)) => {
                return Err(invalid(
                    "source",
                    "must be complete before the first target chunk",
                ));
            }
            Some(Payload::Target(bytes)) => target.push(&bytes)?,
            Some(Payload::Options(_)) => {
                return Err(invalid("options", "must come once, in the first message"));
            }
            None => return Err(invalid("payload", "is not set")),
        }
    }
    Ok(Upload {
        source: source.finish()?,
        target: target.finish()?,
        options,
    })
}

/// Checks all that the first message says.
fn announced_clouds(
    announced: api::RegisterOptions,
) -> Result<(Options, CloudChunks, CloudChunks), Status> {
    let mut violations = Vec::new();
    let source = announced.source.unwrap_or_default();
    let target = announced.target.unwrap_or_default();
    for (field, header, frames) in [
        ("source", &source, &[Frame::Ct][..]),
        ("target", &target, &[Frame::Camera, Frame::Base][..]),
    ] {
        if !frames.contains(&header.frame()) {
            let names: Vec<&str> = frames.iter().map(Frame::as_str_name).collect();
            violations.push(Violation::new(
                format!("options.{field}.frame"),
                format!(
                    "is {}, must be {}",
                    header.frame().as_str_name(),
                    names.join(" or ")
                ),
            ));
        }
        violations.extend(input::count_violation(
            &format!("options.{field}.point_count"),
            header.point_count as usize,
        ));
    }
    let known = Options::default();
    let or = |value: f64, default: f64| if value == 0.0 { default } else { value };
    let options = Options {
        scale_prior: or(announced.scale_prior, known.scale_prior),
        scale_tolerance: or(announced.scale_tolerance, known.scale_tolerance),
        viewpoint: match announced.viewpoint {
            Some(point) => Some(Point3::new(point.x_mm, point.y_mm, point.z_mm)),
            None if target.frame() == Frame::Camera => Some(Point3::origin()),
            None => None,
        },
        seed: announced.seed,
    };
    violations.extend(
        input::options_violations(&options)
            .into_iter()
            .map(|v| Violation::new(format!("options.{}", v.field), v.description)),
    );
    if !violations.is_empty() {
        return Err(Error::Invalid(violations).into());
    }
    Ok((
        options,
        CloudChunks::new("source", &source),
        CloudChunks::new("target", &target),
    ))
}

/// A cloud under way. Normals are accepted and left out: the registration fits its own.
struct CloudChunks {
    field: &'static str,
    announced: usize,
    point_bytes: usize,
    received: usize,
    /// The beginning of a point whose end is in the next chunk.
    pending: Vec<u8>,
    points: Vec<Point3>,
}

impl CloudChunks {
    fn new(field: &'static str, header: &CloudHeader) -> Self {
        Self {
            field,
            announced: header.point_count as usize,
            point_bytes: if header.has_normals { 24 } else { 12 },
            received: 0,
            pending: Vec::new(),
            points: Vec::new(),
        }
    }

    fn push(&mut self, mut bytes: &[u8]) -> Result<(), Status> {
        self.received = count_in(
            self.field,
            self.received,
            bytes.len(),
            self.announced * self.point_bytes,
        )?;
        if !self.pending.is_empty() {
            let missing = (self.point_bytes - self.pending.len()).min(bytes.len());
            self.pending.extend_from_slice(&bytes[..missing]);
            bytes = &bytes[missing..];
            if self.pending.len() < self.point_bytes {
                return Ok(());
            }
            self.points.push(unpack(&self.pending));
            self.pending.clear();
        }
        let whole = bytes.chunks_exact(self.point_bytes);
        self.pending.extend_from_slice(whole.remainder());
        self.points.extend(whole.map(unpack));
        Ok(())
    }

    fn finish(self) -> Result<Cloud, Status> {
        complete(self.field, self.received, self.announced * self.point_bytes)?;
        Ok(Cloud::new(self.points))
    }
}

/// A point from its first twelve bytes: three little-endian float32.
fn unpack(bytes: &[u8]) -> Point3 {
    let value = |at: usize| {
        let word = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        f64::from(f32::from_le_bytes(word))
    };
    Point3::new(value(0), value(4), value(8))
}

pub(super) async fn depth(
    mut messages: Streaming<api::DeprojectDepthRequest>,
) -> Result<DepthImage, Status> {
    use api::deproject_depth_request::Payload;
    let Some(Payload::Header(header)) = messages.message().await?.and_then(|m| m.payload) else {
        return Err(invalid("header", "must come in the first message"));
    };
    let camera = header.intrinsics.unwrap_or_default();
    let intrinsics = Intrinsics {
        width_px: camera.width_px,
        height_px: camera.height_px,
        fx_px: camera.fx_px,
        fy_px: camera.fy_px,
        cx_px: camera.cx_px,
        cy_px: camera.cy_px,
    };
    let violations = depth::violations(&intrinsics, header.depth_unit_mm);
    if !violations.is_empty() {
        return Err(Error::Invalid(violations).into());
    }
    let pixels = intrinsics.width_px as usize * intrinsics.height_px as usize;
    let mask_bytes = if header.has_mask { pixels } else { 0 };
    let (mut depth, mut mask) = (Vec::new(), Vec::new());
    while let Some(message) = messages.message().await? {
        match message.payload {
            Some(Payload::Depth(bytes)) => {
                count_in("depth", depth.len(), bytes.len(), 2 * pixels)?;
                depth.extend_from_slice(&bytes);
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
    complete("depth", depth.len(), 2 * pixels)?;
    complete("mask", mask.len(), mask_bytes)?;
    Ok(DepthImage {
        intrinsics,
        depth_unit_mm: header.depth_unit_mm,
        depth: depth
            .chunks_exact(2)
            .map(|pixel| u16::from_le_bytes([pixel[0], pixel[1]]))
            .collect(),
        mask: header.has_mask.then_some(mask),
    })
}

/// Bytes received once `more` are in; refuses those beyond the announced ones before they are kept.
pub(super) fn count_in(
    field: &str,
    received: usize,
    more: usize,
    announced: usize,
) -> Result<usize, Status> {
    let total = received + more;
    if total > announced {
        return Err(invalid_all(vec![(
            field.to_owned(),
            format!("{total} bytes came, {announced} are announced"),
        )]));
    }
    Ok(total)
}

pub(super) fn complete(field: &str, received: usize, announced: usize) -> Result<(), Status> {
    if received < announced {
        return Err(invalid(
            field,
            format!("ended after {received} bytes, {announced} are announced"),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunks(count: u32, has_normals: bool) -> CloudChunks {
        CloudChunks::new(
            "target",
            &CloudHeader {
                frame: Frame::Camera.into(),
                point_count: count,
                has_normals,
            },
        )
    }

    #[test]
    fn points_cut_anywhere_come_out_whole() {
        let packed: Vec<u8> = (0..18).flat_map(|i| (i as f32).to_le_bytes()).collect();
        for size in 1..packed.len() {
            let mut cloud = chunks(3, true);
            for chunk in packed.chunks(size) {
                cloud.push(chunk).unwrap();
            }
            let points = cloud.finish().unwrap().points;
            assert_eq!(points[2], Point3::new(12.0, 13.0, 14.0), "chunks of {size}");
            assert_eq!(points.len(), 3);
        }
    }

    #[test]
    fn bytes_beyond_the_announced_ones_and_missing_ones_are_refused() {
        let mut cloud = chunks(2, false);
        cloud.push(&[0; 24]).unwrap();
        let refusal = cloud.push(&[0]).unwrap_err();
        assert!(
            refusal
                .message()
                .contains("25 bytes came, 24 are announced")
        );
        let mut cloud = chunks(2, false);
        cloud.push(&[0; 23]).unwrap();
        let refusal = cloud.finish().unwrap_err();
        assert!(refusal.message().contains("ended after 23 bytes"));
    }
}
