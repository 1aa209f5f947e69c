//! Identity, network management, heartbeats and the SDO server.

use super::*;

#[test]
fn a_drive_announces_itself_and_then_beats() {
    let mut rig = Rig::new();
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x00])]);
    rig.write(0x1017, 0, &100_u16.to_le_bytes());
    rig.sent.clear();
    rig.run(1.0);
    assert_eq!(rig.sent.len(), 10);
    assert!(
        rig.sent
            .iter()
            .all(|frame| *frame == Frame::standard(0x702, [0x7F]))
    );
    rig.nmt(Command::Start);
    rig.sent.clear();
    rig.run(0.1);
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x05])]);
    rig.nmt(Command::ResetNode);
    rig.sent.clear();
    rig.run(1.0);
    assert_eq!(
        rig.sent,
        [Frame::standard(0x702, [0x00])],
        "the unsaved heartbeat time is gone"
    );
}

#[test]
fn the_identity_is_that_of_the_papers_drive() {
    let mut rig = Rig::new();
    assert_eq!(rig.read(0x1018, 1), 0x0000_00FB);
    assert_eq!(rig.read(0x1018, 2), 0x6050_0000);
    assert_eq!(rig.read(0x1018, 3), 0x0170_0000);
    assert_eq!(rig.read(0x1018, 4), 4711);
    assert_eq!(rig.read(0x3000, 5), 2048);
    assert_eq!(rig.read(0x6502, 0), 0x3A5);
    assert_eq!(
        rig.request(&Request::Upload(Address::new(0x1008, 0))),
        Response::Upload(
            Address::new(0x1008, 0),
            Initiate::Segmented { size: Some(5) }
        )
    );
    match rig.request(&Request::UploadSegment { toggle: false }) {
        Response::UploadSegment(segment) => assert_eq!(
            (segment.payload.as_slice(), segment.last),
            (&b"EPOS4"[..], true)
        ),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_stopped_node_answers_nothing() {
    let mut rig = Rig::new();
    rig.nmt(Command::Stop);
    let upload = Request::Upload(Address::new(0x1018, 1)).encode();
    rig.sent.clear();
    rig.send(Frame::standard(0x602, upload));
    assert_eq!(rig.sent, []);
    rig.nmt(Command::EnterPreOperational);
    assert_eq!(rig.read(0x1018, 1), 0xFB);
}

#[test]
fn a_lost_master_heartbeat_stops_the_motion() {
    let mut rig = Rig::new();
    rig.write(0x1016, 1, &(0x7F_0000_u32 | 300).to_le_bytes());
    rig.nmt(Command::Start);
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    assert_eq!(
        rig.state(),
        State::OperationEnabled,
        "no heartbeat yet, nothing to lose"
    );
    for _ in 0..10 {
        rig.send(heartbeat::encode(0x7F, NmtState::Operational));
        rig.run(0.1);
    }
    assert_eq!(rig.state(), State::OperationEnabled);
    let took_s = rig.run_until(1.0, |rig| rig.state() == State::Fault);
    assert!((0.2..0.35).contains(&took_s), "{took_s}");
    rig.run(0.01);
    assert_eq!((rig.emergencies(), rig.read(0x606C, 0)), (vec![0x8130], 0));
    assert_eq!(rig.read(0x1001, 0), 0x10);
    assert!(!rig.has(9), "back in pre-operational");
}

#[test]
fn an_nmt_stop_brings_a_moving_drive_to_a_stand() {
    let mut rig = Rig::new();
    rig.nmt(Command::Start);
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    rig.nmt(Command::Stop);
    rig.run(0.5);
    assert_eq!(rig.node().drive_state(), State::SwitchOnDisabled);
    let position_qc = rig.node().position_quadcounts();
    rig.run(0.5);
    assert_eq!(rig.node().position_quadcounts(), position_qc);
}

#[test]
fn a_restart_forgets_the_reference_but_not_the_place() {
    let mut rig = Rig::feed(9000.0);
    rig.home(37, 1.0);
    assert!(rig.has(15));
    rig.nmt(Command::ResetNode);
    rig.run(0.01);
    assert!(!rig.has(15));
    assert_eq!(
        (rig.state(), rig.read(0x6064, 0)),
        (State::SwitchOnDisabled, 0)
    );
    assert_eq!(rig.node().position_quadcounts(), 9000.0);
}

#[test]
fn block_transfer_is_refused_as_unknown() {
    let mut rig = Rig::new();
    let response = rig.request(&Request::Other(0xA0));
    assert!(
        matches!(response, Response::Abort(_, AbortCode::UNKNOWN_COMMAND)),
        "{response:?}"
    );
}
