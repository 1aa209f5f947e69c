//! What is on the bus, frame by frame.

use std::time::Duration;

use epos4_link::bus;
use epos4_link::frame::candump::Line;
use epos4_link::frame::{Frame, Stamped};
use serde_json::json;
use tokio::time::{Instant, sleep_until};

use super::bus_failure;
use super::decode::Decoder;
use crate::arguments::Dump;
use crate::exit::Failure;
use crate::output::Output;

/// Prints frames until enough have come, the time is over, or Ctrl-C.
pub async fn run(address: &str, arguments: &Dump, output: &Output) -> Result<(), Failure> {
    let mut bus = bus::connect(address)
        .await
        .map_err(|error| bus_failure(&error))?;
    let name = interface(address);
    let deadline = arguments
        .seconds
        .map(|seconds| Instant::now() + Duration::from_secs_f64(seconds));
    let mut decoder = Decoder::default();
    let mut frames: u64 = 0;
    while arguments.count.is_none_or(|count| frames < count) {
        let received = tokio::select! {
            received = bus.receive() => received.map_err(|error| bus_failure(&error))?,
            () = sleep_until(deadline.unwrap_or_else(Instant::now)), if deadline.is_some() => break,
            _ = tokio::signal::ctrl_c() => break,
        };
        frames += 1;
        show(&received, name, arguments, &mut decoder, output);
    }
    output.result(&json!({"frames": frames}));
    Ok(())
}

fn show(received: &Stamped, name: &str, arguments: &Dump, decoder: &mut Decoder, output: &Output) {
    let line = Line {
        interface: name,
        stamped: *received,
    };
    let meaning = decoder.explain(&received.frame);
    if output.is_json() {
        output.result(&json!({
            "stamp_s": received.stamp.as_secs_f64(),
            "id": received.frame.id().to_string(),
            "data": hex(&received.frame),
            "meaning": meaning,
        }));
    } else if arguments.raw {
        output.line(line.to_string());
    } else {
        output.line(format!("{:<52}  {meaning}", line.to_string()));
    }
}

fn hex(frame: &Frame) -> String {
    frame
        .data()
        .iter()
        .map(|byte| format!("{byte:02X}"))
        .collect()
}

/// The name of the bus within its address.
fn interface(address: &str) -> &str {
    address.rsplit(['/', ':']).next().unwrap_or(address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_is_called_as_within_its_address() {
        assert_eq!(interface("socketcan:vcan0"), "vcan0");
        assert_eq!(interface("socketcand://127.0.0.1:29536/can0"), "can0");
    }
}
