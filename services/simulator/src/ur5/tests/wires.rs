//! What arrives at clients that speak byte by byte: pacing, read-only ports, faults of links.

use std::io::ErrorKind;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use ur_link::rtde::wire::HEADER_BYTES;

use super::loopback::Cell;
use super::*;
use crate::ur5::link_fault::{Direction, Kind, Service, Spec};
use crate::ur5::servers::{Ports, lock, serve};
use crate::ur5::{Series, ServerOptions, Servers, Shared};

/// An RTDE client that knows frames only.
pub(super) struct Rtde(pub(super) TcpStream);

impl Rtde {
    /// Started with these outputs at this rate.
    async fn started(address: std::net::SocketAddr, rate_hz: f64, names: &str) -> Self {
        let mut client = Self(TcpStream::connect(address).await.unwrap());
        client.ask(b'V', &[0, 2]).await;
        let mut setup = rate_hz.to_be_bytes().to_vec();
        setup.extend(names.as_bytes());
        let answer = client.ask(b'O', &setup).await;
        assert_eq!(answer[0], 1, "{}", String::from_utf8_lossy(&answer[1..]));
        assert_eq!(client.ask(b'S', &[]).await, [1]);
        client
    }

    pub(super) async fn send(&mut self, kind: u8, payload: &[u8]) {
        let size = (payload.len() + HEADER_BYTES) as u16;
        let mut frame = size.to_be_bytes().to_vec();
        frame.push(kind);
        frame.extend(payload);
        self.0.write_all(&frame).await.unwrap();
    }

    pub(super) async fn ask(&mut self, kind: u8, payload: &[u8]) -> Vec<u8> {
        self.send(kind, payload).await;
        loop {
            let (answered, payload) = self.frame().await.unwrap();
            if answered == kind {
                return payload;
            }
        }
    }

    pub(super) async fn frame(&mut self) -> std::io::Result<(u8, Vec<u8>)> {
        let size = usize::from(self.0.read_u16().await?);
        let kind = self.0.read_u8().await?;
        let mut payload = vec![0; size - HEADER_BYTES];
        self.0.read_exact(&mut payload).await?;
        Ok((kind, payload))
    }

    /// The first number of the next data package.
    async fn number(&mut self) -> f64 {
        loop {
            let (kind, payload) = self.frame().await.unwrap();
            if kind == b'U' {
                return f64::from_be_bytes(payload[1..9].try_into().unwrap());
            }
        }
    }
}

/// A controller whose clock the test turns.
pub(super) struct Bound {
    pub(super) controller: Shared,
    pub(super) servers: Servers,
}

impl Bound {
    pub(super) async fn of(series: Series) -> Self {
        let controller: Shared =
            std::sync::Arc::new(std::sync::Mutex::new(Controller::new(Config {
                powered: true,
                ..Config::of(series)
            })));
        let options = ServerOptions {
            ports: Ports::FREE,
            ..ServerOptions::default()
        };
        let servers = serve(controller.clone(), options).await.unwrap();
        Self {
            controller,
            servers,
        }
    }

    pub(super) fn tick(&self, cycles: u32) {
        for _ in 0..cycles {
            lock(&self.controller).tick();
            self.servers.ticked();
        }
    }
}

fn fault(service: Service, kind: Kind, limit: u64) -> Spec {
    Spec {
        service: Some(service),
        direction: Direction::FromController,
        kind,
        share: 1.0,
        limit,
        seed: 1,
    }
}

#[tokio::test]
async fn an_e_series_sends_every_cycle_every_second_or_every_fourth() {
    let arm = Bound::of(Series::E).await;
    let address = arm.servers.addresses().rtde;
    let (mut full, mut half) = (
        Rtde::started(address, 500.0, "timestamp").await,
        Rtde::started(address, 250.0, "timestamp").await,
    );
    let mut quarter = Rtde::started(address, 125.0, "timestamp").await;
    arm.tick(100);
    let mut before = 0.0;
    for cycle in 1..=100 {
        let now = full.number().await;
        assert!(
            (now - before - 0.002).abs() < 1e-9,
            "cycle {cycle}: {before} then {now}"
        );
        before = now;
    }
    let stamps = [half.number().await, half.number().await];
    assert!((stamps[1] - stamps[0] - 0.004).abs() < 1e-9);
    let stamps = [quarter.number().await, quarter.number().await];
    assert!((stamps[1] - stamps[0] - 0.008).abs() < 1e-9);
}

