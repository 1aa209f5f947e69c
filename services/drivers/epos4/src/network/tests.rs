mod fuzz;
mod masters;
mod process_data;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use crate::bus::in_process;
use crate::canopen::object::{Address, Object};
use crate::canopen::sdo::AbortCode;
use crate::canopen::sdo::server::{Dictionary, Length, Server};
use crate::frame::Id;
use crate::objects;

/// A network with one node that has a few objects.
struct World {
    network: Network,
    nodes: Nodes,
    drive: Drive,
    micros: Arc<AtomicU64>,
}

struct Drive {
    port: Box<dyn CanBus>,
    server: Server,
    memory: Memory,
    seen: Vec<sdo::Request>,
}

/// The objects, and one that keeps a value of its own whatever is written.
#[derive(Default)]
struct Memory(BTreeMap<Address, Vec<u8>>, Option<(Address, Vec<u8>)>);

impl Dictionary for Memory {
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode> {
        self.0.get(&address).cloned().ok_or(AbortCode::NO_OBJECT)
    }

    fn write(&mut self, address: Address, data: &[u8], _: Length) -> Result<(), AbortCode> {
        let kept = self.1.clone().filter(|(kept, _)| *kept == address);
        let data = kept.map_or_else(|| data.to_vec(), |(_, value)| value);
        self.0.insert(address, data);
        Ok(())
    }
}

impl World {
    fn new() -> Self {
        Self::with_options(Options {
            sdo_timeout: Duration::from_millis(100),
            ..Options::default()
        })
    }

    fn with_options(options: Options) -> Self {
        let micros = Arc::new(AtomicU64::new(0));
        let clock = micros.clone();
        let bus = in_process::Bus::new(move || {
            Duration::from_micros(clock.fetch_add(1000, Ordering::Relaxed))
        });
        let (network, nodes) = Network::new(Box::new(bus.attach()), options);
        let mut memory = Memory::default();
        memory
            .0
            .insert(objects::STATUSWORD.address, vec![0x37, 0x06]);
        memory.0.insert(
            Address::new(0x1008, 0),
            b"EPOS4 Compact 24/1.5 CAN".to_vec(),
        );
        let drive = Drive {
            port: Box::new(bus.attach()),
            server: Server::default(),
            memory,
            seen: Vec::new(),
        };
        Self {
            network,
            nodes,
            drive,
            micros,
        }
    }

    /// Lets network and drive run until `caller` is done.
    async fn run<T>(&mut self, caller: impl Future<Output = T>) -> T {
        tokio::pin!(caller);
        loop {
            tokio::select! {
                done = &mut caller => return done,
                event = self.network.next_event() => panic!("unexpected {event:?}"),
                () = self.drive.answer_one() => {}
            }
        }
    }
}

impl Drive {
    async fn answer_one(&mut self) {
        let request = self.port.receive().await.unwrap().frame;
        if request.cob_id() != Some(0x601) {
            return;
        }
        let request = request.data().try_into().unwrap();
        self.seen.push(sdo::Request::decode(request));
        if let Some(answer) = self.server.answer(request, &mut self.memory) {
            self.port.send(Frame::standard(0x581, answer)).unwrap();
        }
    }
}

#[tokio::test]
async fn typed_objects_are_read_and_written_with_the_time_of_the_bus() {
    let mut world = World::new();
    let node = world.nodes.node(1);
    let (before, reading, name) = world
        .run(async {
            let before = node
                .write(objects::TARGET_POSITION, -215_040)
                .await
                .unwrap();
            let reading = node.read_stamped(objects::TARGET_POSITION).await.unwrap();
            (
                before,
                reading,
                node.read_bytes(Address::new(0x1008, 0))
                    .await
                    .unwrap()
                    .value,
            )
        })
        .await;
    assert_eq!(reading.value, -215_040);
    assert!(reading.stamp > before);
    assert_eq!(
        name, b"EPOS4 Compact 24/1.5 CAN",
        "24 bytes come in segments"
    );
    assert!(world.micros.load(Ordering::Relaxed) > 0);
}

