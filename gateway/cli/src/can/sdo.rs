//! Reading and writing one object.

use epos4_link::canopen::object::Address;
use epos4_link::dictionary::Kind;
use serde_json::{Value, json};

use super::meaning;
use super::object::Asked;
use super::session::Session;
use crate::arguments::{Can, SdoRead, SdoWrite};
use crate::exit::Failure;
use crate::output::Output;

/// Reads an object and prints it.
pub async fn read(can: &Can, arguments: &SdoRead, output: &Output) -> Result<(), Failure> {
    let asked = Asked::parse(&arguments.object, arguments.kind)?;
    let session = Session::open(can, output).await?;
    let bytes = upload(&session, arguments.node, asked.address).await?;
    tell(arguments.node, &asked, &bytes, output);
    Ok(())
}

/// Writes an object, and prints what it holds then.
pub async fn write(can: &Can, arguments: &SdoWrite, output: &Output) -> Result<(), Failure> {
    let asked = Asked::parse(&arguments.object, arguments.kind)?;
    let bytes = asked.bytes(&arguments.value)?;
    let session = Session::open(can, output).await?;
    session
        .node(arguments.node)
        .write_bytes(asked.address, &bytes)
        .await
        .map_err(|error| session.failure(&error))?;
    let now = upload(&session, arguments.node, asked.address).await?;
    tell(arguments.node, &asked, &now, output);
    Ok(())
}

async fn upload(session: &Session, node_id: u8, address: Address) -> Result<Vec<u8>, Failure> {
    session
        .node(node_id)
        .read_bytes(address)
        .await
        .map(|reading| reading.value)
        .map_err(|error| session.failure(&error))
}

fn tell(node_id: u8, asked: &Asked, bytes: &[u8], output: &Output) {
    let (value, words) = interpreted(asked, bytes);
    output.line(format!(
        "node {node_id} {} {} = {words}",
        asked.address,
        asked.name()
    ));
    let meaning = asked
        .entry
        .zip(value.as_i64())
        .and_then(|(entry, value)| meaning::meaning(entry, value));
    output.result(&json!({
        "node": node_id,
        "object": asked.address.to_string(),
        "name": asked.entry.map(|entry| entry.name),
        "value": value,
        "unit": asked.entry.map(|entry| entry.unit).filter(|unit| !unit.is_empty()),
        "meaning": meaning,
        "bytes": hex(bytes),
    }));
}

/// The value for programs, and in words. Bytes that do not fit the type, or have none, stay bytes.
fn interpreted(asked: &Asked, bytes: &[u8]) -> (Value, String) {
    if let Some(Kind::Text(_)) = asked.kind {
        let text = String::from_utf8_lossy(bytes);
        return (json!(text), format!("{text:?}"));
    }
    match (asked.kind.and_then(|kind| kind.decode(bytes)), asked.entry) {
        (Some(value), Some(entry)) => (json!(value), meaning::words(entry, value)),
        (Some(value), None) => (json!(value), value.to_string()),
        (None, _) => (
            Value::Null,
            format!("{} ({} bytes)", hex(bytes), bytes.len()),
        ),
    }
}

/// Bytes in the order of the bus.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect()
}
