//! `arthro can`: what an engineer at the bench needs of the drives, on any bus and without any service.

mod decode;
mod dump;
mod faults;
mod meaning;
mod nmt;
mod nodes;
mod object;
mod sdo;
mod session;

use std::io::Write as _;

use epos4_link::{bus, eds, network};
use serde_json::json;

use crate::arguments::{Can, CanCommand, Eds, Sdo};
use crate::exit::{Failure, Kind};
use crate::output::Output;

/// Runs one command to its end.
pub async fn run(can: Can, output: &Output) -> Result<(), Failure> {
    match &can.command {
        CanCommand::Eds(arguments) => write_eds(arguments, output),
        CanCommand::Dump(arguments) => dump::run(&can.bus, arguments, output).await,
        CanCommand::Sdo(Sdo::Read(arguments)) => sdo::read(&can, arguments, output).await,
        CanCommand::Sdo(Sdo::Write(arguments)) => sdo::write(&can, arguments, output).await,
        CanCommand::Nodes => nodes::show(&can, output).await,
        CanCommand::Nmt(order) => nmt::order(&can, order, output).await,
        CanCommand::Faults(arguments) => faults::show(&can, arguments, output).await,
    }
}

fn write_eds(arguments: &Eds, output: &Output) -> Result<(), Failure> {
    let text = eds::write(arguments.node_id);
    match &arguments.out {
        Some(path) => {
            std::fs::write(path, &text).map_err(|error| {
                Failure::failed("INPUT_OUTPUT", format!("{}: {error}", path.display()))
            })?;
            output.line(format!("wrote {}", path.display()));
            output.result(&json!({"file": path, "bytes": text.len()}));
        }
        None if output.is_json() => output.result(&json!({"eds": text})),
        None => std::io::stdout().write_all(text.as_bytes())?,
    }
    Ok(())
}

/// A bus that is none, or that cannot be reached.
fn bus_failure(error: &bus::Error) -> Failure {
    let (kind, reason) = match error {
        bus::Error::BadAddress { .. } => (Kind::Refused, "BUS_ADDRESS_INVALID"),
        bus::Error::Unreachable { .. } | bus::Error::Handshake { .. } => {
            (Kind::Unreachable, "BUS_UNREACHABLE")
        }
        _ => (Kind::Unreachable, "BUS_LOST"),
    };
    Failure::new(kind, reason, error.to_string())
}

/// A transfer that did not succeed.
fn sdo_failure(error: &network::Error) -> Failure {
    let (kind, reason) = match error {
        network::Error::NoAnswer { .. } => (Kind::Unreachable, "SDO_NO_ANSWER"),
        network::Error::Failed { .. } => (Kind::Refused, "SDO_ABORTED"),
        network::Error::NotInState { .. } => (Kind::Failed, "NMT_NOT_CONFIRMED"),
        network::Error::Gone => (Kind::Unreachable, "BUS_LOST"),
        _ => (Kind::Failed, "SDO_FAILED"),
    };
    Failure::new(kind, reason, error.to_string())
}
