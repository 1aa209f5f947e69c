//! Our master on a bus, to be measured beside others on the same. `tests/bench/can_bus.py` runs it:
//!
//! ```text
//! bus sdo ADDRESS COUNT NODES       COUNT uploads from each of nodes 1 to NODES, all nodes at once; one line of JSON
//! bus stream                        serves can0 with process data of four drives; prints its address; ends with its input
//! bus listen ADDRESS SECONDS        hears that; one line of JSON
//! ```
#![allow(missing_docs, clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use epos4_link::bus::{self, CanBus, in_process, socketcand};
use epos4_link::frame::Frame;
use epos4_link::network::{Network, Node, Options};
use epos4_link::objects;
use tokio::io::AsyncReadExt;
use tokio::time::{MissedTickBehavior, interval};

#[tokio::main(flavor = "current_thread")]
async fn main() {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["sdo", address, count, nodes] => {
            sdo(address, count.parse().unwrap(), nodes.parse().unwrap()).await
        }
        ["stream"] => stream().await,
        ["listen", address, seconds] => listen(address, seconds.parse().unwrap()).await,
        // As part of `cargo bench` there is nothing to do: the figures mean something only beside others'.
        _ => println!("bus: run by tests/bench/can_bus.py"),
    }
}

/// Round trips one after another to each node, the time of each, ms.
async fn sdo(address: &str, count: usize, nodes: u8) {
    let bus = bus::connect(address).await.unwrap();
    let (mut network, handles) = Network::new(bus, Options::default());
    let began = Instant::now();
    let cpu_s = cpu_s();
    let all = async move {
        let readers = (1..=nodes).map(|node_id| upload(handles.node(node_id), count));
        let mut running: tokio::task::JoinSet<Vec<f64>> = readers.collect();
        let mut times_ms = Vec::new();
        while let Some(times) = running.join_next().await {
            times_ms.extend(times.unwrap());
        }
        times_ms
    };
    // A task, as in a service: what wakes the future of `main` goes through a system call.
    let owner = tokio::spawn(async move { while network.next_event().await.is_ok() {} });
    let mut times_ms = tokio::spawn(all).await.unwrap();
    owner.abort();
    let took_s = began.elapsed().as_secs_f64();
    let cpu_s = self::cpu_s() - cpu_s;
    times_ms.sort_by(f64::total_cmp);
    let at = |share: f64| times_ms[(times_ms.len() as f64 * share) as usize];
    println!(
        r#"{{"per_s": {}, "p50_ms": {}, "p99_ms": {}, "cpu": {}}}"#,
        times_ms.len() as f64 / took_s,
        at(0.5),
        at(0.99),
        cpu_s / took_s,
    );
}

async fn upload(node: Node, count: usize) -> Vec<f64> {
    let mut times_ms = Vec::with_capacity(count);
    for _ in 0..count {
        let asked = Instant::now();
        node.read(objects::SERIAL_NUMBER).await.unwrap();
        times_ms.push(asked.elapsed().as_secs_f64() * 1e3);
    }
    times_ms
}

/// Four drives with two TPDOs each, every millisecond.
async fn stream() {
    let began = Instant::now();
    let bus = in_process::Bus::new(move || began.elapsed());
    let mut drives = bus.attach();
    let buses = BTreeMap::from([("can0".to_owned(), bus)]);
    let server = socketcand::server::serve(([127, 0, 0, 1], 0).into(), buses)
        .await
        .unwrap();
    println!("socketcand://{}/can0", server.address());
    let mut stdin = tokio::io::stdin();
    let run = async {
        let mut ticks = interval(Duration::from_millis(1));
        ticks.set_missed_tick_behavior(MissedTickBehavior::Burst);
        loop {
            ticks.tick().await;
            let frames = [0x180, 0x280]
                .into_iter()
                .flat_map(|base| (1..=4).map(move |node_id| base + node_id))
                .map(|cob_id| Frame::standard(cob_id, [0x37, 0x06, 1, 2, 3, 4, 5, 6]));
            for frame in frames {
                drives.send(frame).unwrap();
            }
        }
    };
    tokio::select! {
        () = run => {}
        _ = stdin.read_u8() => {}
    }
}

/// How many frames come, and what hearing them takes of one core.
async fn listen(address: &str, seconds: f64) {
    let mut bus = bus::connect(address).await.unwrap();
    // Those that were held back during the handshake come at once.
    let opened = Instant::now();
    while opened.elapsed() < Duration::from_millis(200) {
        bus.receive().await.unwrap();
    }
    let began = Instant::now();
    let cpu_s = cpu_s();
    let mut frames = 0_u64;
    let mut sum = 0_u64;
    while began.elapsed().as_secs_f64() < seconds {
        let received = bus.receive().await.unwrap();
        frames += 1;
        sum += received
            .frame
            .data()
            .iter()
            .copied()
            .map(u64::from)
            .sum::<u64>();
    }
    let took_s = began.elapsed().as_secs_f64();
    println!(
        r#"{{"per_s": {}, "cpu": {}, "sum": {sum}}}"#,
        frames as f64 / took_s,
        (self::cpu_s() - cpu_s) / took_s,
    );
}

/// What this process, which has one thread, has had of a core, s.
fn cpu_s() -> f64 {
    let schedstat = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    let nanoseconds = schedstat.split_ascii_whitespace().next().unwrap();
    nanoseconds.parse::<f64>().unwrap() / 1e9
}
