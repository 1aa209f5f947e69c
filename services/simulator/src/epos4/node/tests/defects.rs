//! Each fault as a master meets it.

use super::*;

/// A move of the enabled drive in profile position mode.
fn moving(rig: &mut Rig) {
    rig.enable();
    rig.write(0x607A, 0, &100_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
}

#[test]
fn a_dropped_node_is_dead_coasts_and_boots_again_without_a_reference() {
    let mut rig = Rig::feed(9000.0);
    rig.write(0x1017, 0, &100_u16.to_le_bytes());
    rig.home(37, 1.0);
    rig.write(0x6060, 0, &[1]);
    moving(&mut rig);
    let id = rig.inject(Fault::DropNode);
    rig.sent.clear();
    rig.send(Frame::standard(
        0x602,
        Request::Upload(Address::new(0x6041, 0)).encode(),
    ));
    rig.run(1.0);
    assert_eq!(rig.sent, []);
    let stood_qc = rig.node().position_quadcounts();
    assert_eq!(rig.node().speed_quadcounts_s(), 0.0);
    rig.clear(id);
    rig.run(STEP_S);
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x00])]);
    assert_eq!((rig.state(), rig.has(15)), (State::SwitchOnDisabled, false));
    assert_eq!(rig.node().position_quadcounts(), stood_qc);
}

#[test]
fn heartbeats_come_later() {
    let mut rig = Rig::new();
    rig.write(0x1017, 0, &100_u16.to_le_bytes());
    rig.run(0.15);
    rig.inject(Fault::LateHeartbeat(0.25));
    rig.sent.clear();
    rig.run(0.28);
    assert_eq!(rig.sent, [], "100 ms after the last one is 250 ms late");
    rig.run(0.1);
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x7F])]);
    assert!(rig.affected() >= 1);
}

#[test]
fn an_emergency_is_raised_once_with_its_reaction() {
    for (code, register, stops) in [
        (0x7380, 0x20, State::Fault),
        (0x8120, 0x10, State::FaultReactionActive),
    ] {
        let mut rig = Rig::new();
        rig.home(37, 1.0);
        rig.write(0x6060, 0, &[1]);
        moving(&mut rig);
        rig.inject(Fault::Emergency(code));
        assert_eq!(rig.node().drive_state(), stops, "{code:X}");
        rig.run(0.5);
        assert_eq!((rig.state(), rig.emergencies()), (State::Fault, vec![code]));
        assert_eq!(rig.read(0x1001, 0), register);
        assert_eq!(
            rig.has(15),
            code != 0x7380,
            "a sensor error takes the reference"
        );
    }
}

#[test]
fn a_frozen_encoder_lets_the_motor_run_away_until_the_following_error() {
    let mut rig = Rig::new();
    moving(&mut rig);
    let seen_qc = rig.read(0x6064, 0);
    let true_qc = rig.node().position_quadcounts();
    rig.inject(Fault::FrozenEncoder);
    rig.run_until(1.0, |rig| rig.state() == State::Fault);
    rig.run(0.5);
    assert_eq!(rig.emergencies(), [0x8611]);
    assert_eq!(rig.read(0x6064, 0), seen_qc);
    let ran_qc = rig.node().position_quadcounts() - true_qc;
    assert!(ran_qc > 1500.0, "{ran_qc}");
}

#[test]
fn a_slipping_belt_leaves_the_mechanism_behind_unseen() {
    let mut rig = Rig::new();
    rig.inject(Fault::SlippingBelt(0.2));
    rig.enable();
    rig.move_to(10_000, 3.0);
    assert_eq!((rig.read(0x6064, 0), rig.emergencies()), (10_000, vec![]));
    let true_qc = rig.node().position_quadcounts();
    assert!((true_qc - 8000.0).abs() < 1.0, "{true_qc}");
}

#[test]
fn a_jammed_shaft_draws_its_limit_and_is_a_following_error() {
    let mut rig = Rig::new();
    moving(&mut rig);
    rig.inject(Fault::Jam);
    rig.run(0.02);
    let stuck_qc = rig.node().position_quadcounts();
    assert_eq!(rig.read(0x30D1, 2), 800);
    rig.run_until(1.0, |rig| rig.state() == State::Fault);
    assert_eq!(rig.emergencies(), [0x8611]);
    assert_eq!(rig.node().position_quadcounts(), stuck_qc);
}