#[tokio::test]
async fn a_rate_beyond_the_controllers_is_every_cycle() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde::started(arm.servers.addresses().rtde, 500.0, "timestamp").await;
    arm.tick(3);
    let stamps = [client.number().await, client.number().await];
    assert!((stamps[1] - stamps[0] - 0.008).abs() < 1e-9);
}

#[tokio::test]
async fn read_only_ports_tell_the_same_and_take_no_programs() {
    let arm = Bound::of(Series::Cb3).await;
    let addresses = arm.servers.addresses();
    for (address, first) in [
        (addresses.primary_read_only, 20),
        (addresses.secondary_read_only, 20),
        (addresses.realtime_read_only, 0),
    ] {
        let mut client = TcpStream::connect(address).await.unwrap();
        client
            .write_all(b"def bad():\n  set_standard_digital_out(0, True)\nend\n")
            .await
            .unwrap();
        if first == 0 {
            // The realtime interface greets nobody: wait until it is known.
            while client.try_read(&mut [0; 4]).is_err() {
                arm.tick(1);
                tokio::task::yield_now().await;
            }
        } else {
            client.read_i32().await.unwrap();
            assert_eq!(client.read_u8().await.unwrap(), first);
        }
        // Whatever was sent has been taken in once the connection is closed by both.
        client.shutdown().await.unwrap();
        let mut rest = Vec::new();
        client.read_to_end(&mut rest).await.unwrap();
        arm.tick(10);
        assert_eq!(lock(&arm.controller).robot.digital_outputs, 0, "{address}");
    }
}

#[tokio::test]
async fn a_program_on_a_port_that_takes_them_runs() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = TcpStream::connect(arm.servers.addresses().primary)
        .await
        .unwrap();
    client
        .write_all(b"def good():\n  set_standard_digital_out(0, True)\nend\n")
        .await
        .unwrap();
    client.shutdown().await.unwrap();
    client.read_to_end(&mut Vec::new()).await.unwrap();
    arm.tick(10);
    assert_eq!(lock(&arm.controller).robot.digital_outputs, 1);
}

#[tokio::test]
async fn version_one_of_the_protocol_has_no_recipe_number() {
    let arm = Bound::of(Series::E).await;
    let mut client = Rtde(
        TcpStream::connect(arm.servers.addresses().rtde)
            .await
            .unwrap(),
    );
    assert_eq!(
        client.ask(b'O', b"timestamp,robot_mode").await,
        b"DOUBLE,INT32"
    );
    assert_eq!(client.ask(b'S', &[]).await, [1]);
    arm.tick(8);
    let (kind, payload) = client.frame().await.unwrap();
    assert_eq!((kind, payload.len()), (b'U', 12));
    assert_eq!(payload[8..], 7i32.to_be_bytes());
}

#[tokio::test]
async fn fields_that_a_version_does_not_have_are_not_found() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde(
        TcpStream::connect(arm.servers.addresses().rtde)
            .await
            .unwrap(),
    );
    client.ask(b'V', &[0, 2]).await;
    let mut setup = 125f64.to_be_bytes().to_vec();
    setup.extend(b"timestamp,ft_raw_wrench,");
    let answer = client.ask(b'O', &setup).await;
    assert_eq!(answer, b"\0DOUBLE,NOT_FOUND");
    assert_eq!(client.ask(b'S', &[]).await, [0]);
}

#[tokio::test]
async fn dropped_packets_are_missing_and_counted() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde::started(arm.servers.addresses().rtde, 125.0, "timestamp").await;
    arm.tick(1);
    let before = client.number().await;
    assert!(
        arm.servers
            .links()
            .inject(7, fault(Service::Rtde, Kind::Drop, 10))
    );
    arm.tick(11);
    let after = client.number().await;
    assert!(
        (after - before - 11.0 * 0.008).abs() < 1e-9,
        "{before} then {after}"
    );
    assert_eq!(arm.servers.links().affected(7), Some(10));
}

#[tokio::test]
async fn dropped_inputs_never_reach_the_controller() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde(
        TcpStream::connect(arm.servers.addresses().rtde)
            .await
            .unwrap(),
    );
    client.ask(b'V', &[0, 2]).await;
    assert_eq!(
        client.ask(b'I', b"input_int_register_24").await,
        b"\x01INT32"
    );
    let lost = Spec {
        direction: Direction::ToController,
        ..fault(Service::Rtde, Kind::Drop, 1)
    };
    arm.servers.links().inject(1, lost);
    client.send(b'U', &[1, 0, 0, 0, 5]).await;
    // The fault is used up, so this one passes, and what was sent before it is settled.
    client.ask(b'v', &[]).await;
    assert_eq!(lock(&arm.controller).robot.inputs.ints[24], 0);
    client.send(b'U', &[1, 0, 0, 0, 5]).await;
    client.ask(b'v', &[]).await;
    assert_eq!(lock(&arm.controller).robot.inputs.ints[24], 5);
}

