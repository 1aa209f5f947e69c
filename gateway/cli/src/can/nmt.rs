//! NMT commands, and what the heartbeats say to them.

use std::collections::BTreeMap;
use std::time::Duration;

use epos4_link::canopen::heartbeat;
use epos4_link::canopen::nmt::{Command, State};
use epos4_link::frame::Stamped;
use epos4_link::objects;
use serde_json::json;
use tokio::sync::broadcast::{Receiver, error::RecvError};
use tokio::time::{Instant, timeout_at};

use super::nodes;
use super::session::Session;
use crate::arguments::{Can, NmtCommand, NmtOrder, NmtTarget};
use crate::exit::Failure;
use crate::output::Output;

/// So many heartbeat periods may pass before a node tells its new state.
const PERIODS: u32 = 3;
/// Shorter waits would be a matter of load.
const WAIT_MIN: Duration = Duration::from_secs(1);
/// A drive starts within this.
const BOOT_UP_WAIT: Duration = Duration::from_secs(10);

/// Orders a state, and waits for the nodes that tell theirs.
pub async fn order(can: &Can, order: &NmtOrder, output: &Output) -> Result<(), Failure> {
    let session = Session::open(can, output).await?;
    let node_ids = match order.target {
        NmtTarget::Node(node_id) => vec![node_id],
        NmtTarget::All => nodes::answering(&session).await?,
    };
    let command = Command::from(order.command);
    let mut waits = BTreeMap::new();
    for node_id in &node_ids {
        waits.insert(*node_id, wait(&session, *node_id, command).await);
    }
    let mut listening = session.listen();
    for node_id in &node_ids {
        session
            .node(*node_id)
            .command(command)
            .await
            .map_err(|error| session.failure(&error))?;
    }
    let told = told(&mut listening, command, &waits).await;
    let mut nodes = Vec::new();
    for (node_id, wait) in &waits {
        let state = told.get(node_id).copied();
        output.line(match (state, wait) {
            (Some(state), _) => format!("node {node_id}: {state}"),
            (None, None) => {
                format!("node {node_id}: ordered; it sends no heartbeat that would tell")
            }
            (None, Some(_)) => format!("node {node_id}: not confirmed"),
        });
        nodes.push(json!({
            "node": node_id,
            "state": state.map(|state| state.to_string()),
            "confirmed": state == Some(expected(command)),
        }));
    }
    let lagging = waits
        .iter()
        .filter(|(_, wait)| wait.is_some())
        .find(|(node_id, _)| told.get(node_id) != Some(&expected(command)));
    if let Some((node_id, Some(wait))) = lagging {
        let last = told.get(node_id).map_or_else(
            || "nothing was heard of it".to_owned(),
            |state| format!("it is {state}"),
        );
        let fault = format!(
            "node {node_id} did not tell {} within {} s; {last}",
            expected(command),
            wait.as_secs_f64()
        );
        return Err(Failure::failed("NMT_NOT_CONFIRMED", fault));
    }
    output.result(&json!({"nodes": nodes, "other_master": session.other_master()}));
    Ok(())
}

/// How long the node may take to tell its new state; `None` when it never does.
async fn wait(session: &Session, node_id: u8, command: Command) -> Option<Duration> {
    if matches!(command, Command::ResetNode | Command::ResetCommunication) {
        return Some(BOOT_UP_WAIT);
    }
    match session
        .node(node_id)
        .read(objects::PRODUCER_HEARTBEAT)
        .await
    {
        Ok(0) => None,
        Ok(period_ms) => {
            let periods = PERIODS * Duration::from_millis(u64::from(period_ms));
            Some(periods.max(WAIT_MIN))
        }
        // A stopped node answers no SDO; its heartbeat, if it has one, is heard within this.
        Err(_) => Some(WAIT_MIN),
    }
}

/// The last states told, once all are as ordered or the time is over.
async fn told(
    listening: &mut Receiver<Stamped>,
    command: Command,
    waits: &BTreeMap<u8, Option<Duration>>,
) -> BTreeMap<u8, State> {
    let begun = Instant::now();
    let mut told = BTreeMap::new();
    loop {
        let open = waits
            .iter()
            .filter(|(node_id, _)| told.get(*node_id) != Some(&expected(command)))
            .filter_map(|(_, wait)| *wait)
            .max();
        let Some(wait) = open else { return told };
        match timeout_at(begun + wait, listening.recv()).await {
            Ok(Ok(stamped)) => {
                let heard = heartbeat::decode(&stamped.frame);
                let meant = heard.filter(|(node_id, _)| {
                    waits.contains_key(node_id) && told.get(node_id) != Some(&expected(command))
                });
                told.extend(meant);
            }
            Ok(Err(RecvError::Lagged(_))) => {}
            Ok(Err(RecvError::Closed)) | Err(_) => return told,
        }
    }
}

fn expected(command: Command) -> State {
    match command {
        Command::Start => State::Operational,
        Command::Stop => State::Stopped,
        Command::EnterPreOperational => State::PreOperational,
        Command::ResetNode | Command::ResetCommunication => State::BootUp,
    }
}

impl From<NmtCommand> for Command {
    fn from(command: NmtCommand) -> Self {
        match command {
            NmtCommand::Start => Self::Start,
            NmtCommand::Stop => Self::Stop,
            NmtCommand::Pre => Self::EnterPreOperational,
            NmtCommand::Reset => Self::ResetNode,
            NmtCommand::ResetComm => Self::ResetCommunication,
        }
    }
}
