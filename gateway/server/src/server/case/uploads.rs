//! The two uploads of `CaseService`: header first, then chunks, refused from the header when too
//! large, and nothing kept unless everything passed.

use std::time::Duration;

use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::registration::v1 as registration;
use tokio::time::Instant;
use tonic::{Status, Streaming};

use super::super::{Violations, id, refuse};
use super::CaseApi;
use crate::aside::aside;
use crate::cases::Scene;
use crate::cases::case::Case;
use crate::cases::upload::{
    Announced, DEPTHS_MAX, PIXELS_MAX, POINTS_MAX, POINTS_MIN, TRIANGLES_MAX, VERTICES_MAX,
    check_count, check_extent, check_points, check_triangles, positions,
};
use crate::clients::planning::PackedModel;
use crate::error::{Error, Result as DomainResult, Violation};

/// Bytes of a packed point without and with normal, and of a packed triangle.
const POINT_BYTES: usize = 12;
const POINT_WITH_NORMAL_BYTES: usize = 24;
const TRIANGLE_BYTES: usize = 12;
/// Fewest vertices and triangles of a closed surface.
const CLOSED_SURFACE_MIN: u32 = 4;
/// An upload that sends nothing for this long is given up.
const SILENCE_LIMIT: Duration = Duration::from_secs(10);
/// The whole of an upload: 48 MB at 1.6 Mbit/s.
const UPLOAD_LIMIT: Duration = Duration::from_secs(240);
/// Coarsest grid of a lesion, mm.
const LESION_SPACING_MAX_MM: f64 = 10.0;

impl CaseApi {
    pub(super) async fn receive_model(
        &self,
        stream: Streaming<proto::UploadModelRequest>,
    ) -> Result<Case, Status> {
        let mut stream = Incoming::new(stream);
        use common::mesh_chunk::Part;
        use proto::upload_model_request::Payload;
        let Some(Payload::Header(header)) = stream.next().await?.and_then(|first| first.payload)
        else {
            return Err(refuse(header_missing()));
        };
        let model = CheckedModelHeader::read(header).map_err(refuse)?;
        // A wrong id is told before megabytes are sent.
        self.cases.get(&model.case_id).await.map_err(refuse)?;

        let mut vertices =
            Announced::new("mesh.vertices", model.vertex_count as usize * POINT_BYTES);
        let mut triangles = Announced::new(
            "mesh.triangles",
            model.triangle_count as usize * TRIANGLE_BYTES,
        );
        let mut lesion = Announced::new("lesion", model.lesion_count as usize * POINT_BYTES);
        while let Some(message) = stream.next().await? {
            match message.payload {
                Some(Payload::Mesh(chunk)) => match chunk.part {
                    Some(Part::Vertices(bytes)) => vertices.push(&bytes),
                    Some(Part::Triangles(bytes)) => triangles.push(&bytes),
                    None => Ok(()),
                },
                Some(Payload::Lesion(bytes)) => lesion.push(&bytes),
                Some(Payload::Header(_)) => Err(header_repeated()),
                None => Ok(()),
            }
            .map_err(refuse)?;
        }
        let vertex_count = model.vertex_count;
        let finish = move || -> DomainResult<PackedModel> {
            let packed = PackedModel {
                vertices: vertices.finish()?,
                triangles: triangles.finish()?,
                lesion: lesion.finish()?,
            };
            check_points("mesh.vertices", &packed.vertices, false)?;
            check_extent("mesh.vertices", &positions(&packed.vertices, false))?;
            check_triangles("mesh.triangles", &packed.triangles, vertex_count)?;
            check_points("lesion", &packed.lesion, false)?;
            Ok(packed)
        };
        let packed = aside(finish).await.map_err(refuse)?;
        self.cases
            .store_model(&model.case_id, packed, model.lesion_spacing_mm)
            .await
            .map_err(refuse)
    }

