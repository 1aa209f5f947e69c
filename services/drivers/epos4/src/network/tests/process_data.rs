use super::*;
use crate::canopen::object::Value;
use crate::canopen::pdo::{Data, Mapping, Pdo, Transmission};

fn motion() -> Mapping {
    Mapping::new([objects::STATUSWORD.into(), objects::POSITION_ACTUAL.into()]).unwrap()
}

/// A drive whose TPDO 2 is off, as from the factory.
fn world() -> World {
    let mut world = World::new();
    let memory = &mut world.drive.memory.0;
    memory.insert(Address::new(0x1A01, 0), vec![2]);
    world
}

#[tokio::test]
async fn a_mapping_is_written_in_order_and_read_back() {
    let mut world = world();
    let node = world.nodes.node(1);
    let inhibit = Duration::from_millis(10);
    let mapping = motion();
    let mapped = world
        .run(node.map_transmit_pdo(2, &mapping, Transmission::OnChange, inhibit))
        .await;
    assert_eq!(mapped, Ok(()));
    let held = |index, subindex| world.drive.memory.0[&Address::new(index, subindex)].clone();
    assert_eq!(held(0x1801, 1), 0x4000_0281_u32.to_le_vec());
    assert_eq!(held(0x1801, 3), 100_u16.to_le_vec());
    assert_eq!(held(0x1A01, 2), 0x6064_0020_u32.to_le_vec());
    world
        .run(node.turn_off_pdo(Pdo::Transmit(2)))
        .await
        .unwrap();
    let off = &world.drive.memory.0[&Address::new(0x1801, 1)];
    assert_eq!(*off, 0xC000_0281_u32.to_le_vec());
}

#[tokio::test]
async fn a_mapping_that_is_confirmed_and_does_not_last_is_an_error() {
    let mut world = world();
    world.drive.memory.1 = Some((Address::new(0x1801, 3), vec![10, 0]));
    let node = world.nodes.node(1);
    let mapping = motion();
    let mapping = node.map_transmit_pdo(
        2,
        &mapping,
        Transmission::OnChange,
        Duration::from_millis(10),
    );
    let error = world.run(mapping).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "node 1, object 0x1801:03 is [0A, 00] after [64, 00] was written"
    );
}

#[tokio::test]
async fn process_data_are_reported_with_their_stamp() {
    let mut world = World::new();
    let frame = Frame::standard(0x281, [0x37, 0x06, 0x00, 0x54, 0, 0]);
    world.drive.port.send(frame).unwrap();
    let Ok(Event::Pdo {
        node_id,
        number,
        data,
        stamp,
    }) = world.network.next_event().await
    else {
        panic!("no process data");
    };
    assert_eq!((node_id, number, stamp), (1, 2, Duration::ZERO));
    assert_eq!(
        motion().value(objects::POSITION_ACTUAL, &data),
        Some(21_504)
    );
    assert!(world.network.load().share() > 0.0);
}

#[tokio::test]
async fn process_data_to_a_node_are_one_frame() {
    let mut world = World::new();
    let node = world.nodes.node(1);
    let quick_stop = Data::new(&[0x02, 0x00]).unwrap();
    node.send_receive_pdo(1, &quick_stop).await.unwrap();
    let sent = tokio::select! {
        event = world.network.next_event() => panic!("unexpected {event:?}"),
        sent = world.drive.port.receive() => sent.unwrap().frame,
    };
    assert_eq!(sent, Frame::standard(0x201, [0x02, 0x00]));
}

#[tokio::test]
async fn a_bus_without_a_word_still_gets_our_heartbeat_and_sync() {
    let mut world = World::with_options(Options {
        heartbeat: Some((127, Duration::from_millis(20))),
        sync: Some(Duration::from_millis(20)),
        ..Options::default()
    });
    for expected in [
        heartbeat::encode(127, nmt::State::Operational),
        sync::encode(),
        heartbeat::encode(127, nmt::State::Operational),
        sync::encode(),
    ] {
        let sent = tokio::select! {
            event = world.network.next_event() => panic!("unexpected {event:?}"),
            sent = world.drive.port.receive() => sent.unwrap().frame,
        };
        assert_eq!(sent, expected);
    }
}

#[tokio::test]
async fn a_bus_faster_than_real_time_gets_our_heartbeat_in_its_own_time() {
    let mut world = World::with_options(Options {
        // Ten frames of the bus' clock, which counts a millisecond a frame; by real time it is never due.
        heartbeat: Some((127, Duration::from_millis(10))),
        ..Options::default()
    });
    let begun = Instant::now();
    let mut heartbeats = 0;
    for frame in 0..2000 {
        world
            .drive
            .port
            .send(Frame::standard(0x181, [0; 2]))
            .unwrap();
        world.network.next_event().await.unwrap();
        if frame % 2 == 1 {
            continue;
        }
        tokio::select! {
            biased;
            received = world.drive.port.receive() => {
                assert_eq!(received.unwrap().frame.cob_id(), Some(0x77F));
                heartbeats += 1;
            }
            () = std::future::ready(()) => {}
        }
    }
    let real = begun.elapsed().as_millis() as u32 / 10;
    assert!(
        heartbeats >= 100,
        "{heartbeats} heartbeats in {real} periods"
    );
}
