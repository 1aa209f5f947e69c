//! Teaching: where an arm stands goes into a file, and portals and shafts come out of it.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange};
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::motion::v1::teaching_service_client::TeachingServiceClient;
use serde_json::{Value, json};

use super::HOLDER;
use super::taught::TaughtFile;
use crate::arguments::{Portal, Taught};
use crate::commanded::{Commanded, believed_tool, message, tool_at_rest, unusable};
use crate::commands::show;
use crate::connection;
use crate::exit::Failure;
use crate::output::Output;

/// Adds the measured flange once the arm is at rest.
pub async fn add(url: &str, taught: &Taught, output: &Output) -> Result<(), Failure> {
    let mut file = TaughtFile::read_or_begin(&taught.file)?;
    let arm = common::Arm::from(taught.arm);
    let mut client = MotionServiceClient::new(connection::open(url).await?);
    let tool = believed_tool(&mut client, arm).await?;
    let flange: Rigid<Base, Flange> = tool_at_rest(&mut client, arm).await? * tool.inverse();
    file.add(&message(&flange));
    file.write(&taught.file)?;
    output.line(format!("{} poses", file.len()));
    output.result(&json!({"poses": file.len()}));
    Ok(())
}

/// Solves the portal and states it if asked to.
pub async fn portal(url: &str, portal: &Portal, output: &Output) -> Result<(), Failure> {
    let taught = &portal.taught;
    let request = motion::SolvePortalRequest {
        arm: common::Arm::from(taught.arm).into(),
        poses: TaughtFile::read(&taught.file)?.messages(),
        ..motion::SolvePortalRequest::default()
    };
    let mut client = TeachingServiceClient::new(connection::open(url).await?);
    let found = client.solve_portal(request).await?.into_inner();
    let place = found.portal.ok_or_else(|| unusable("no portal was sent"))?;
    if portal.set {
        let mut commanded = Commanded::take(url, HOLDER).await?;
        let outcome = commanded
            .set_portal(taught.arm.into(), place, found.axis)
            .await;
        let released = commanded.release().await;
        outcome?;
        released?;
    }
    let value = json!({
        "portal_mm": point(Some(place)),
        "axis": found.axis.map(|axis| [axis.x, axis.y, axis.z]),
        "portal_deviation_mm": found.portal_deviation_mm,
        "portal_covariance_mm2": found.portal_covariance_mm2,
        "residual_rms_mm": found.residual_rms_mm,
        "spread_deg": found.spread_rad.to_degrees(),
        "lines": lines(&found.lines),
        "set": portal.set,
    });
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

/// Solves the shaft's line in the flange.
pub async fn shaft(url: &str, taught: &Taught, output: &Output) -> Result<(), Failure> {
    let request = motion::CalibrateShaftRequest {
        arm: common::Arm::from(taught.arm).into(),
        poses: TaughtFile::read(&taught.file)?.messages(),
        ..motion::CalibrateShaftRequest::default()
    };
    let mut client = TeachingServiceClient::new(connection::open(url).await?);
    let found = client.calibrate_shaft(request).await?.into_inner();
    let tool = found.flange_from_tool.unwrap_or_default();
    let rotation = tool.rotation.unwrap_or_default();
    let value = json!({
        "flange_from_tool": {
            "translation_mm": point(tool.translation),
            "rotation_wxyz": [rotation.w, rotation.x, rotation.y, rotation.z],
        },
        "correction_deg": found.correction_rad.to_degrees(),
        "configured_residual_rms_mm": found.configured_residual_rms_mm,
        "residual_rms_mm": found.residual_rms_mm,
        "direction_deviation_deg": found.direction_deviation_rad.to_degrees(),
        "direction_covariance_rad2": found.direction_covariance_rad2,
        "point_covariance_mm2": found.point_covariance_mm2,
        "portal_mm": point(found.portal),
        "portal_covariance_mm2": found.portal_covariance_mm2,
        "lines": lines(&found.lines),
    });
    output.line(show::table(&value));
    output.result(&value);
    Ok(())
}

fn lines(lines: &[motion::TaughtLine]) -> Vec<Value> {
    let line = |line: &motion::TaughtLine| {
        json!({
            "distance_mm": line.distance_mm,
            "deviations": line.deviations,
            "depth_mm": line.depth_mm,
        })
    };
    lines.iter().map(line).collect()
}

fn point(point: Option<common::Point>) -> [f64; 3] {
    let point = point.unwrap_or_default();
    [point.x_mm, point.y_mm, point.z_mm]
}