    pub(super) async fn receive_scene(
        &self,
        stream: Streaming<proto::UploadSceneRequest>,
    ) -> Result<Case, Status> {
        let mut stream = Incoming::new(stream);
        use proto::scene_header::Scene as Announcement;
        use proto::upload_scene_request::Payload;
        let Some(Payload::Header(header)) = stream.next().await?.and_then(|first| first.payload)
        else {
            return Err(refuse(header_missing()));
        };
        let case_id = id("header.case_id", header.case_id).map_err(refuse)?;
        let announcement = header.scene.ok_or_else(|| {
            refuse(Error::invalid(
                "header.scene",
                "is missing; must be cloud or depth",
            ))
        })?;
        let (points_bytes, depth_bytes, mask_bytes) =
            announced_bytes(&announcement).map_err(refuse)?;
        self.cases.get(&case_id).await.map_err(refuse)?;

        let mut points = Announced::new("points", points_bytes);
        let mut depth = Announced::new("depth", depth_bytes);
        let mut mask = Announced::new("mask", mask_bytes);
        while let Some(message) = stream.next().await? {
            match message.payload {
                Some(Payload::Points(bytes)) => points.push(&bytes),
                Some(Payload::Depth(bytes)) => depth.push(&bytes),
                Some(Payload::Mask(bytes)) => mask.push(&bytes),
                Some(Payload::Header(_)) => Err(header_repeated()),
                None => Ok(()),
            }
            .map_err(refuse)?;
        }
        let points = points.finish().map_err(refuse)?;
        let depth = depth.finish().map_err(refuse)?;
        let mask = mask.finish().map_err(refuse)?;
        let scene = match announcement {
            Announcement::Cloud(cloud) => Scene {
                point_count: cloud.point_count,
                has_normals: cloud.has_normals,
                points,
            },
            Announcement::Depth(header) => {
                self.deproject(header, depth, mask).await.map_err(refuse)?
            }
        };
        let scene = aside(move || -> DomainResult<Scene> {
            check_points("points", &scene.points, scene.has_normals)?;
            check_extent("points", &positions(&scene.points, scene.has_normals))?;
            Ok(scene)
        })
        .await
        .map_err(refuse)?;
        self.cases
            .store_scene(&case_id, scene)
            .await
            .map_err(refuse)
    }

    async fn deproject(
        &self,
        header: registration::DepthHeader,
        depth: bytes::Bytes,
        mask: bytes::Bytes,
    ) -> DomainResult<Scene> {
        let most = POINTS_MAX as usize * POINT_WITH_NORMAL_BYTES;
        let cloud = self
            .clients
            .registration
            .deproject(header, depth, mask, most)
            .await?;
        check_count("depth.points", cloud.point_count, POINTS_MIN, POINTS_MAX)?;
        let expected = cloud.point_count as usize * point_bytes(cloud.has_normals);
        if cloud.points.len() != expected {
            return Err(Error::invalid(
                "depth.points",
                format!("holds {} bytes; must hold {expected}", cloud.points.len()),
            ));
        }
        Ok(Scene {
            point_count: cloud.point_count,
            has_normals: cloud.has_normals,
            points: cloud.points,
        })
    }
}

/// A client's messages, each of which must come in time: an upload that says nothing would keep others out.
struct Incoming<M> {
    stream: Streaming<M>,
    ends: Instant,
}

impl<M> Incoming<M> {
    fn new(stream: Streaming<M>) -> Self {
        Self {
            stream,
            ends: Instant::now() + UPLOAD_LIMIT,
        }
    }

    async fn next(&mut self) -> Result<Option<M>, Status> {
        let limit = self.ends.min(Instant::now() + SILENCE_LIMIT);
        match tokio::time::timeout_at(limit, self.stream.message()).await {
            Ok(message) => message,
            Err(_) => Err(refuse(Error::UploadTooSlow {
                silence_s: SILENCE_LIMIT.as_secs(),
                whole_s: UPLOAD_LIMIT.as_secs(),
            })),
        }
    }
}

/// A model's header that passed its checks.
struct CheckedModelHeader {
    case_id: String,
    vertex_count: u32,
    triangle_count: u32,
    lesion_count: u32,
    lesion_spacing_mm: f64,
}

