use super::*;

const HEARTBEAT: Duration = Duration::from_millis(100);

/// Frames of others, and what is told of them. The bus' clock counts a millisecond a frame.
async fn told(world: &mut World, frames: impl IntoIterator<Item = Frame>) -> Vec<Event> {
    for frame in frames {
        world.drive.port.send(frame).unwrap();
    }
    // Ends the story.
    world
        .drive
        .port
        .send(heartbeat::encode(99, nmt::State::Stopped))
        .unwrap();
    let mut events = Vec::new();
    loop {
        match world.network.next_event().await.unwrap() {
            Event::Heartbeat { node_id: 99, .. } => return events,
            event => events.push(event),
        }
    }
}

fn watching() -> World {
    World::with_options(Options {
        sdo_timeout: Duration::from_millis(100),
        node_heartbeat: Some(HEARTBEAT),
        heartbeat: Some((127, Duration::from_secs(3600))),
        ..Options::default()
    })
}

#[tokio::test]
async fn two_nodes_of_one_number_are_told_by_their_heartbeats() {
    let mut world = watching();
    let heartbeats = [heartbeat::encode(1, nmt::State::Operational); 5];
    let events = told(&mut world, heartbeats).await;
    let duplicate = Event::DuplicateNode {
        node_id: 1,
        evidence: Evidence::Heartbeats,
    };
    assert_eq!(events.last(), Some(&duplicate));
    // A heartbeat that we set anew ourselves is no sign of a second node.
    let mut world = watching();
    let node = world.nodes.node(1);
    told(&mut world, heartbeats[..4].to_vec()).await;
    world
        .drive
        .memory
        .0
        .insert(objects::PRODUCER_HEARTBEAT.address, vec![0, 0]);
    world
        .run(node.write(objects::PRODUCER_HEARTBEAT, 100))
        .await
        .unwrap();
    let events = told(&mut world, heartbeats[..4].to_vec()).await;
    assert!(!events.contains(&duplicate), "{events:?}");
}

#[tokio::test]
async fn two_nodes_of_one_number_are_told_by_the_second_answer() {
    let mut world = watching();
    let node = world.nodes.node(1);
    world.run(node.read(objects::STATUSWORD)).await.unwrap();
    let second = [0x4B, 0x41, 0x60, 0, 0x40, 0, 0, 0];
    let events = told(&mut world, [Frame::standard(0x581, second)]).await;
    let duplicate = Event::DuplicateNode {
        node_id: 1,
        evidence: Evidence::SecondAnswer,
    };
    assert_eq!(events, [duplicate]);
}

#[tokio::test]
async fn a_late_answer_is_no_second_node() {
    let mut world = watching();
    let silent = world.nodes.node(2);
    world
        .run(silent.read(objects::STATUSWORD))
        .await
        .unwrap_err();
    let late = [0x4B, 0x41, 0x60, 0, 0x40, 0, 0, 0];
    assert_eq!(told(&mut world, [Frame::standard(0x582, late)]).await, []);
}

#[tokio::test]
async fn another_master_is_told_once_and_its_answers_are_no_second_node() {
    let mut world = watching();
    let request = Frame::standard(0x602, [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]);
    let answer = Frame::standard(0x582, [0x4B, 0x41, 0x60, 0, 0x40, 0, 0, 0]);
    let events = told(&mut world, [request, answer, request, answer]).await;
    let sdo = Event::OtherMaster {
        sign: Sign::SdoRequest,
    };
    assert_eq!(events, [sdo]);
    let nmt = nmt::encode(nmt::Command::Stop, nmt::Target::All);
    let twin = heartbeat::encode(127, nmt::State::Operational);
    let events = told(&mut world, [nmt, twin]).await;
    let signs: Vec<Sign> = events
        .iter()
        .filter_map(|event| match event {
            Event::OtherMaster { sign } => Some(*sign),
            _ => None,
        })
        .collect();
    assert_eq!(signs, [Sign::NmtCommand, Sign::Heartbeat]);
}

#[tokio::test]
async fn an_ordered_state_is_waited_for_and_its_absence_told() {
    let mut world = World::new();
    let node = world.nodes.node(1);
    let order = node.change_state(nmt::Command::Start, Duration::from_secs(60));
    tokio::pin!(order);
    let reached = loop {
        tokio::select! {
            reached = &mut order => break reached,
            event = world.network.next_event() => {
                assert!(matches!(event, Ok(Event::Heartbeat { node_id: 1, .. })));
            }
            frame = world.drive.port.receive() => {
                assert_eq!(nmt::decode(&frame.unwrap().frame).unwrap().0, nmt::Command::Start);
                for state in [nmt::State::PreOperational, nmt::State::Operational] {
                    world.drive.port.send(heartbeat::encode(1, state)).unwrap();
                }
            }
        }
    };
    assert!(reached.is_ok());
    let late = node.change_state(nmt::Command::ResetNode, Duration::from_millis(20));
    let error = world.run(late).await.unwrap_err();
    assert_eq!(
        error.to_string(),
        "node 1 is silent and not BOOT_UP 0.02 s after the order"
    );
}

#[tokio::test]
async fn a_scan_names_those_that_answer() {
    let mut world = World::new();
    let memory = &mut world.drive.memory.0;
    memory.insert(objects::DEVICE_TYPE.address, vec![0x92, 0x01, 0x02, 0x00]);
    memory.insert(objects::VENDOR_ID.address, vec![0xFB, 0, 0, 0]);
    let nodes = world.nodes.clone();
    let found = world
        .run(nodes.scan(1..=127, Duration::from_millis(30)))
        .await
        .unwrap();
    let expected = Found {
        node_id: 1,
        device_type: 0x0002_0192,
        device_name: Some("EPOS4 Compact 24/1.5 CAN".to_owned()),
        identity: Identity {
            vendor_id: 0xFB,
            ..Identity::default()
        },
    };
    assert_eq!(found, [expected]);
}
