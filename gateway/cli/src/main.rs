//! `arthro`: the one binary people type.
//!
//! `arthro demo` performs a whole simulated meniscoplasty, `arthro up` keeps a simulated cell and all
//! services running; `register`, `plan`, `evaluate`, `reconstruct` and `calibrate` work on files in this
//! process, and the other commands are clients of a gateway. Every command takes `--json`:
//! the last line on standard output is then one JSON object. Exit codes are in [`exit`].

mod arguments;
mod audit;
mod bench;
mod bites_file;
mod calibrate;
mod calibrations;
mod can;
mod cell;
mod commanded;
mod commands;
mod connection;
mod demo;
mod drawing;
mod evaluate;
mod exit;
mod gateway;
mod output;
mod pki;
mod plan;
mod reconstruct;
mod record;
mod register;
mod report;
mod requests;
mod robot;
mod scene;
mod serve;
mod upload;

use std::process::ExitCode;

use clap::Parser;

use crate::arguments::{Arguments, Command};
use crate::exit::Failure;
use crate::output::Output;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    // A server sets up its own runtime and telemetry.
    if let Command::Serve(arguments) = arguments.command {
        return serve::run(arguments);
    }
    if let Command::Replay(arguments) = &arguments.command {
        return record::replay(arguments);
    }
    let output = Output::new(arguments.json);
    let outcome = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::failed("RUNTIME", error))
        .and_then(|runtime| {
            let outcome = runtime.block_on(commands::run(arguments, &output));
            runtime.shutdown_background();
            outcome
        });
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            output.failure(&failure);
            failure.exit_code()
        }
    }
}
