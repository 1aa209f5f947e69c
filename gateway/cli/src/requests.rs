//! Uploads as JSON, one message a line, for clients that have no code of ours: `arthro requests ... | grpcurl -d @ ...`.
//!
//! The fields are those of the contract's own JSON; bytes are base64.

use std::io::Write as _;

use arthro_geometry::Cloud;
use arthro_geometry::ply;
use arthro_proto::common::v1::{Frame, mesh_chunk};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

use crate::arguments::{ModelRequests, Requests, SceneRequests};
use crate::commands::{read, stated, unreadable};
use crate::exit::Failure;
use crate::{scene, upload};

/// Prints the messages of one upload.
pub async fn run(requests: Requests) -> Result<(), Failure> {
    match requests {
        Requests::Model(arguments) => print(model(&arguments)?),
        Requests::Scene(arguments) => print(scene(&arguments).await?),
    }
}

/// Header, vertices, triangles, lesion.
fn model(arguments: &ModelRequests) -> Result<Vec<Value>, Failure> {
    let stated = stated(arguments.stated);
    let mesh = ply::read_mesh(&read(&arguments.model)?, stated)
        .map_err(|error| unreadable(&arguments.model, &error))?;
    let lesion = match &arguments.lesion {
        Some(path) => {
            ply::read_cloud(&read(path)?, stated).map_err(|error| unreadable(path, &error))?
        }
        None => Cloud::default(),
    };
    let mut header = json!({
        "case_id": arguments.case,
        "mesh": {
            "frame": Frame::Ct.as_str_name(),
            "vertex_count": mesh.vertices.len(),
            "triangle_count": mesh.triangles.len(),
        },
        "lesion_spacing_mm": arguments.lesion_spacing_mm,
    });
    if !lesion.points.is_empty() {
        header["lesion"] = json!({
            "frame": Frame::Ct.as_str_name(),
            "point_count": lesion.points.len(),
            "has_normals": !lesion.normals.is_empty(),
        });
    }
    let mut messages = vec![json!({ "header": header })];
    messages.extend(
        upload::mesh_chunks(&mesh)
            .filter_map(|chunk| chunk.part)
            .map(|part| match part {
                mesh_chunk::Part::Vertices(bytes) => json!({"mesh": {"vertices": packed(&bytes)}}),
                mesh_chunk::Part::Triangles(bytes) => {
                    json!({"mesh": {"triangles": packed(&bytes)}})
                }
            }),
    );
    messages.extend(upload::cloud_chunks(&lesion).map(|bytes| json!({"lesion": packed(&bytes)})));
    Ok(messages)
}

/// Header, depth, mask.
async fn scene(arguments: &SceneRequests) -> Result<Vec<Value>, Failure> {
    let frame = scene::capture(&arguments.simulator, arguments.seed).await?;
    let intrinsics = frame.header.intrinsics.unwrap_or_default();
    let header = json!({
        "case_id": arguments.case,
        "depth": {
            "intrinsics": {
                "width_px": intrinsics.width_px,
                "height_px": intrinsics.height_px,
                "fx_px": intrinsics.fx_px,
                "fy_px": intrinsics.fy_px,
                "cx_px": intrinsics.cx_px,
                "cy_px": intrinsics.cy_px,
            },
            "depth_unit_mm": frame.header.depth_unit_mm,
            "has_mask": frame.header.has_mask,
        },
    });
    let mut messages = vec![json!({ "header": header })];
    messages.extend(upload::chunks(frame.depth).map(|bytes| json!({"depth": packed(&bytes)})));
    messages.extend(upload::chunks(frame.mask).map(|bytes| json!({"mask": packed(&bytes)})));
    Ok(messages)
}

fn packed(bytes: &[u8]) -> String {
    BASE64_STANDARD.encode(bytes)
}

fn print(messages: Vec<Value>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    for message in messages {
        writeln!(out, "{message}")?;
    }
    Ok(out.flush()?)
}