#[tokio::test]
async fn a_refusal_carries_the_abort_code_and_a_wrong_size_is_told() {
    let mut world = World::new();
    let node = world.nodes.node(1);
    let missing = world
        .run(node.read(objects::POSITION_ACTUAL))
        .await
        .unwrap_err();
    assert_eq!(missing.abort_code(), Some(AbortCode::NO_OBJECT));
    let wide: Object<u32> = Object::new(0x6041, 0, "statusword", "");
    let wrong = world.run(node.read(wide)).await.unwrap_err();
    assert_eq!(
        wrong.to_string(),
        "node 1, object 0x6041:00 has 2 bytes, 4 expected"
    );
}

#[tokio::test]
async fn a_silent_node_is_named_and_does_not_hold_up_the_others() {
    let mut world = World::new();
    let (silent, alive) = (world.nodes.node(2), world.nodes.node(1));
    let statusword = objects::STATUSWORD;
    let (failed, read) = world
        .run(async { tokio::join!(silent.read(statusword), alive.read(statusword)) })
        .await;
    assert_eq!(
        failed.unwrap_err().to_string(),
        "node 2 did not answer the request for 0x6041:00 within 0.1 s"
    );
    assert_eq!(read, Ok(0x0637));
}

#[tokio::test]
async fn an_urgent_write_overtakes_and_a_caller_that_is_gone_is_not_served() {
    let mut world = World::new();
    let node = world.nodes.node(1);
    let gone = Box::pin(node.write(objects::CONTROLWORD, 0x001F));
    let (first, second, urgent) = world
        .run(async {
            let mut gone = gone;
            // Polled once, so that the request is queued, and then dropped.
            tokio::select! { biased; _ = &mut gone => panic!("too early"), () = std::future::ready(()) => {} }
            drop(gone);
            tokio::join!(
                node.read(objects::STATUSWORD),
                node.read(objects::STATUSWORD),
                node.write_urgently(objects::CONTROLWORD, 0x0002),
            )
        })
        .await;
    assert!(first.is_ok() && second.is_ok() && urgent.is_ok());
    let written: Vec<_> = world
        .drive
        .seen
        .iter()
        .map(sdo::Request::encode)
        .map(|bytes| (bytes[0], bytes[4]))
        .collect();
    assert_eq!(
        written,
        [(0x40, 0), (0x2B, 0x02), (0x40, 0)],
        "read, quick stop, read; the dropped write never"
    );
}

#[tokio::test]
async fn heartbeats_emergencies_and_bus_errors_are_reported() {
    let mut world = World::new();
    let bus_off = Frame::new(Id::Error(Id::ERROR_BUS_OFF), &[]).unwrap();
    let following_error = Emergency::new(0x8611, 0x80);
    for frame in [
        heartbeat::encode(1, nmt::State::BootUp),
        following_error.encode(1),
        bus_off,
    ] {
        world.drive.port.send(frame).unwrap();
    }
    let appeared = Event::Heartbeat {
        node_id: 1,
        state: nmt::State::BootUp,
        stamp: Duration::ZERO,
    };
    assert_eq!(world.network.next_event().await, Ok(appeared));
    let emergency = Event::Emergency {
        node_id: 1,
        emergency: following_error,
    };
    assert_eq!(world.network.next_event().await, Ok(emergency));
    assert_eq!(
        world.network.next_event().await,
        Ok(Event::BusError {
            report: Report::decode(&bus_off).unwrap()
        })
    );
    assert_eq!(world.network.now(), Duration::from_millis(2));
}

#[tokio::test]
async fn a_node_that_restarts_is_not_waited_for() {
    let mut world = World::new();
    let node = world.nodes.node(2);
    let mut read = Box::pin(node.read(objects::STATUSWORD));
    tokio::select! { biased; _ = &mut read => panic!("too early"), () = std::future::ready(()) => {} }
    // The request is on the bus before the boot-up is heard.
    tokio::select! { event = world.network.next_event() => panic!("{event:?}"), () = world.drive.answer_one() => {} }
    world
        .drive
        .port
        .send(heartbeat::encode(2, nmt::State::BootUp))
        .unwrap();
    assert!(matches!(
        world.network.next_event().await,
        Ok(Event::Heartbeat { node_id: 2, .. })
    ));
    let error = read.await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "node 2 restarted before it answered the request for 0x6041:00"
    );
}