impl CheckedModelHeader {
    fn read(header: proto::ModelHeader) -> DomainResult<Self> {
        let mut violations = Violations::default();
        let case_id = violations.check(id("header.case_id", header.case_id));
        let mesh = header.mesh.unwrap_or_default();
        violations.check(check_frame(
            "header.mesh.frame",
            mesh.frame(),
            common::Frame::Ct,
        ));
        violations.check(check_count(
            "header.mesh.vertex_count",
            mesh.vertex_count,
            CLOSED_SURFACE_MIN,
            VERTICES_MAX,
        ));
        violations.check(check_count(
            "header.mesh.triangle_count",
            mesh.triangle_count,
            CLOSED_SURFACE_MIN,
            TRIANGLES_MAX,
        ));
        if let Some(lesion) = &header.lesion {
            violations.check(check_frame(
                "header.lesion.frame",
                lesion.frame(),
                common::Frame::Ct,
            ));
            violations.check(check_count(
                "header.lesion.point_count",
                lesion.point_count,
                0,
                POINTS_MAX,
            ));
            if lesion.has_normals {
                violations.check::<()>(Err(Violation::new(
                    "header.lesion.has_normals",
                    "is true; points inside tissue have no normals",
                )));
            }
        }
        if !(0.0..=LESION_SPACING_MAX_MM).contains(&header.lesion_spacing_mm) {
            violations.check::<()>(Err(Violation::new(
                "header.lesion_spacing_mm",
                format!(
                    "is {} mm; must be within 0 .. {LESION_SPACING_MAX_MM} mm",
                    header.lesion_spacing_mm
                ),
            )));
        }
        violations.finish()?;
        Ok(Self {
            case_id: case_id.unwrap_or_default(),
            vertex_count: mesh.vertex_count,
            triangle_count: mesh.triangle_count,
            lesion_count: header.lesion.map_or(0, |lesion| lesion.point_count),
            lesion_spacing_mm: header.lesion_spacing_mm,
        })
    }
}

/// Bytes of points, depth and mask that a scene's header announces.
fn announced_bytes(
    announcement: &proto::scene_header::Scene,
) -> DomainResult<(usize, usize, usize)> {
    use proto::scene_header::Scene as Announcement;
    match announcement {
        Announcement::Cloud(cloud) => {
            let mut violations = Violations::default();
            violations.check(check_frame(
                "header.cloud.frame",
                cloud.frame(),
                common::Frame::Camera,
            ));
            violations.check(check_count(
                "header.cloud.point_count",
                cloud.point_count,
                POINTS_MIN,
                POINTS_MAX,
            ));
            violations.finish()?;
            let bytes = cloud.point_count as usize * point_bytes(cloud.has_normals);
            Ok((bytes, 0, 0))
        }
        Announcement::Depth(depth) => {
            let intrinsics = depth.intrinsics.unwrap_or_default();
            let pixels = u64::from(intrinsics.width_px) * u64::from(intrinsics.height_px);
            if !(1..=PIXELS_MAX).contains(&pixels) {
                return Err(Error::invalid(
                    "header.depth.intrinsics",
                    format!("is an image of {pixels} pixels; must be within 1 .. {PIXELS_MAX}"),
                ));
            }
            if !depth.views.is_empty() {
                return Err(Error::invalid(
                    "header.depth.views",
                    format!(
                        "has {} viewpoints; must have none: a scene is in camera",
                        depth.views.len()
                    ),
                ));
            }
            let depths = pixels * u64::from(depth.frame_count.max(1));
            if depths > DEPTHS_MAX {
                return Err(Error::invalid(
                    "header.depth.frame_count",
                    format!("makes {depths} depth values; must make at most {DEPTHS_MAX}"),
                ));
            }
            let [pixels, depths] =
                [pixels, depths].map(|count| usize::try_from(count).unwrap_or(usize::MAX / 2));
            Ok((0, 2 * depths, if depth.has_mask { pixels } else { 0 }))
        }
    }
}

fn point_bytes(has_normals: bool) -> usize {
    if has_normals {
        POINT_WITH_NORMAL_BYTES
    } else {
        POINT_BYTES
    }
}

fn check_frame(field: &str, given: common::Frame, needed: common::Frame) -> Result<(), Violation> {
    if given == needed {
        return Ok(());
    }
    Err(Violation::new(
        field,
        format!(
            "is {}; must be {}",
            given.as_str_name(),
            needed.as_str_name()
        ),
    ))
}

fn header_missing() -> Error {
    Error::invalid("header", "is missing; it must be the first message")
}

fn header_repeated() -> Error {
    Error::invalid(
        "header",
        "was sent twice; it must be the first message only",
    )
}
