//! Serves the four drives of the cell on a socketcand port or puts them on a bus that is there, in real time, for
//! foreign CANopen masters to try: a bus bears one master, and here is none yet.
//!
//! ```text
//! cargo run --release -p arthro-simulator --example epos4_bus -- 127.0.0.1:0
//! cargo run --release -p arthro-simulator --example epos4_bus -- --bus socketcan:can0
//! ```
//!
//! Prints the address of the bus and ends when its standard input is closed or the bus is lost.

use std::error::Error;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use arthro_simulator::cell::axes;
use arthro_simulator::epos4::{Bus, socketcand, wire};
use tokio::io::AsyncReadExt;
use tokio::time::{Instant, MissedTickBehavior, interval};

const STEP: Duration = Duration::from_millis(2);

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let bus = Bus::new(axes::drives());
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--bus", address] => {
            let mut wire = wire::join(&bus, address).await?;
            println!("{address}");
            tokio::select! {
                () = until_stdin_closes(&bus) => Ok(()),
                error = wire.ended() => Err(error.into()),
            }
        }
        [] | [_] => {
            let bind: SocketAddr = arguments
                .first()
                .map_or("127.0.0.1:0", String::as_str)
                .parse()?;
            let server = socketcand::serve(bind, Arc::clone(&bus)).await?;
            println!("socketcand://{}/can0", server.address());
            until_stdin_closes(&bus).await;
            Ok(())
        }
        _ => Err("usage: epos4_bus [LISTEN | --bus ADDRESS]".into()),
    }
}

async fn until_stdin_closes(bus: &Bus) {
    let mut stdin = tokio::io::stdin();
    tokio::select! {
        () = run(bus) => {}
        _ = stdin.read_u8() => {}
    }
}

/// The bus's clock follows the wall clock. Nothing is between the jaws.
async fn run(bus: &Bus) {
    let start = Instant::now();
    let mut ticks = interval(STEP);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut now_s = 0.0;
    let mut shafts_qc = axes::start_qc();
    let mut mechanisms = axes::Mechanisms::new(&axes::Axis::ALL);
    loop {
        ticks.tick().await;
        while now_s < start.elapsed().as_secs_f64() {
            now_s += STEP.as_secs_f64();
            let mechanics = mechanisms.act(&shafts_qc, axes::JawLoad::default());
            bus.tick(STEP.as_secs_f64(), now_s, &mechanics);
            for (shaft_qc, position_qc) in shafts_qc.iter_mut().zip(bus.positions_quadcounts()) {
                *shaft_qc = position_qc;
            }
        }
    }
}
