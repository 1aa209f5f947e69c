//! The command line of `arthro-simulator ur5`: short flags for what people change, on top of the flags of every server.

use std::ffi::OsString;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use arthro_bootstrap::ExitStatus;
use arthro_bootstrap::config::LogFormat;
use clap::Parser;

use super::{PortChoice, Standalone};
use crate::ur5::{Series, Version};

/// Simulates the controller of one UR5 (CB3) or UR5e (e-Series): dashboard, RTDE, the primary, secondary and realtime
/// interfaces with URScript, and faults over gRPC.
#[derive(Debug, Parser)]
#[command(name = "arthro-simulator ur5", bin_name = "arthro-simulator ur5")]
struct Flags {
    /// Address of the controller; give each controller its own, such as 127.0.0.11.
    #[arg(long, value_name = "ADDRESS")]
    bind: Option<IpAddr>,
    /// Generation of the controller [default: cb3].
    #[arg(long, value_enum)]
    series: Option<Series>,
    /// Software of the controller, such as 3.15.8 or 5.12.6 [default: that of the series].
    #[arg(long)]
    version: Option<Version>,
    /// The ports of a real controller, or free ones that the first line of standard output tells [default: standard].
    #[arg(long, value_enum)]
    ports: Option<PortChoice>,
    /// Starts with power on and brakes released.
    #[arg(long)]
    powered: bool,
    /// Speed of the controller's clock against the wall clock [default: 1].
    #[arg(long, value_name = "FACTOR")]
    time_scale: Option<f64>,
    /// Where the FaultService listens; port 0 takes a free one [default: 127.0.0.1:50059].
    #[arg(long, value_name = "ADDRESS")]
    grpc: Option<SocketAddr>,
    /// Configuration file (TOML, section [ur5]).
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Sets one key of the section, e.g. --set arm.boot_s=0.1 (TOML value).
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

/// Runs a controller with these arguments, the first being the program's name.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitStatus {
    match Flags::try_parse_from(arguments) {
        Ok(flags) => arthro_bootstrap::run::<Standalone>(flags.of_any_server()),
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

impl Flags {
    /// The same in the flags that every server has.
    fn of_any_server(self) -> Vec<OsString> {
        let mut arguments: Vec<OsString> = vec!["arthro-simulator ur5".into()];
        let mut flag = |name: &str, value: OsString| arguments.extend([name.into(), value]);
        let mut set = |key: &str, value: String| flag("--set", format!("{key}={value}").into());
        let quoted = |text: String| format!("\"{text}\"");
        if let Some(bind) = self.bind {
            set("bind", quoted(bind.to_string()));
        }
        if let Some(series) = self.series {
            set("arm.series", quoted(series.to_string()));
        }
        if let Some(version) = self.version {
            set("arm.version", quoted(version.to_string()));
        }
        if let Some(ports) = self.ports {
            let word = match ports {
                PortChoice::Standard => "standard",
                PortChoice::Free => "free",
            };
            set("ports", quoted(word.to_owned()));
        }
        if self.powered {
            set("arm.powered", "true".to_owned());
        }
        if let Some(time_scale) = self.time_scale {
            set("time_scale", format!("{time_scale:?}"));
        }
        if let Some(grpc) = self.grpc {
            flag("--listen", grpc.to_string().into());
        }
        if let Some(config) = self.config {
            flag("--config", config.into());
        }
        if let Some(log) = self.log {
            let word = match log {
                LogFormat::Human => "human",
                LogFormat::Json => "json",
            };
            flag("--log", word.into());
        }
        for assignment in self.set {
            flag("--set", assignment.into());
        }
        if self.dump_config {
            arguments.push("--dump-config".into());
        }
        if self.until_stdin_closes {
            arguments.push("--until-stdin-closes".into());
        }
        arguments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_flags_become_keys_and_later_sets_win() {
        let flags = Flags::try_parse_from([
            "ur5",
            "--bind",
            "127.0.0.11",
            "--series",
            "e",
            "--version",
            "5.9.4",
            "--powered",
            "--ports",
            "free",
            "--grpc",
            "127.0.0.1:0",
            "--set",
            "arm.boot_s=0.1",
        ]);
        let arguments = flags.unwrap().of_any_server().join(&OsString::from(" "));
        assert_eq!(
            arguments.to_str().unwrap(),
            "arthro-simulator ur5 --set bind=\"127.0.0.11\" --set arm.series=\"e\" --set arm.version=\"5.9.4.0\" \
             --set ports=\"free\" --set arm.powered=true --listen 127.0.0.1:0 --set arm.boot_s=0.1"
        );
    }

    #[test]
    fn a_version_that_is_none_is_refused() {
        assert!(Flags::try_parse_from(["ur5", "--version", "latest"]).is_err());
        assert_eq!(
            main(["ur5", "--nonsense"].map(Into::into)),
            ExitStatus::Usage
        );
    }
}
