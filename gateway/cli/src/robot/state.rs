//! What was measured of both arms, once or again and again.

use arthro_proto::motion::v1 as motion;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use serde_json::{Value, json};

use crate::arguments::RobotState;
use crate::commanded::unusable;
use crate::commands::show;
use crate::connection;
use crate::exit::Failure;
use crate::output::Output;

/// Controller time between two lines, s.
const WATCH_PERIOD_S: f64 = 1.0;

/// Shows the cell and the arms.
pub async fn show(url: &str, arguments: &RobotState, output: &Output) -> Result<(), Failure> {
    let mut client = MotionServiceClient::new(connection::open(url).await?);
    let cell = client
        .get_cell(motion::GetCellRequest {})
        .await?
        .into_inner();
    let request = motion::WatchStateRequest {
        period_s: WATCH_PERIOD_S,
    };
    let mut states = client.watch_state(request).await?.into_inner();
    let first = states
        .message()
        .await?
        .ok_or_else(|| unusable("no state was sent"))?;
    let value = json!({
        "commander": cell.lease.as_ref().map(|lease| lease.holder.clone()),
        "arms": cell.arms.iter().map(|arm| described(arm, &first)).collect::<Vec<_>>(),
    });
    for arm in value["arms"].as_array().into_iter().flatten() {
        output.line(show::table(arm));
        output.line("");
    }
    if !arguments.watch {
        output.result(&value);
        return Ok(());
    }
    while let Some(state) = states.message().await? {
        for arm in &state.arms {
            output.line(line(arm));
        }
        let arms: Vec<_> = state.arms.iter().map(self::value).collect();
        output.result(&json!({ "arms": arms }));
    }
    Ok(())
}

/// What an arm is, with what was measured of it.
fn described(arm: &motion::ArmDescription, states: &motion::WatchStateResponse) -> Value {
    let measured = states.arms.iter().find(|state| state.arm == arm.arm);
    let mut shown = measured.map_or_else(|| json!({}), value);
    shown["arm"] = json!(name(arm.arm()));
    shown["address"] = json!(arm.address);
    shown["controller"] = json!(arm.controller);
    shown["connected"] = json!(arm.connected);
    shown["portal_mm"] =
        json!(
            arm.portal
                .as_ref()
                .map(|portal| [portal.x_mm, portal.y_mm, portal.z_mm])
        );
    shown
}

/// An arm's state for programs.
pub fn value(state: &motion::ArmState) -> Value {
    let pose = state.base_from_tool.unwrap_or_default();
    let tip = pose.translation.unwrap_or_default();
    json!({
        "arm": name(state.arm()),
        "robot_mode": state.robot_mode,
        "safety_mode": state.safety_mode,
        "controller_time_s": state.controller_time_s,
        "joints_rad": state.joints_rad,
        "tip_mm": [tip.x_mm, tip.y_mm, tip.z_mm],
        "moving": state.moving,
        "inside": state.inside,
        "depth_mm": state.depth_mm,
        "rcm_deviation_mm": state.rcm_deviation_mm,
        "speed_scaling": state.speed_scaling,
        "fault_reason": state.fault_reason,
        "fault_detail": state.fault_detail,
    })
}

fn line(state: &motion::ArmState) -> String {
    let joints: Vec<_> = state
        .joints_rad
        .iter()
        .map(|joint| format!("{joint:8.4}"))
        .collect();
    let doing = match (state.fault_reason.as_str(), state.moving) {
        ("", true) => "moving",
        ("", false) => "standing",
        (fault, _) => fault,
    };
    format!(
        "{:<11} {:9.2} s  {} rad  {doing}",
        name(state.arm()),
        state.controller_time_s,
        joints.join(" ")
    )
}

fn name(arm: arthro_proto::common::v1::Arm) -> String {
    arm.as_str_name().trim_start_matches("ARM_").to_lowercase()
}
