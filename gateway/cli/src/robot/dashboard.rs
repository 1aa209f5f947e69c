//! One line to a controller's dashboard, and its answer.

use std::time::Duration;

use serde_json::json;

use super::{place, unreachable};
use crate::arguments::Dashboard;
use crate::exit::Failure;
use crate::output::Output;

/// Of the dashboard server.
const PORT: u16 = 29999;
const REPLY_TIMEOUT: Duration = Duration::from_secs(5);
/// How answers begin that refuse what was asked.
const REFUSALS: [&str; 6] = [
    "Failed to execute",
    "Cannot unlock",
    "could not understand",
    "Could not understand",
    "File not found",
    "Error while loading",
];

/// Asks it; an answer that refuses ends in exit code 3.
pub async fn ask(arguments: &Dashboard, output: &Output) -> Result<(), Failure> {
    let (host, port) = place(&arguments.controller, PORT)?;
    let mut dashboard = ur_link::Dashboard::connect(&host, port, REPLY_TIMEOUT)
        .await
        .map_err(|error| unreachable(&error))?;
    let line = arguments.line.join(" ");
    let answer = dashboard
        .ask(&line)
        .await
        .map_err(|error| unreachable(&error))?;
    if REFUSALS.iter().any(|refusal| answer.starts_with(refusal)) {
        return Err(Failure::refused("CONTROLLER_REFUSED", answer));
    }
    output.line(&answer);
    output.result(&json!({"answer": answer}));
    Ok(())
}
