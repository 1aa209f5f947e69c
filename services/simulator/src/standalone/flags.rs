//! The flags that every device alone has, and the way from short flags to those of any server.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;

use arthro_bootstrap::config::LogFormat;
use arthro_bootstrap::{ExitStatus, Service};
use clap::{Args, Parser};

/// Flags of every device alone.
#[derive(Debug, Args)]
pub(super) struct Common {
    /// Speed of the device's clock against the wall clock [default: 1].
    #[arg(long, value_name = "FACTOR")]
    time_scale: Option<f64>,
    /// Where gRPC listens; port 0 takes a free one [default: 127.0.0.1:50059].
    #[arg(long, value_name = "ADDRESS")]
    grpc: Option<SocketAddr>,
    /// Configuration file (TOML, the section is named as the device).
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Sets one key of the section, e.g. --set time_scale=2.0 (TOML value).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Form of the log lines.
    #[arg(long, value_enum)]
    log: Option<LogFormat>,
    /// Prints the effective configuration as TOML and exits.
    #[arg(long)]
    dump_config: bool,
    /// Drains when standard input closes, so that a server never outlives what started it.
    #[arg(long)]
    until_stdin_closes: bool,
}

/// A command line that becomes the flags of any server: `--set` of the short flags first, so that others win.
pub(super) trait DeviceFlags: Parser {
    /// Keys of the section with TOML values, from the device's own short flags.
    fn assignments(&self) -> Vec<(&'static str, String)>;

    /// The flags of every device.
    fn common(self) -> Common;
}

/// Runs a device with these arguments, the first being the program's name.
pub(super) fn run<F: DeviceFlags, S: Service>(
    arguments: impl IntoIterator<Item = OsString>,
) -> ExitStatus {
    match F::try_parse_from(arguments) {
        Ok(flags) => arthro_bootstrap::run::<S>(of_any_server(flags)),
        Err(error) => {
            // Help comes this way too; a closed terminal is no reason to fail.
            error.print().ok();
            if error.use_stderr() {
                ExitStatus::Usage
            } else {
                ExitStatus::Done
            }
        }
    }
}

/// A TOML text.
pub(super) fn quoted(value: impl std::fmt::Display) -> String {
    format!("\"{value}\"")
}

/// The same in the flags that every server has.
pub(super) fn of_any_server<F: DeviceFlags>(flags: F) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = vec![F::command().get_name().into()];
    let mut flag = |name: &str, value: OsString| arguments.extend([name.into(), value]);
    for (key, value) in flags.assignments() {
        flag("--set", format!("{key}={value}").into());
    }
    let common = flags.common();
    if let Some(time_scale) = common.time_scale {
        flag("--set", format!("time_scale={time_scale:?}").into());
    }
    if let Some(grpc) = common.grpc {
        flag("--listen", grpc.to_string().into());
    }
    if let Some(config) = common.config {
        flag("--config", config.into());
    }
    if let Some(log) = common.log {
        let word = match log {
            LogFormat::Human => "human",
            LogFormat::Json => "json",
        };
        flag("--log", word.into());
    }
    for assignment in common.set {
        flag("--set", assignment.into());
    }
    if common.dump_config {
        arguments.push("--dump-config".into());
    }
    if common.until_stdin_closes {
        arguments.push("--until-stdin-closes".into());
    }
    arguments
}
