//! The errors of one drive.

use epos4_link::canopen::emcy::{self, Emergency};
use epos4_link::objects::{self, ERROR_HISTORY_LEN, error_history};
use serde_json::json;

use super::meaning;
use super::session::Session;
use crate::arguments::{Can, Faults};
use crate::exit::Failure;
use crate::output::Output;

/// Prints present error, register and history, or clears the history first.
pub async fn show(can: &Can, arguments: &Faults, output: &Output) -> Result<(), Failure> {
    let session = Session::open(can, output).await?;
    let node = session.node(arguments.node);
    let failure = |error| session.failure(&error);
    if arguments.clear_history {
        node.write(objects::ERROR_HISTORY_COUNT, 0)
            .await
            .map_err(failure)?;
    }
    let present = node.read(objects::ERROR_CODE).await.map_err(failure)?;
    let register = node.read(objects::ERROR_REGISTER).await.map_err(failure)?;
    let count = node
        .read(objects::ERROR_HISTORY_COUNT)
        .await
        .map_err(failure)?;
    let mut history = Vec::new();
    for place in 1..=count.min(ERROR_HISTORY_LEN) {
        let entry = node.read(error_history(place)).await.map_err(failure)?;
        // The code is the lower word; the upper one is the manufacturer's (CiA 301, 7.5.2.4).
        history.push(entry as u16);
    }
    output.line(format!(
        "node {}: error 0x{present:04X} ({})",
        arguments.node,
        emcy::text(present)
    ));
    output.line(format!(
        "error register 0x{register:02X} ({})",
        meaning::error_register(register)
    ));
    if history.is_empty() {
        output.line("no error is remembered");
    }
    for (place, code) in history.iter().enumerate() {
        let text = emcy::text(*code);
        output.line(format!("{}. 0x{code:04X} ({text})", place + 1));
    }
    if let Some(code) = Some(present).filter(|code| *code != Emergency::RESET) {
        output.line(format!("what to do: {}", emcy::response(code)));
    }
    let told = |code: u16| {
        json!({
            "code": code,
            "text": emcy::text(code),
            "response": emcy::response(code),
        })
    };
    output.result(&json!({
        "node": arguments.node,
        "error": told(present),
        "error_register": register,
        "history": history.iter().map(|code| told(*code)).collect::<Vec<_>>(),
        "other_master": session.other_master(),
    }));
    Ok(())
}
