//! Prints a bus as can-utils' `candump -L` does, a frame a line, until it is ended or the bus is gone.
//!
//! ```text
//! cargo run --release -p epos4-link --example candump -- socketcan:can0
//! ```

use std::io::Write as _;

use epos4_link::bus::{self, Address};
use epos4_link::frame::candump::Line;
use tokio::io::{Error, ErrorKind};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = std::env::args()
        .nth(1)
        .ok_or_else(|| Error::new(ErrorKind::InvalidInput, "usage: candump ADDRESS"))?;
    let (Address::SocketCan { interface: name } | Address::Socketcand { bus: name, .. }) =
        text.parse()?;
    let mut bus = bus::connect(&text).await?;
    let mut out = std::io::stdout();
    loop {
        let line = Line {
            interface: &name,
            stamped: bus.receive().await?,
        };
        writeln!(out, "{line}")?;
        out.flush()?;
    }
}
