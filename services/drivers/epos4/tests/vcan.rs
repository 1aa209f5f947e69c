//! The kernel's SocketCAN, on a machine that has it: `ARTHRO_VCAN=vcan0 cargo test -p epos4-link --test vcan -- --ignored`.
//! `ARTHRO_VCAN=can0,can1` names two interfaces on one bus. Needs the right to make interfaces.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, missing_docs)]

use std::time::Duration;

use epos4_link::bus::socketcan::{Interface, netlink, open};
use epos4_link::bus::{CanBus, Error};
use epos4_link::frame::error::{Class, ControllerState, Report};
use epos4_link::frame::{Frame, Id, Stamped};
use socketcan::{CanErrorFrame, CanInterface, CanSocket, Socket};
use tokio::sync::Mutex;
use tokio::time::timeout;

/// The tests share a bus: one at a time.
static ALONE: Mutex<()> = Mutex::const_new(());

/// Names of two interfaces on one bus, which may be the same.
fn names() -> (String, String) {
    let names = std::env::var("ARTHRO_VCAN").expect("ARTHRO_VCAN names a can interface, or two");
    match names.split_once(',') {
        Some((first, second)) => (first.to_owned(), second.to_owned()),
        None => (names.clone(), names),
    }
}

fn pair() -> (Interface, Interface) {
    let (first, second) = names();
    (open(&first).unwrap(), open(&second).unwrap())
}

async fn receive(bus: &mut Interface) -> Result<Stamped, Error> {
    let bus: &mut dyn CanBus = bus;
    timeout(Duration::from_secs(5), bus.receive())
        .await
        .expect("something comes within 5 s")
}

#[tokio::test]
#[ignore = "needs a can interface, see the head of this file"]
async fn frames_of_every_form_arrive_stamped_and_the_sender_does_not_hear_them() {
    let _alone = ALONE.lock().await;
    let (mut near, mut far) = pair();
    let sent = [
        Frame::standard(0x601, [0x40, 0x41, 0x60, 0, 0, 0, 0, 0]),
        Frame::standard(0x080, []),
        Frame::new(Id::extended(0x1ABC_DEF0), &[1, 2, 3]).unwrap(),
    ];
    for frame in sent {
        near.send(frame).unwrap();
    }
    let mut last = Duration::ZERO;
    for frame in sent {
        let received = receive(&mut far).await.unwrap();
        assert_eq!(received.frame, frame);
        assert!(received.stamp >= last && received.stamp > Duration::from_secs(1_000_000_000));
        last = received.stamp;
    }
    let answer = Frame::standard(0x581, [0x43; 8]);
    far.send(answer).unwrap();
    assert_eq!(receive(&mut near).await.unwrap().frame, answer);
}

#[tokio::test]
#[ignore = "needs a can interface, see the head of this file"]
async fn what_the_controller_reports_is_received_with_its_details() {
    let _alone = ALONE.lock().await;
    let (first, _) = names();
    let mut bus = open(&first).unwrap();
    let controller = CanSocket::open(&first).unwrap();
    let reports = [
        (Class::BUS_OFF, [0; 8], ControllerState::BusOff),
        (
            Class::CONTROLLER | Class::NO_ACKNOWLEDGE | Class::COUNTERS,
            [0, 0x20, 0, 0, 0, 0, 128, 5],
            ControllerState::ErrorPassive,
        ),
        (Class::RESTARTED, [0; 8], ControllerState::ErrorActive),
    ];
    for (classes, data, state) in reports {
        let frame = CanErrorFrame::new_error(classes, &data).unwrap();
        controller
            .write_frame(&socketcan::CanFrame::Error(frame))
            .unwrap();
        let report = Report::decode(&receive(&mut bus).await.unwrap().frame).unwrap();
        assert_eq!((report.classes(), report.state()), (classes, Some(state)));
    }
    let still_there = Frame::standard(0x701, [5]);
    let (_, second) = names();
    open(&second).unwrap().send(still_there).unwrap();
    assert_eq!(receive(&mut bus).await.unwrap().frame, still_there);
}

/// Where the interface has a queue of its own, this fills it (ENOBUFS). Heard by another socket of the same interface,
/// which the kernel tells what the controller has sent.
#[tokio::test]
#[ignore = "needs a can interface, see the head of this file"]
async fn a_flood_waits_for_the_interface_and_is_sent_whole_and_in_order() {
    const FRAMES: u32 = 5000;
    let _alone = ALONE.lock().await;
    let (first, _) = names();
    let (mut near, mut beside) = (open(&first).unwrap(), open(&first).unwrap());
    let (mut sent, mut heard, mut waits) = (0, 0, 0);
    while heard < FRAMES {
        // Less than what the kernel keeps for a socket that is not read.
        if sent < FRAMES && sent - heard < 200 {
            match near.send(Frame::standard(0x123, u32::to_le_bytes(sent))) {
                Ok(()) => {
                    sent += 1;
                    continue;
                }
                Err(Error::QueueFull) => waits += 1,
                Err(error) => panic!("{error}"),
            }
        }
        tokio::select! {
            biased;
            received = receive(&mut beside) => {
                assert_eq!(received.unwrap().frame.data(), u32::to_le_bytes(heard));
                heard += 1;
            }
            // Asking for a frame carries what waits.
            received = receive(&mut near) => panic!("nobody else sends: {received:?}"),
        }
    }
    println!("{FRAMES} frames, the queue was full {waits} times");
}

#[tokio::test]
#[ignore = "needs a can interface, see the head of this file"]
async fn an_interface_that_goes_down_or_away_is_told_so() {
    let _alone = ALONE.lock().await;
    let link = CanInterface::create_vcan("arthro9", None).unwrap();
    let down = open("arthro9").unwrap_err();
    assert!(down.to_string().contains("is down"), "{down}");
    assert!(!netlink::state("arthro9").unwrap().up);
    link.bring_up().unwrap();
    assert!(netlink::state("arthro9").unwrap().up);
    let mut bus = open("arthro9").unwrap();
    link.bring_down().unwrap();
    let error = receive(&mut bus).await.unwrap_err();
    assert!(
        error.to_string().contains("arthro9: the interface is down"),
        "{error}"
    );
    assert_eq!(bus.send(Frame::standard(0, [])), Err(error));
    link.bring_up().unwrap();
    let mut bus = open("arthro9").unwrap();
    link.delete().unwrap();
    let error = receive(&mut bus).await.unwrap_err();
    assert!(error.to_string().contains("arthro9: "), "{error}");
}

#[tokio::test]
#[ignore = "needs a can interface, see the head of this file"]
async fn the_kernel_tells_the_state_of_the_interface() {
    let _alone = ALONE.lock().await;
    let (first, _) = names();
    let state = netlink::state(&first).unwrap();
    assert!(state.up);
    if first.starts_with('v') {
        assert_eq!((state.state, state.bitrate), (None, None));
    } else {
        assert_eq!(state.state, Some(ControllerState::ErrorActive));
        assert!(state.bitrate.is_some_and(|bitrate| bitrate > 0));
    }
    assert!(netlink::restart(&first).is_err(), "it is not bus-off");
}
