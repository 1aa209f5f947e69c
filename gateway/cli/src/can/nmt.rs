//! NMT commands, and what the heartbeats say to them.

use std::time::Duration;

use epos4_link::canopen::nmt::Command;
use epos4_link::network::{self, Node};
use epos4_link::objects;
use serde_json::{Value, json};
use tokio::task::JoinSet;

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
        NmtTarget::All => {
            let found = nodes::answering(can, &session).await?;
            found.iter().map(|node| node.node_id).collect()
        }
    };
    let command = Command::from(order.command);
    let mut ordered = JoinSet::new();
    for node_id in node_ids {
        let node = session.node(node_id);
        ordered.spawn(async move { (node.node_id(), carry_out(&node, command).await) });
    }
    let mut outcomes = Vec::new();
    while let Some(outcome) = ordered.join_next().await {
        outcomes.push(outcome.map_err(|error| Failure::failed("RUNTIME", error))?);
    }
    outcomes.sort_by_key(|(node_id, _)| *node_id);
    let mut nodes = Vec::new();
    for (node_id, outcome) in outcomes {
        let is_confirmed = outcome.map_err(|error| session.failure(&error))?;
        nodes.push(told(node_id, command, is_confirmed, output));
    }
    output.result(&json!({"nodes": nodes, "other_master": session.other_master()}));
    Ok(())
}

fn told(node_id: u8, command: Command, is_confirmed: bool, output: &Output) -> Value {
    let state = command.outcome();
    output.line(if is_confirmed {
        format!("node {node_id}: {state}")
    } else {
        format!("node {node_id}: ordered; it sends no heartbeat that would tell {state}")
    });
    json!({
        "node": node_id,
        "state": is_confirmed.then(|| state.to_string()),
    })
}

/// Whether the node told its new state; false when it has no heartbeat to tell it.
async fn carry_out(node: &Node, command: Command) -> Result<bool, network::Error> {
    match wait(node, command).await {
        Some(wait) => node.change_state(command, wait).await.map(|_| true),
        None => node.command(command).await.map(|()| false),
    }
}

/// How long the node may take to tell its new state; `None` when it never does.
async fn wait(node: &Node, command: Command) -> Option<Duration> {
    if matches!(command, Command::ResetNode | Command::ResetCommunication) {
        return Some(BOOT_UP_WAIT);
    }
    match node.read(objects::PRODUCER_HEARTBEAT).await {
        Ok(0) => None,
        Ok(period_ms) => {
            let periods = PERIODS * Duration::from_millis(u64::from(period_ms));
            Some(periods.max(WAIT_MIN))
        }
        // A stopped node answers no SDO; its heartbeat, if it has one, is heard within this.
        Err(_) => Some(WAIT_MIN),
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
