//! The command line of `arthro-simulator epos4`: short flags for what people change, on top of the flags of every
//! server.

use std::ffi::OsString;
use std::net::SocketAddr;

use arthro_bootstrap::ExitStatus;
use clap::Parser;

use super::{NodeIds, Standalone};
use crate::standalone::flags::{self, Common, DeviceFlags, quoted};

/// Simulates maxon EPOS4 drives with motors and mechanisms on a CAN bus, served by socketcand's protocol or put on a
/// bus that exists, and faults over gRPC.
#[derive(Debug, Parser)]
#[command(name = "arthro-simulator epos4", bin_name = "arthro-simulator epos4")]
struct Flags {
    /// Where socketcand's protocol is served; port 0 takes a free one [default: 127.0.0.1:29536, none with --bus].
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<SocketAddr>,
    /// Joins a bus, such as socketcan:vcan0 or socketcand://host:port/can0.
    #[arg(long, value_name = "ADDRESS")]
    bus: Option<String>,
    /// Node ids, such as 1-4 or 2,5 [default: 1-4].
    #[arg(long, value_name = "LIST")]
    nodes: Option<NodeIds>,
    #[command(flatten)]
    common: Common,
}

/// Runs drives with these arguments, the first being the program's name.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitStatus {
    flags::run::<Flags, Standalone>(arguments)
}

impl DeviceFlags for Flags {
    fn assignments(&self) -> Vec<(&'static str, String)> {
        let listen = match (self.listen, &self.bus) {
            (Some(listen), _) => Some(quoted(listen)),
            // Who joins a bus that exists needs no second one.
            (None, Some(_)) => Some(quoted("")),
            (None, None) => None,
        };
        [
            listen.map(|listen| ("listen", listen)),
            self.bus.as_ref().map(|bus| ("bus", quoted(bus))),
            self.nodes.as_ref().map(|nodes| ("nodes", quoted(nodes))),
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

    fn words(arguments: &[&str]) -> String {
        let flags = Flags::try_parse_from([&["epos4"], arguments].concat()).unwrap();
        let words = flags::of_any_server(flags).join(&OsString::from(" "));
        words.into_string().unwrap()
    }

    #[test]
    fn short_flags_become_keys_and_later_sets_win() {
        assert_eq!(
            words(&[
                "--listen",
                "127.0.0.1:0",
                "--nodes",
                "2,5-6",
                "--set",
                "jaw.tissue_cut_n=40.0"
            ]),
            "arthro-simulator epos4 --set listen=\"127.0.0.1:0\" --set nodes=\"2,5-6\" --set jaw.tissue_cut_n=40.0"
        );
    }

    #[test]
    fn drives_that_join_a_bus_serve_no_other_unless_asked() {
        assert_eq!(
            words(&["--bus", "socketcan:vcan0"]),
            "arthro-simulator epos4 --set listen=\"\" --set bus=\"socketcan:vcan0\""
        );
    }

    #[test]
    fn nodes_that_are_none_are_refused() {
        for nodes in ["0", "128", "4-1", "", "1,1", "x"] {
            assert!(
                Flags::try_parse_from(["epos4", "--nodes", nodes]).is_err(),
                "{nodes:?}"
            );
        }
    }
}
