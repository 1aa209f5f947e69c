//! The command line of `arthro-simulator ur5`: short flags for what people change, on top of the flags of every server.

use std::ffi::OsString;
use std::net::IpAddr;

use arthro_bootstrap::ExitStatus;
use clap::Parser;

use super::{PortChoice, Standalone};
use crate::standalone::flags::{self, Common, DeviceFlags, quoted};
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
    #[command(flatten)]
    common: Common,
}

/// Runs a controller with these arguments, the first being the program's name.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitStatus {
    flags::run::<Flags, Standalone>(arguments)
}

impl DeviceFlags for Flags {
    fn assignments(&self) -> Vec<(&'static str, String)> {
        let ports = self.ports.map(|ports| match ports {
            PortChoice::Standard => "standard",
            PortChoice::Free => "free",
        });
        [
            self.bind.map(|bind| ("bind", quoted(bind))),
            self.series.map(|series| ("arm.series", quoted(series))),
            self.version.map(|version| ("arm.version", quoted(version))),
            ports.map(|ports| ("ports", quoted(ports))),
            self.powered.then(|| ("arm.powered", "true".to_owned())),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn common(self) -> Common {
        self.common
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
        let arguments = flags::of_any_server(flags.unwrap()).join(&OsString::from(" "));
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
