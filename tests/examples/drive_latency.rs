//! How long it takes from a controlword to the statusword that answers it, both as process data, at real time: simulated
//! drives, socketcand and this driver in one process.
//!
//! ```sh
//! cargo run --release -p arthro-tests --example drive_latency
//! ```

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use arthro_simulator::bench::{Bench, JawConfig};
use arthro_simulator::epos4::{Bus, socketcand};
use epos4_link::bus;
use epos4_link::canopen::nmt;
use epos4_link::canopen::pdo::{Data, Mapped, Mapping, Transmission};
use epos4_link::cia402::{Command, State, Statusword};
use epos4_link::network::{Event, Network, Options};
use epos4_link::objects;
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

const NODE_ID: u8 = 2;
const COMMANDS: usize = 500;
/// Between two commands: longer than the inhibit time of the statusword.
const PAUSE: Duration = Duration::from_millis(5);
const STEP: Duration = Duration::from_millis(1);
const LIMIT: Duration = Duration::from_secs(1);

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let drives = Bus::new(Bench::drives(&[1, 2, 3, 4]));
    // They boot with the first step.
    drives.tick(STEP.as_secs_f64(), STEP.as_secs_f64(), &[]);
    let server = socketcand::serve(([127, 0, 0, 1], 0).into(), Arc::clone(&drives)).await?;
    tokio::spawn(keep_time(drives));
    let address = format!("socketcand://{}/can0", server.address());
    let (mut network, nodes) = Network::new(bus::connect(&address).await?, Options::default());
    let (heard, mut statuswords) = mpsc::channel(64);
    tokio::spawn(async move {
        while let Ok(event) = network.next_event().await {
            if let Event::Pdo {
                node_id: NODE_ID,
                number: 1,
                data,
                ..
            } = event
                && let Ok(bytes) = <[u8; 2]>::try_from(data.as_slice())
                && heard
                    .send(Statusword(u16::from_le_bytes(bytes)))
                    .await
                    .is_err()
            {
                return;
            }
        }
    });
    let node = nodes.node(NODE_ID);
    // Its heartbeat tells the state.
    node.write(objects::PRODUCER_HEARTBEAT, 100).await?;
    node.change_state(nmt::Command::EnterPreOperational, LIMIT)
        .await?;
    let status = Mapping::new([Mapped::from(objects::STATUSWORD)])?;
    node.map_transmit_pdo(1, &status, Transmission::OnChange, STEP)
        .await?;
    let control = Mapping::new([Mapped::from(objects::CONTROLWORD)])?;
    node.map_receive_pdo(1, &control, Transmission::OnChange)
        .await?;
    node.change_state(nmt::Command::Start, LIMIT).await?;
    let ready = (Command::Shutdown, State::ReadyToSwitchOn);
    let switched_on = (Command::SwitchOn, State::SwitchedOn);
    let mut latencies = Vec::with_capacity(COMMANDS);
    for (command, wanted) in [ready, switched_on].into_iter().cycle().take(COMMANDS) {
        sleep(PAUSE).await;
        let data = Data::new(&command.controlword().to_le_bytes()).ok_or("two bytes fit")?;
        let sent = Instant::now();
        node.send_receive_pdo(1, &data).await?;
        let answered = async {
            while let Some(statusword) = statuswords.recv().await {
                if statusword.state() == Some(wanted) {
                    return true;
                }
            }
            false
        };
        if !timeout(LIMIT, answered).await? {
            return Err("the bus is gone".into());
        }
        latencies.push(sent.elapsed());
    }
    latencies.sort();
    let at = |share: f64| latencies[((COMMANDS - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
    println!(
        "controlword to statusword, {COMMANDS} times: p50 {:.3} ms, p99 {:.3} ms, longest {:.3} ms",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}

async fn keep_time(drives: Arc<Bus>) {
    let mut bench = Bench::new(&[1, 2, 3, 4], JawConfig::default());
    let mut due = interval(STEP);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut now_s = drives.now_s();
    loop {
        due.tick().await;
        now_s += STEP.as_secs_f64();
        let mechanics = bench.mechanics(&drives.positions_quadcounts());
        drives.tick(STEP.as_secs_f64(), now_s, &mechanics);
    }
}