#[tokio::test]
async fn a_stalled_service_answers_once_it_is_cleared() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde::started(arm.servers.addresses().rtde, 125.0, "timestamp").await;
    arm.servers
        .links()
        .inject(1, fault(Service::Rtde, Kind::Stall, 0));
    client.send(b'v', &[]).await;
    let mut fresh = Rtde(
        TcpStream::connect(arm.servers.addresses().rtde)
            .await
            .unwrap(),
    );
    fresh.send(b'V', &[0, 2]).await;
    while arm.servers.links().affected(1) < Some(200) {
        arm.tick(10);
        tokio::task::yield_now().await;
    }
    for stream in [&client.0, &fresh.0] {
        let nothing = stream.try_read(&mut [0; 8]).unwrap_err();
        assert_eq!(nothing.kind(), ErrorKind::WouldBlock);
    }
    arm.servers.links().clear(Some(1));
    arm.tick(1);
    assert_eq!(client.frame().await.unwrap().0, b'v');
    // Of the states that were lost none comes late.
    let truth_s = lock(&arm.controller).timestamp_s();
    assert!((client.number().await - truth_s).abs() < 1e-9);
    assert_eq!(fresh.frame().await.unwrap(), (b'V', vec![1]));
}

#[tokio::test]
async fn a_reset_ends_connections_old_and_new() {
    let arm = Bound::of(Series::Cb3).await;
    let address = arm.servers.addresses().rtde;
    let mut client = Rtde::started(address, 125.0, "timestamp").await;
    arm.servers
        .links()
        .inject(1, fault(Service::Rtde, Kind::Reset, 2));
    let error = client.frame().await.unwrap_err();
    assert_eq!(error.kind(), ErrorKind::ConnectionReset);
    let mut second = TcpStream::connect(address).await.unwrap();
    let error = second.read_u8().await.unwrap_err();
    assert_eq!(error.kind(), ErrorKind::ConnectionReset);
    // Both that were meant are gone.
    Rtde::started(address, 125.0, "timestamp").await;
    assert_eq!(arm.servers.links().affected(1), Some(2));
}

#[tokio::test]
async fn a_half_open_service_takes_connections_and_says_nothing() {
    let arm = Bound::of(Series::Cb3).await;
    let address = arm.servers.addresses().dashboard;
    let mut old = TcpStream::connect(address).await.unwrap();
    old.read_exact(&mut [0; 45]).await.unwrap();
    arm.servers
        .links()
        .inject(1, fault(Service::Dashboard, Kind::HalfOpen, 0));
    let mut new = TcpStream::connect(address).await.unwrap();
    new.write_all(b"robotmode\n").await.unwrap();
    old.write_all(b"power off\n").await.unwrap();
    while arm.servers.links().affected(1) < Some(2) {
        tokio::task::yield_now().await;
    }
    for stream in [&old, &new] {
        let nothing = stream.try_read(&mut [0; 8]).unwrap_err();
        assert_eq!(nothing.kind(), ErrorKind::WouldBlock);
    }
    assert_eq!(lock(&arm.controller).robot_mode(), RobotMode::Running);
    arm.servers.links().clear(None);
    old.write_all(b"robotmode\n").await.unwrap();
    let mut answer = [0; 19];
    old.read_exact(&mut answer).await.unwrap();
    assert_eq!(&answer, b"Robotmode: RUNNING\n");
}

#[tokio::test]
async fn reordered_packets_come_after_their_successors() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde::started(arm.servers.addresses().rtde, 125.0, "timestamp").await;
    arm.servers
        .links()
        .inject(1, fault(Service::Rtde, Kind::Reorder, 1));
    arm.tick(3);
    let stamps = [
        client.number().await,
        client.number().await,
        client.number().await,
    ];
    assert!(stamps[1] < stamps[0] && stamps[0] < stamps[2], "{stamps:?}");
}

#[tokio::test]
async fn delayed_packets_come_by_the_controllers_clock() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = Rtde::started(arm.servers.addresses().rtde, 125.0, "timestamp").await;
    let by = std::time::Duration::from_millis(80);
    arm.servers
        .links()
        .inject(1, fault(Service::Rtde, Kind::Delay(by), 0));
    arm.tick(10);
    let nothing = client.0.try_read(&mut [0; 8]).unwrap_err();
    assert_eq!(nothing.kind(), ErrorKind::WouldBlock);
    arm.tick(20);
    let truth_s = lock(&arm.controller).timestamp_s();
    let mut newest = 0.0;
    for _ in 0..20 {
        newest = client.number().await;
    }
    assert!(
        (truth_s - newest - 0.08).abs() < 0.0081,
        "{truth_s} and {newest}"
    );
}

