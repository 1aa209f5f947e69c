//! A depth cloud as messages.

use arthro_geometry::Point3;
use arthro_geometry::frame::{Base, Camera, Frame as CellFrame};
use arthro_proto::common::v1::{CloudHeader, Direction, Frame, Point};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::deproject_depth_response::Payload;

use crate::depth::deproject::SeenPoint;
use crate::depth::plane::RemovedPlane;
use crate::depth::{DepthCloud, Report};

/// A depth cloud whose frame is a value.
pub(super) struct Answer {
    frame: Frame,
    pub(super) points: Vec<SeenPoint>,
    viewpoints: Vec<Point3>,
    pub(super) report: Report,
}

/// Most bytes of a chunk.
const CHUNK_BYTES: usize = 256 * 1024;
/// Position and normal: six float32.
const POINT_BYTES: usize = 24;
/// Two float32 and two uint32.
const DETAIL_BYTES: usize = 16;

impl Answer {
    pub(super) fn in_camera(cloud: DepthCloud<Camera>) -> Self {
        Self::new(Frame::Camera, cloud)
    }

    pub(super) fn in_base(cloud: DepthCloud<Base>) -> Self {
        Self::new(Frame::Base, cloud)
    }

    fn new<F: CellFrame>(frame: Frame, cloud: DepthCloud<F>) -> Self {
        Self {
            frame,
            points: cloud.points,
            viewpoints: cloud.viewpoints,
            report: cloud.report,
        }
    }

    /// The header, then chunks that are packed as they are taken, then what else is asked for.
    pub(super) fn messages(
        self,
        with_details: bool,
    ) -> impl Iterator<Item = api::DeprojectDepthResponse> + Send {
        let header = Payload::Header(CloudHeader {
            frame: self.frame.into(),
            point_count: self.points.len() as u32,
            has_normals: true,
        });
        let report = with_details.then(|| Payload::Report(self.report_message()));
        let positions = (0..self.points.len()).step_by(CHUNK_BYTES / POINT_BYTES);
        let details = with_details
            .then(|| (0..self.points.len()).step_by(CHUNK_BYTES / DETAIL_BYTES))
            .into_iter()
            .flatten();
        let starts = positions
            .map(Start::Points)
            .chain(details.map(Start::Details));
        let points = self.points;
        let packed = starts.map(move |start| match start {
            Start::Points(first) => {
                Payload::Points(packed(&points[first..], POINT_BYTES, pack_point).into())
            }
            Start::Details(first) => {
                Payload::Details(packed(&points[first..], DETAIL_BYTES, pack_details).into())
            }
        });
        std::iter::once(header)
            .chain(packed)
            .chain(report)
            .map(|payload| api::DeprojectDepthResponse {
                payload: Some(payload),
            })
    }

    fn report_message(&self) -> api::DepthReport {
        let dropped = &self.report.dropped;
        api::DepthReport {
            clipped: self.report.clipped.iter().map(|c| *c as u32).collect(),
            without_depth: dropped.without_depth as u32,
            saturated: dropped.saturated as u32,
            out_of_range: dropped.out_of_range as u32,
            flying: dropped.flying as u32,
            strays: self.report.strays.len() as u32,
            planes: self.report.planes.iter().map(plane).collect(),
            viewpoints: self.viewpoints.iter().map(point).collect(),
        }
    }
}

/// Which point a chunk begins with.
enum Start {
    Points(usize),
    Details(usize),
}

/// The first points, as many as a chunk holds.
fn packed(points: &[SeenPoint], bytes: usize, pack: fn(&SeenPoint, &mut Vec<u8>)) -> Vec<u8> {
    let count = points.len().min(CHUNK_BYTES / bytes);
    let mut chunk = Vec::with_capacity(count * bytes);
    points[..count]
        .iter()
        .for_each(|point| pack(point, &mut chunk));
    chunk
}

fn pack_point(point: &SeenPoint, chunk: &mut Vec<u8>) {
    for value in point.position.iter().chain(point.normal.iter()) {
        chunk.extend_from_slice(&(*value as f32).to_le_bytes());
    }
}

fn pack_details(point: &SeenPoint, chunk: &mut Vec<u8>) {
    for value in [point.sigma_mm, point.normal_sigma_rad] {
        chunk.extend_from_slice(&(value as f32).to_le_bytes());
    }
    for value in [point.view, point.pixel] {
        chunk.extend_from_slice(&value.to_le_bytes());
    }
}

fn plane(plane: &RemovedPlane) -> api::RemovedPlane {
    api::RemovedPlane {
        normal: Some(Direction {
            x: plane.normal.x,
            y: plane.normal.y,
            z: plane.normal.z,
        }),
        offset_mm: plane.offset_mm,
        share: plane.share,
        rms_mm: plane.rms_mm,
        removed: plane.removed as u32,
    }
}

fn point(point: &Point3) -> Point {
    Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}
