//! `arthro can` as an engineer at the bench uses it, on the bus of a simulated cell without any service, and with a
//! slave that nobody here wrote.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::process::Stdio;
use std::time::Duration;

use arthro_proto::simulator::v1::GetCellRequest;
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_tests::cell::arthro;
use arthro_tests::command::answered;
use arthro_tests::peers;
use epos4_link::bus;
use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::AbortCode;
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::network::{Event, Network, Options};
use epos4_link::objects;
use serde_json::Value;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader, Lines};
use tokio::net::TcpListener;
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::sync::mpsc;
use tokio::time::timeout;

const LIMIT: Duration = Duration::from_secs(60);
const HOST_NODE_ID: u8 = 127;
/// Of the foreign slave.
const SLAVE: u8 = 10;
/// An object of it that takes any bytes.
const SCRATCH: Address = Address::new(0x5000, 0);

/// A simulator alone, and the engineer's terminal.
struct Bench {
    bus: String,
    simulator: Child,
}

impl Bench {
    async fn set_up() -> Self {
        let mut simulator = Command::new(arthro())
            .args(["serve", "simulator", "--listen", "127.0.0.1:0"])
            .args(["--set", "can_listen=\"127.0.0.1:0\""])
            .args(free_ports())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .expect("arthro starts");
        let stdout = simulator.stdout.take().expect("standard output is piped");
        let line = next_line(&mut BufReader::new(stdout).lines()).await;
        let announced: Value = serde_json::from_str(&line).expect("a line of JSON");
        let address = announced["address"]
            .as_str()
            .expect("an address")
            .to_owned();
        let mut referee = RefereeServiceClient::connect(format!("http://{address}"))
            .await
            .expect("the simulator serves");
        let cell = referee.get_cell(GetCellRequest {}).await.expect("a cell");
        Self {
            bus: cell.into_inner().can_address,
            simulator,
        }
    }

    /// Exit code and last line of `arthro can ARGUMENTS --json`.
    async fn can(&self, arguments: &[&str]) -> (i32, Value) {
        answered(&[&["can", "--bus", &self.bus], arguments].concat()).await
    }

    async fn done(&self, arguments: &[&str]) -> Value {
        let (code, answer) = self.can(arguments).await;
        assert_eq!(code, 0, "{arguments:?}: {answer}");
        answer
    }

    /// Exit code and reason.
    async fn refused(&self, arguments: &[&str]) -> (i32, String) {
        let (code, answer) = self.can(arguments).await;
        (code, reason(&answer))
    }

    async fn teardown(mut self) {
        self.simulator.kill().await.expect("the simulator ends");
    }
}

/// Ports of the arms' controllers, which nobody uses here.
fn free_ports() -> Vec<String> {
    let servers = [
        "dashboard",
        "primary",
        "secondary",
        "realtime",
        "rtde",
        "primary_read_only",
        "secondary_read_only",
        "realtime_read_only",
    ];
    ["forceps_arm", "arthroscope_arm"]
        .iter()
        .flat_map(|arm| servers.map(|server| format!("{arm}.{server}_port=0")))
        .flat_map(|assignment| ["--set".to_owned(), assignment])
        .collect()
}

fn reason(answer: &Value) -> String {
    answer["error"]["reason"]
        .as_str()
        .unwrap_or_default()
        .to_owned()
}

async fn next_line(lines: &mut Lines<BufReader<ChildStdout>>) -> String {
    timeout(LIMIT, lines.next_line())
        .await
        .expect("a line in time")
        .expect("standard output can be read")
        .expect("it still runs")
}

#[tokio::test]
async fn objects_are_read_and_written_by_name() {
    let bench = Bench::set_up().await;
    let read = bench.done(&["sdo", "read", "1", "statusword"]).await;
    assert_eq!(read["object"], "0x6041:00");
    assert_eq!(read["meaning"], "SWITCH_ON_DISABLED");
    let read = bench.done(&["sdo", "read", "2", "1008"]).await;
    assert_eq!(read["value"], "EPOS4");
    let wrote = bench
        .done(&["sdo", "write", "3", "profile_velocity", "0x100"])
        .await;
    assert_eq!(
        (&wrote["value"], &wrote["unit"]),
        (&256.into(), &"rpm".into())
    );
    let wrote = bench.done(&["sdo", "write", "3", "607A", "-42"]).await;
    assert_eq!(wrote["value"], -42);
    for (arguments, code, reason) in [
        (
            vec!["sdo", "write", "1", "statusword", "0"],
            3,
            "OBJECT_READ_ONLY",
        ),
        (
            vec!["sdo", "write", "1", "3001:02", "4501"],
            3,
            "VALUE_OUT_OF_RANGE",
        ),
        (vec!["sdo", "write", "1", "607A", "two"], 3, "VALUE_INVALID"),
        (vec!["sdo", "read", "1", "statusvord"], 3, "OBJECT_UNKNOWN"),
        (vec!["sdo", "read", "1", "6072"], 3, "SDO_ABORTED"),
        (vec!["sdo", "read", "9", "statusword"], 4, "SDO_NO_ANSWER"),
    ] {
        assert_eq!(
            bench.refused(&arguments).await,
            (code, reason.to_owned()),
            "{arguments:?}"
        );
    }
    bench.teardown().await;
}

