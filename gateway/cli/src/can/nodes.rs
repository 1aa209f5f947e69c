//! Who is on the bus.

use std::collections::BTreeMap;
use std::time::Duration;

use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::cia402::{State, Statusword};
use epos4_link::network::Found;
use epos4_link::objects;
use serde_json::{Value, json};

use super::session::Session;
use crate::arguments::Can;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// Node ids of CANopen.
const NODE_IDS: std::ops::RangeInclusive<u8> = 1..=127;

/// Asks every node id and prints who answers.
pub async fn show(can: &Can, output: &Output) -> Result<(), Failure> {
    let session = Session::open(can, output).await?;
    let mut listening = session.listen();
    let found = answering(can, &session).await?;
    let mut heard: BTreeMap<u8, nmt::State> = BTreeMap::new();
    while let Ok(stamped) = listening.try_recv() {
        heard.extend(heartbeat::decode(&stamped.frame));
    }
    let mut nodes = Vec::new();
    for node in &found {
        let drive_state = drive_state(&session, node.node_id).await?;
        nodes.push(described(node, heard.remove(&node.node_id), drive_state));
    }
    nodes.extend(heard.iter().map(|(node_id, state)| {
        json!({
            "node": node_id,
            "nmt_state": state.to_string(),
            "detail": "sends heartbeats and answers no SDO: a master, or a stopped node",
        })
    }));
    for node in &nodes {
        output.line(line(node));
    }
    output.result(&json!({"nodes": nodes, "other_master": session.other_master()}));
    Ok(())
}

/// The nodes that have an SDO server, by rising id. A bus without any is refused.
pub async fn answering(can: &Can, session: &Session) -> Result<Vec<Found>, Failure> {
    let timeout = Duration::from_millis(can.answer_ms);
    let found = session
        .nodes()
        .scan(NODE_IDS, timeout)
        .await
        .map_err(|error| session.failure(&error))?;
    if found.is_empty() {
        let fault = format!(
            "no node answers on {} within {} ms: look at wiring, supply and bit rate",
            can.bus, can.answer_ms
        );
        return Err(Failure::new(Kind::Unreachable, "NO_NODES", fault));
    }
    Ok(found)
}

/// `None` for a device that is no drive.
async fn drive_state(session: &Session, node_id: u8) -> Result<Option<State>, Failure> {
    match session.node(node_id).read(objects::STATUSWORD).await {
        Ok(statusword) => Ok(Statusword(statusword).state()),
        Err(error) if error.abort_code().is_some() => Ok(None),
        Err(error) => Err(session.failure(&error)),
    }
}

fn described(node: &Found, heard: Option<nmt::State>, drive_state: Option<State>) -> Value {
    json!({
        "node": node.node_id,
        "name": node.device_name,
        "vendor": node.identity.vendor_id,
        "product": node.identity.product_code,
        "revision": node.identity.revision,
        "serial": node.identity.serial_number,
        "nmt_state": heard.map(|state| state.to_string()),
        "drive_state": drive_state.map(|state| state.to_string()),
    })
}

fn line(node: &Value) -> String {
    let word = |key: &str, otherwise: &str| node[key].as_str().unwrap_or(otherwise).to_owned();
    if let Some(detail) = node["detail"].as_str() {
        return format!(
            "node {:>3}  {}  {detail}",
            node["node"],
            word("nmt_state", "-")
        );
    }
    let code = |key: &str| node[key].as_u64().unwrap_or(0);
    format!(
        "node {:>3}  {}  vendor 0x{:08X}  product 0x{:08X}  revision 0x{:08X}  serial 0x{:08X}  {}  {}",
        node["node"],
        word("name", "-"),
        code("vendor"),
        code("product"),
        code("revision"),
        code("serial"),
        word("nmt_state", "no heartbeat"),
        word("drive_state", "no drive"),
    )
}
