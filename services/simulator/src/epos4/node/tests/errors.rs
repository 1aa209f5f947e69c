//! Errors: what raises them, how the drive answers, how they go.

use super::*;

#[test]
fn a_blocked_shaft_is_a_following_error_until_reset() {
    let mut rig = Rig::feed(29_000.0);
    rig.enable();
    rig.write(0x607A, 0, &50_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run_until(2.0, |rig| rig.state() == State::Fault);
    assert_eq!(rig.emergencies(), [0x8611]);
    assert_eq!((rig.read(0x603F, 0), rig.read(0x1001, 0)), (0x8611, 0x80));
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (1, 0x8611));
    assert!(rig.has(13));
    assert_eq!(rig.read(0x30D1, 2), 0);
    // The level alone resets nothing, the edge does.
    rig.control(0x0F);
    assert_eq!(rig.state(), State::Fault);
    rig.control(0x80);
    assert_eq!(rig.state(), State::SwitchOnDisabled);
    rig.run(STEP_S);
    assert_eq!(rig.emergencies(), [0x8611, 0x0000]);
    assert_eq!(
        (
            rig.read(0x603F, 0),
            rig.read(0x1001, 0),
            rig.read(0x1003, 0)
        ),
        (0, 0, 1)
    );
    rig.write(0x1003, 0, &[0]);
    assert_eq!((rig.read(0x1003, 0), rig.read(0x1003, 1)), (0, 0));
    rig.enable();
    rig.move_to(0, 3.0);
}

#[test]
fn a_limit_switch_is_a_fault_and_the_way_out_stays_free() {
    let mut rig = Rig::feed(3000.0);
    rig.enable();
    rig.write(0x607A, 0, &(-10_000_i32).to_le_bytes());
    rig.control(0x1F);
    rig.run_until(2.0, |rig| rig.state() == State::Fault);
    assert_eq!(rig.emergencies(), [0x8A80]);
    assert_eq!((rig.read(0x60FD, 0), rig.read(0x3141, 1)), (1, 1));
    rig.control(0x80);
    rig.enable();
    rig.write(0x607A, 0, &(-10_000_i32).to_le_bytes());
    rig.control(0x1F);
    rig.run_until(0.5, |rig| rig.state() == State::Fault);
    rig.control(0x00);
    rig.control(0x80);
    rig.enable();
    rig.move_to(0, 2.0);
    assert_eq!(rig.read(0x60FD, 0), 0);
    assert_eq!(rig.emergencies(), [0x8A80, 0, 0x8A80, 0]);
}

#[test]
fn software_limits_refuse_a_target_beyond() {
    let mut rig = Rig::new();
    rig.write(0x607D, 1, &(-100_i32).to_le_bytes());
    rig.write(0x607D, 2, &5000_i32.to_le_bytes());
    rig.enable();
    rig.move_to(5000, 1.0);
    rig.write(0x607A, 0, &5001_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.1);
    assert_eq!(
        (rig.state(), rig.emergencies()),
        (State::Fault, vec![0x8A82])
    );
    assert_eq!(rig.read(0x6064, 0), 5000);
}

#[test]
fn an_injected_error_is_reported_and_disables() {
    let mut rig = Rig::new();
    rig.enable();
    rig.node().inject_error(0x2310);
    rig.run(STEP_S);
    assert_eq!(
        (rig.state(), rig.emergencies(), rig.read(0x1001, 0)),
        (State::Fault, vec![0x2310], 2)
    );
}

#[test]
fn the_history_holds_the_newest_five() {
    let mut rig = Rig::new();
    for code in [0x2310, 0x4380, 0x8120, 0x7320, 0x8611, 0x6320] {
        rig.inject(Fault::Emergency(code));
        rig.run(STEP_S);
    }
    assert_eq!(rig.read(0x1003, 0), 5);
    let history: Vec<i64> = (1..=5).map(|place| rig.read(0x1003, place)).collect();
    assert_eq!(history, [0x6320, 0x8611, 0x7320, 0x8120, 0x4380]);
    assert_eq!(rig.read(0x603F, 0), 0x6320);
    assert_eq!(rig.read(0x1001, 0), 0x02 | 0x08 | 0x10 | 0x20 | 0x80 | 0x01);
}

#[test]
fn each_fault_reaction_option_brakes_its_way() {
    // 1000 rpm: off, at 5000 rpm/s of the profile, at 20 000 rpm/s of the quick stop.
    for (option, least_s, most_s) in [(0_i16, 0.0, 0.003), (1, 0.19, 0.22), (2, 0.045, 0.07)] {
        let mut rig = Rig::new();
        rig.write(0x605E, 0, &option.to_le_bytes());
        rig.write(0x6084, 0, &5000_u32.to_le_bytes());
        rig.write(0x6085, 0, &20_000_u32.to_le_bytes());
        rig.enable();
        rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
        rig.control(0x1F);
        rig.run(0.5);
        rig.inject(Fault::Emergency(0x6320));
        let took_s = rig.run_until(1.0, |rig| rig.state() == State::Fault);
        assert!(
            (least_s..=most_s).contains(&took_s),
            "option {option}: {took_s}"
        );
    }
}

#[test]
fn another_sensor_configuration_takes_the_reference() {
    let mut rig = Rig::new();
    rig.home(37, 1.0);
    rig.control(0x00);
    rig.run(STEP_S);
    assert!(rig.has(15));
    rig.write(0x3010, 1, &500_u32.to_le_bytes());
    assert!(!rig.has(15));
}