#[tokio::test]
async fn nodes_tell_who_they_are_and_obey() {
    let bench = Bench::set_up().await;
    let found = bench.done(&["--answer-ms", "200", "nodes"]).await;
    let nodes = found["nodes"].as_array().expect("nodes");
    assert_eq!(nodes.len(), 4, "{found}");
    for (node_id, node) in (1..).zip(nodes) {
        assert_eq!(node["node"], node_id);
        assert_eq!(
            (&node["name"], &node["product"]),
            (&"EPOS4".into(), &0x6050_0000.into())
        );
        assert_eq!(node["drive_state"], "SWITCH_ON_DISABLED");
    }
    assert_eq!(found["other_master"], Value::Null);
    let reset = bench
        .done(&["--answer-ms", "200", "nmt", "all", "reset"])
        .await;
    assert_eq!(reset["nodes"].as_array().map(Vec::len), Some(4), "{reset}");
    let started = bench.done(&["nmt", "1", "start"]).await;
    assert_eq!(
        started["nodes"][0]["state"],
        Value::Null,
        "a node without heartbeat confirms nothing"
    );
    bench.done(&["sdo", "write", "1", "1017", "50"]).await;
    for (order, state) in [
        ("start", "OPERATIONAL"),
        ("stop", "STOPPED"),
        ("pre", "PRE_OPERATIONAL"),
        ("reset-comm", "BOOT_UP"),
    ] {
        let told = bench.done(&["nmt", "1", order]).await;
        assert_eq!(told["nodes"][0]["state"], state, "{told}");
    }
    assert_eq!(
        bench.refused(&["nmt", "99", "reset"]).await,
        (1, "NMT_NOT_CONFIRMED".to_owned())
    );
    bench.teardown().await;
}

#[tokio::test]
async fn faults_are_told_with_what_to_do_and_the_history_is_cleared() {
    let bench = Bench::set_up().await;
    bench
        .done(&[
            "sdo",
            "write",
            "2",
            "1016:01",
            &((u32::from(HOST_NODE_ID) << 16) | 200).to_string(),
        ])
        .await;
    bench.done(&["sdo", "write", "2", "1017", "50"]).await;
    let mut bus = bus::connect(&bench.bus).await.expect("the bus opens");
    // A server keeps frames back from a client that is new: the first one heard says that it hears all.
    timeout(LIMIT, bus.receive())
        .await
        .expect("a heartbeat in time")
        .expect("the bus stays");
    bus.send(heartbeat::encode(HOST_NODE_ID, nmt::State::Operational))
        .expect("it is sent");
    // The host falls silent, and the drive tells it.
    let emergency = timeout(LIMIT, async {
        loop {
            let stamped = bus.receive().await.expect("the bus stays");
            if let Some(emergency) = Emergency::decode(&stamped.frame) {
                return emergency;
            }
        }
    });
    let (node_id, emergency) = emergency.await.expect("an emergency in time");
    assert_eq!((node_id, emergency.code), (2, 0x8130));
    let told = bench.done(&["faults", "2"]).await;
    assert_eq!(told["error"]["code"], 0x8130);
    assert_eq!(told["history"][0]["code"], 0x8130);
    assert!(
        told["history"][0]["response"]
            .as_str()
            .is_some_and(|text| text.len() > 20),
        "{told}"
    );
    let cleared = bench.done(&["faults", "2", "--clear-history"]).await;
    assert_eq!(
        (&cleared["history"], &cleared["error"]["code"]),
        (&Value::Array(vec![]), &0x8130.into())
    );
    bench.teardown().await;
}

