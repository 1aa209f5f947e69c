//! Who is on the bus.

use std::collections::BTreeMap;
use std::sync::Arc;

use epos4_link::canopen::object::Address;
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::cia402::Statusword;
use epos4_link::network::{self, Node};
use epos4_link::objects;
use serde_json::{Value, json};
use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use super::session::Session;
use crate::arguments::Can;
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// Node ids of CANopen.
const NODE_IDS: std::ops::RangeInclusive<u8> = 1..=127;
/// How many nodes are asked at once: fewer than the bus queues.
const ASKED_AT_ONCE: usize = 16;
const DEVICE_NAME: Address = Address::new(0x1008, 0);

/// Asks every node id and prints who answers.
pub async fn show(can: &Can, output: &Output) -> Result<(), Failure> {
    let session = Session::open(can, output).await?;
    let mut listening = session.listen();
    let answering = answering(&session).await?;
    let mut states: BTreeMap<u8, nmt::State> = BTreeMap::new();
    while let Ok(stamped) = listening.try_recv() {
        states.extend(heartbeat::decode(&stamped.frame));
    }
    let mut described = Vec::new();
    for node_id in &answering {
        let state = states.get(node_id).copied();
        described.push(describe(&session, *node_id, state).await?);
    }
    let silent = states.keys().filter(|node_id| !answering.contains(node_id));
    described.extend(silent.map(|node_id| {
        json!({
            "node": node_id,
            "nmt_state": states[node_id].to_string(),
            "detail": "sends heartbeats and answers no SDO: a master, or a stopped node",
        })
    }));
    if described.is_empty() {
        let fault = format!(
            "no node answers on {} within {} ms: look at wiring, supply and bit rate",
            can.bus, can.answer_ms
        );
        return Err(Failure::new(Kind::Unreachable, "NO_NODES", fault));
    }
    for node in &described {
        output.line(line(node));
    }
    output.result(&json!({"nodes": described, "other_master": session.other_master()}));
    Ok(())
}

/// The nodes that have an SDO server, by rising id.
pub async fn answering(session: &Session) -> Result<Vec<u8>, Failure> {
    let places = Arc::new(Semaphore::new(ASKED_AT_ONCE));
    let mut asked = JoinSet::new();
    for node_id in NODE_IDS {
        let (node, places) = (session.node(node_id), Arc::clone(&places));
        asked.spawn(async move {
            let _place = places.acquire_owned().await;
            (node_id, node.read(objects::DEVICE_TYPE).await)
        });
    }
    let mut found = Vec::new();
    while let Some(answer) = asked.join_next().await {
        match answer.map_err(|error| Failure::failed("RUNTIME", error))? {
            (_, Err(network::Error::NoAnswer { .. })) => {}
            (_, Err(error @ network::Error::Gone)) => return Err(session.failure(&error)),
            // A node that refuses is there too.
            (node_id, _) => found.push(node_id),
        }
    }
    found.sort_unstable();
    Ok(found)
}

async fn describe(
    session: &Session,
    node_id: u8,
    heard: Option<nmt::State>,
) -> Result<Value, Failure> {
    let node = session.node(node_id);
    let known = |result: Result<u32, network::Error>| match result {
        Ok(value) => Ok(Some(value)),
        // Other devices lack objects that a drive has.
        Err(error) if error.abort_code().is_some() => Ok(None),
        Err(error) => Err(session.failure(&error)),
    };
    let vendor = known(node.read(objects::VENDOR_ID).await)?;
    let product = known(node.read(objects::PRODUCT_CODE).await)?;
    let revision = known(node.read(objects::REVISION_NUMBER).await)?;
    let serial = known(node.read(objects::SERIAL_NUMBER).await)?;
    let statusword = known(node.read(objects::STATUSWORD).await.map(u32::from))?;
    let name = device_name(&node).await;
    let state = statusword.and_then(|word| Statusword(word as u16).state());
    Ok(json!({
        "node": node_id,
        "name": name,
        "vendor": vendor,
        "product": product,
        "revision": revision,
        "serial": serial,
        "nmt_state": heard.map(|state| state.to_string()),
        "drive_state": state.map(|state| state.to_string()),
    }))
}

/// 0x1008; `None` for a device without it.
async fn device_name(node: &Node) -> Option<String> {
    let reading = node.read_bytes(DEVICE_NAME).await.ok()?;
    Some(String::from_utf8_lossy(&reading.value).into_owned())
}

fn line(node: &Value) -> String {
    let word = |key: &str| node[key].as_str().unwrap_or("-").to_owned();
    let code = |key: &str| {
        node[key]
            .as_u64()
            .map_or_else(|| "-".to_owned(), |code| format!("0x{code:08X}"))
    };
    if let Some(detail) = node["detail"].as_str() {
        return format!("node {:>3}  {}  {detail}", node["node"], word("nmt_state"));
    }
    format!(
        "node {:>3}  {}  vendor {}  product {}  revision {}  serial {}  {}  {}",
        node["node"],
        word("name"),
        code("vendor"),
        code("product"),
        code("revision"),
        node["serial"],
        node["nmt_state"].as_str().unwrap_or("no heartbeat"),
        word("drive_state"),
    )
}