#[test]
fn a_cut_wire_stops_an_axis_with_a_normally_closed_switch_and_blinds_one_with_an_open_one() {
    for (contact, polarity, stops) in [
        (Contact::NormallyClosed, 0b1_u16, true),
        (Contact::NormallyOpen, 0, false),
    ] {
        let mut config = NodeConfig::new(2, 1);
        config
            .parameters
            .push((objects::INPUT_POLARITY.address, i64::from(polarity)));
        config.position_qc = 60_000.0;
        let mut rig = Rig::with(config, move |position_qc| {
            let mut inputs = [Input::default(); INPUT_COUNT];
            inputs[0] = Input::new(contact, position_qc < 0.0);
            Mechanics {
                hard_stop_low_qc: Some(-1000.0),
                inputs,
                ..Mechanics::default()
            }
        });
        assert_eq!(rig.read(0x60FD, 0), 0, "free");
        rig.enable();
        rig.write(0x607A, 0, &(-50_000_i32).to_le_bytes());
        rig.control(0x1F);
        rig.run(0.5);
        rig.inject(Fault::CutWire(1));
        rig.run(0.5);
        let expected = if stops { vec![0x8A80] } else { vec![] };
        assert_eq!(rig.emergencies(), expected, "{contact:?}");
        assert_eq!(rig.read(0x60FD, 0), i64::from(stops));
    }
}

#[test]
fn a_switch_pressed_by_hand_shows_in_its_function() {
    let mut rig = Rig::feed(9000.0);
    let id = rig.inject(Fault::PressedSwitch(3));
    rig.run(STEP_S);
    assert_eq!((rig.read(0x3141, 1), rig.read(0x60FD, 0)), (0b100, 0b100));
    rig.clear(id);
    rig.run(STEP_S);
    assert_eq!(rig.read(0x60FD, 0), 0);
}

#[test]
fn sdo_answers_come_late_or_never() {
    let upload = Frame::standard(0x602, Request::Upload(Address::new(0x1000, 0)).encode());
    let mut rig = Rig::new();
    let id = rig.inject(Fault::SlowSdo(0.2));
    rig.sent.clear();
    rig.send(upload);
    rig.run(0.19);
    assert_eq!(rig.sent, []);
    rig.run(0.02);
    assert_eq!((rig.sent.len(), rig.sent[0].cob_id()), (1, Some(0x582)));
    rig.clear(id);
    rig.inject(Fault::SilentSdo);
    rig.sent.clear();
    rig.send(upload);
    rig.run(5.0);
    assert_eq!((rig.sent.len(), rig.affected()), (0, 1));
}

#[test]
fn process_data_are_lost_or_changed_by_a_bit() {
    for fault in [Fault::LostPdo(1.0), Fault::CorruptFrame(1.0)] {
        let mut rig = Rig::new();
        rig.sent.clear();
        rig.inject(fault);
        rig.nmt(Command::Start);
        rig.run(0.01);
        let expected = [0x40_u8, 0x02];
        match rig.sent[..] {
            [] => assert_eq!(fault, Fault::LostPdo(1.0)),
            [pdo] => {
                let ones = pdo
                    .data()
                    .iter()
                    .zip(expected)
                    .map(|(a, b)| (a ^ b).count_ones());
                assert_eq!(ones.sum::<u32>(), 1, "{pdo:?}");
            }
            ref more => panic!("{more:?}"),
        }
        assert_eq!(rig.affected(), 1);
    }
}

#[test]
fn a_second_node_with_the_same_id_boots_and_answers_too() {
    let mut rig = Rig::new();
    let id = rig.inject(Fault::DuplicateNode);
    rig.sent.clear();
    rig.run(STEP_S);
    assert_eq!(rig.sent, [Frame::standard(0x702, [0x00])]);
    let upload = Frame::standard(0x602, Request::Upload(Address::new(0x1018, 4)).encode());
    rig.sent.clear();
    rig.send(upload);
    assert_eq!(rig.sent.len(), 2);
    assert_ne!(rig.sent[0], rig.sent[1], "two serial numbers");
    rig.clear(id);
    rig.sent.clear();
    rig.send(upload);
    assert_eq!(rig.sent.len(), 1);
}

#[test]
fn identity_and_gear_read_as_another_drives() {
    let mut rig = Rig::new();
    let identity = rig.inject(Fault::WrongIdentity(0x6150_0000));
    let gear = rig.inject(Fault::SwappedGear(4, 1));
    assert_eq!((rig.read(0x1018, 2), rig.read(0x3003, 1)), (0x6150_0000, 4));
    rig.nmt(Command::ResetNode);
    rig.run(STEP_S);
    assert_eq!(rig.read(0x3003, 1), 4, "a restart does not mend it");
    rig.clear(identity);
    rig.clear(gear);
    assert_eq!(
        (rig.read(0x1018, 2), rig.read(0x3003, 1)),
        (0x6050_0000, 21)
    );
}

#[test]
fn a_fault_of_another_node_leaves_this_one_alone_and_too_many_are_refused() {
    let mut rig = Rig::new();
    rig.drives.inject(Some(3), Fault::DropNode, 0).unwrap();
    assert_eq!(rig.read(0x1000, 0), 0x0002_0192);
    let taken = (0..100).filter(|_| rig.drives.inject(None, Fault::Jam, 0).is_some());
    assert_eq!(taken.count(), crate::epos4::MAX_FAULTS - 1);
}