#[tokio::test]
async fn a_dump_is_a_can_log_with_its_meaning() {
    let bench = Bench::set_up().await;
    let mut dump = Command::new(arthro())
        .args([
            "can", "--bus", &bench.bus, "dump", "--for", "60", "--count", "2",
        ])
        .stdout(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .expect("arthro starts");
    let mut lines = BufReader::new(dump.stdout.take().expect("it is piped")).lines();
    // Asked until the dump, which starts beside, has heard it.
    let heard = async {
        loop {
            bench.done(&["sdo", "read", "4", "6041"]).await;
        }
    };
    let line = tokio::select! {
        line = next_line(&mut lines) => line,
        () = heard => String::new(),
    };
    let (log, meaning) = line.split_once("  ").expect("a log line and its meaning");
    let parsed: epos4_link::frame::candump::Line = log.trim().parse().expect("a line of a CAN log");
    assert_eq!(parsed.interface, "can0");
    assert!(meaning.contains("0x6041:00 statusword"), "{line}");
    bench.teardown().await;
}

#[tokio::test]
async fn another_master_is_told() {
    let bench = Bench::set_up().await;
    let mut bus = bus::connect(&bench.bus).await.expect("the bus opens");
    let host = tokio::spawn(async move {
        let mut beats = tokio::time::interval(Duration::from_millis(20));
        loop {
            beats.tick().await;
            if bus
                .send(heartbeat::encode(HOST_NODE_ID, nmt::State::Operational))
                .is_err()
            {
                return;
            }
        }
    });
    let found = bench.done(&["--answer-ms", "200", "nodes"]).await;
    assert!(
        found["other_master"]
            .as_str()
            .is_some_and(|sign| sign.contains("127")),
        "{found}"
    );
    let host_entry = &found["nodes"][4];
    assert_eq!(
        (&host_entry["node"], &host_entry["nmt_state"]),
        (&HOST_NODE_ID.into(), &"OPERATIONAL".into())
    );
    host.abort();
    bench.teardown().await;
}

#[tokio::test]
async fn what_is_no_bus_is_named() {
    let at = |bus: &str| [bus.to_owned()];
    for (address, code, expected) in [
        ("can0", 3, "BUS_ADDRESS_INVALID"),
        ("socketcand://127.0.0.1:1/can0", 4, "BUS_UNREACHABLE"),
        ("socketcan:nocan", 4, "BUS_UNREACHABLE"),
    ] {
        let [bus] = at(address);
        let (exit, answer) = answered(&["can", "--bus", &bus, "nodes"]).await;
        assert_eq!(
            (exit, reason(&answer)),
            (code, expected.to_owned()),
            "{address}"
        );
    }
    let bus = bus_without_nodes().await;
    let (exit, answer) = answered(&["can", "--bus", &bus, "--answer-ms", "20", "nodes"]).await;
    assert_eq!((exit, reason(&answer)), (4, "NO_NODES".to_owned()));
    let (exit, answer) = answered(&["can", "eds", "--node-id", "3"]).await;
    let eds = answer["eds"].as_str().unwrap_or_default();
    assert_eq!(exit, 0);
    assert!(
        eds.contains("[6041]\r\nParameterName=statusword"),
        "{answer}"
    );
}

/// A `socketcand` server at whose bus nobody answers.
async fn bus_without_nodes() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let address = listener.local_addr().expect("it is bound");
    tokio::spawn(async move {
        let (mut client, _) = listener.accept().await.expect("a client");
        client.write_all(b"< hi >").await.expect("it reads");
        let mut heard = [0; 4096];
        for _ in ["open", "rawmode"] {
            let asked = client.read(&mut heard).await.expect("it asks");
            assert!(asked > 0, "it left");
            client.write_all(b"< ok >").await.expect("it reads");
        }
        while client.read(&mut heard).await.is_ok_and(|len| len > 0) {}
    });
    format!("socketcand://{address}/can0")
}

/// python canopen's LocalNode on the bench's bus.
struct Slave {
    process: Child,
    orders: ChildStdin,
}