#[tokio::test]
async fn a_named_field_is_not_a_number_now_and_then() {
    let arm = Bound::of(Series::Cb3).await;
    let address = arm.servers.addresses().rtde;
    let mut client = Rtde::started(address, 125.0, "speed_scaling,actual_q").await;
    let kind = Kind::NotANumber {
        field: Some("speed_scaling".to_owned()),
    };
    arm.servers.links().inject(1, fault(Service::Rtde, kind, 1));
    arm.tick(2);
    assert!(client.number().await.is_nan());
    assert_eq!(client.number().await, 1.0);
}

#[tokio::test]
async fn a_corrupt_answer_differs_in_one_byte() {
    let arm = Bound::of(Series::Cb3).await;
    let mut client = TcpStream::connect(arm.servers.addresses().dashboard)
        .await
        .unwrap();
    client.read_exact(&mut [0; 45]).await.unwrap();
    arm.servers
        .links()
        .inject(1, fault(Service::Dashboard, Kind::Corrupt, 1));
    client.write_all(b"robotmode\n").await.unwrap();
    let mut answer = [0; 19];
    client.read_exact(&mut answer).await.unwrap();
    let differing = answer
        .iter()
        .zip(b"Robotmode: RUNNING\n")
        .filter(|(a, b)| a != b);
    assert_eq!(differing.count(), 1);
}

#[tokio::test]
async fn services_can_lie_about_the_version_each_by_itself() {
    let arm = Bound::of(Series::Cb3).await;
    let lie = "3.3.0.1".parse().unwrap();
    lock(&arm.controller).claim_version(crate::ur5::Teller::Rtde, Some(lie));
    let mut client = Rtde(
        TcpStream::connect(arm.servers.addresses().rtde)
            .await
            .unwrap(),
    );
    let told = client.ask(b'v', &[]).await;
    assert_eq!(told[..8], [0, 0, 0, 3, 0, 0, 0, 3]);
    let truth = lock(&arm.controller).dashboard("PolyscopeVersion");
    assert!(truth.starts_with("URSoftware 3.15.8"), "{truth}");
}

#[tokio::test]
async fn two_arms_have_the_standard_ports_of_two_addresses() {
    let number = std::process::id();
    let host = |last: u8| {
        let (second, third) = (100 + (number >> 8 & 0x1f) as u8, number as u8);
        std::net::Ipv4Addr::new(127, second, third, last)
    };
    let mut arms = Vec::new();
    for last in [11, 12] {
        let controller = Controller::new(Config::default());
        let controller: Shared = std::sync::Arc::new(std::sync::Mutex::new(controller));
        let options = ServerOptions {
            bind: host(last).into(),
            ..ServerOptions::default()
        };
        arms.push(serve(controller, options).await.unwrap());
    }
    for (arm, last) in arms.iter().zip([11, 12]) {
        for (name, address) in arm.addresses().named() {
            assert_eq!(address.ip(), host(last), "{name}");
            TcpStream::connect(address).await.unwrap();
        }
        assert_eq!(arm.addresses().realtime_read_only.port(), 30013);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn random_bytes_end_a_connection_at_most() {
    use rand::{Rng, SeedableRng};
    let cell = Cell::start(Config {
        powered: true,
        ..Config::default()
    })
    .await;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
    let addresses = cell.addresses();
    for round in 0..400 {
        let services = [addresses.rtde, addresses.dashboard];
        let address = services[round % services.len()];
        let mut stream = TcpStream::connect(address).await.unwrap();
        for _ in 0..rng.random_range(1..40) {
            let mut payload = vec![0; rng.random_range(0..60)];
            rng.fill(&mut payload[..]);
            let kinds = b"VvMUOISPx";
            let size = (payload.len() + 3) as u16;
            let mut bytes = size.to_be_bytes().to_vec();
            bytes.push(kinds[rng.random_range(0..kinds.len())]);
            bytes.extend(&payload);
            if address == addresses.dashboard {
                bytes.push(b'\n');
            }
            if stream.write_all(&bytes).await.is_err() {
                break;
            }
        }
        let _ = stream.shutdown().await;
    }
    let mut client = Rtde(TcpStream::connect(addresses.rtde).await.unwrap());
    assert_eq!(client.ask(b'V', &[0, 2]).await, [1]);
}
