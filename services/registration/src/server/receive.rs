//! Receives clouds in chunks: refused by their header before anything is buffered, and never more than announced.

use arthro_bootstrap::status::{invalid, invalid_all};
use arthro_geometry::{Cloud, Point3};
use arthro_proto::common::v1::{CloudHeader, Frame, Point};
use arthro_proto::registration::v1 as api;
use tonic::{Status, Streaming};

use crate::error::{Error, Violation};
use crate::input::{self, SCALES};
use crate::pipeline::{Method, Options};
use crate::scale::ScaleRange;

/// What a registration starts from.
pub(super) struct Upload {
    pub(super) source: Cloud,
    pub(super) target: Cloud,
    pub(super) options: Options,
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
    let scale = scale_range(&announced, &mut violations);
    let options = Options {
        method: match announced.method() {
            api::Method::Unspecified | api::Method::Robust => Method::Robust,
            api::Method::Paper => Method::Paper,
        },
        scale,
        target_region: announced.target_region.map(|region| {
            let corner = |point: Option<Point>| {
                let point = point.unwrap_or_default();
                Point3::new(point.x_mm, point.y_mm, point.z_mm)
            };
            (corner(region.min), corner(region.max))
        }),
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

/// The scales that may be answered: a range, or a prior with its tolerance.
fn scale_range(announced: &api::RegisterOptions, violations: &mut Vec<Violation>) -> ScaleRange {
    let or = |value: f64, default: f64| if value == 0.0 { default } else { value };
    let tolerance = or(announced.scale_tolerance, ScaleRange::KNOWN_TOLERANCE);
    if !(0.0..=MAX_SCALE_TOLERANCE).contains(&tolerance) {
        violations.push(Violation::new(
            "options.scale_tolerance",
            format!("is {tolerance}, must be 0 to {MAX_SCALE_TOLERANCE}"),
        ));
    }
    match announced.scale_range {
        Some(range) => {
            if announced.scale_prior != 0.0 || announced.scale_tolerance != 0.0 {
                violations.push(Violation::new(
                    "options.scale_range",
                    "is set beside scale_prior or scale_tolerance, must stand alone",
                ));
            }
            ScaleRange {
                low: range.low,
                high: range.high,
            }
        }
        None => {
            let prior = or(announced.scale_prior, 1.0);
            if !SCALES.contains(&prior) {
                let (least, most) = (SCALES.start(), SCALES.end());
                violations.push(Violation::new(
                    "options.scale_prior",
                    format!("is {prior}, must be {least} to {most}"),
                ));
                return ScaleRange::known(1.0);
            }
            ScaleRange::around(prior, tolerance)
        }
    }
}

/// Largest tolerance of the scale prior, as a fraction.
const MAX_SCALE_TOLERANCE: f64 = 0.5;

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