impl Slave {
    async fn set_up(bench: &Bench, folder: &tempfile::TempDir) -> Self {
        let eds = folder.path().join("epos4.eds");
        let eds = eds.to_str().expect("a temporary path is text");
        let (code, written) = answered(&["can", "eds", "--out", eds]).await;
        assert_eq!(code, 0, "{written}");
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/canopen_slave.py");
        let mut process = Command::new(peers::program("python"))
            .args([script, &bench.bus, eds, &SLAVE.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .expect("python starts");
        let orders = process.stdin.take().expect("standard input is piped");
        let stdout = process.stdout.take().expect("standard output is piped");
        let ready = next_line(&mut BufReader::new(stdout).lines()).await;
        assert_eq!(ready, "READY");
        Self { process, orders }
    }

    async fn order(&mut self, line: &str) {
        self.orders
            .write_all(line.as_bytes())
            .await
            .expect("it reads");
    }
}

/// The next event that is meant.
async fn event(events: &mut mpsc::Receiver<Event>, meant: impl Fn(&Event) -> bool) -> Event {
    timeout(LIMIT, async {
        loop {
            let event = events.recv().await.expect("the network runs");
            if meant(&event) {
                return event;
            }
        }
    })
    .await
    .expect("the event in time")
}

#[tokio::test]
async fn our_master_commands_a_slave_that_nobody_here_wrote() {
    let bench = Bench::set_up().await;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bus = bus::connect(&bench.bus).await.expect("the bus opens");
    let (mut network, nodes) = Network::new(bus, Options::default());
    let (heard, mut events) = mpsc::channel(1024);
    tokio::spawn(async move {
        while let Ok(event) = network.next_event().await {
            // Who listens to nothing misses nothing.
            heard.try_send(event).ok();
        }
    });
    let mut slave = Slave::set_up(&bench, &folder).await;
    let of_slave = |wanted: nmt::State| move |event: &Event| matches!(event, Event::Heartbeat { node_id: SLAVE, state, .. } if *state == wanted);
    event(&mut events, of_slave(nmt::State::BootUp)).await;
    let node = nodes.node(SLAVE);

    // Expedited and in segments, both ways.
    assert_eq!(node.read(objects::DEVICE_TYPE).await, Ok(0x0002_0192));
    assert_eq!(node.read(objects::HOMING_METHOD).await, Ok(7));
    let name = node
        .read_bytes(Address::new(0x1008, 0))
        .await
        .expect("a name");
    assert_eq!(name.value, b"EPOS4 as python canopen's LocalNode serves it");
    node.write(objects::TARGET_POSITION, -645_120)
        .await
        .expect("it takes a target");
    assert_eq!(node.read(objects::TARGET_POSITION).await, Ok(-645_120));
    node.write(objects::HOMING_METHOD, -4)
        .await
        .expect("it takes a method");
    assert_eq!(node.read(objects::HOMING_METHOD).await, Ok(-4));
    let long = vec![0xA5; 100];
    node.write_bytes(SCRATCH, &long)
        .await
        .expect("it takes any length");
    let back = node.read_bytes(SCRATCH).await.expect("what was written");
    assert_eq!(back.value, long);

    // Its aborts by name.
    for (address, code) in [
        (Address::new(0x6072, 0), AbortCode::NO_OBJECT),
        (Address::new(0x1018, 9), AbortCode::NO_SUBINDEX),
    ] {
        let refused = node.read_bytes(address).await.expect_err("a refusal");
        assert_eq!(refused.abort_code(), Some(code), "{address}");
    }
    let refused = node
        .write_bytes(objects::CONTROLWORD.address, &[0])
        .await
        .expect_err("a refusal");
    assert_eq!(refused.abort_code(), Some(AbortCode::LENGTH));
    let refused = node
        .write_bytes(objects::STATUSWORD.address, &[0, 0])
        .await
        .expect_err("a refusal");
    assert_eq!(refused.abort_code(), Some(AbortCode::READ_ONLY));

    // NMT, heartbeat, emergency.
    node.write(objects::PRODUCER_HEARTBEAT, 50)
        .await
        .expect("it takes a period");
    for command in [
        nmt::Command::Start,
        nmt::Command::Stop,
        nmt::Command::EnterPreOperational,
    ] {
        node.change_state(command, LIMIT)
            .await
            .expect("its heartbeat tells");
    }
    slave.order("emcy 0x8611 0x80\n").await;
    let Event::Emergency { emergency, .. } = event(&mut events, |event| {
        matches!(event, Event::Emergency { node_id: SLAVE, .. })
    })
    .await
    else {
        panic!("another event than was asked for");
    };
    assert_eq!(
        (
            emergency.code,
            emergency.error_register,
            emergency.manufacturer
        ),
        (0x8611, 0x80, [1, 2, 3, 4, 5])
    );

    // The same by the command line.
    let found = bench.done(&["--answer-ms", "200", "nodes"]).await;
    assert!(
        found["nodes"]
            .as_array()
            .is_some_and(|nodes| nodes.iter().any(|node| node["node"] == SLAVE)),
        "{found}"
    );
    let read = bench.done(&["sdo", "read", "10", "target position"]).await;
    assert_eq!(read["value"], -645_120);
    slave.process.kill().await.expect("python ends");
    bench.teardown().await;
}
