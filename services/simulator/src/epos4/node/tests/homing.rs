//! Homing, method by method.

use super::*;

#[test]
fn homing_on_the_limit_switch_finds_its_edge() {
    for start_qc in [9000.0, -500.0] {
        let mut rig = Rig::feed(start_qc);
        rig.write(0x30B0, 0, &(-21_504_i32).to_le_bytes());
        rig.write(0x6099, 1, &300_u32.to_le_bytes());
        rig.home(17, 20.0);
        assert_eq!(
            rig.statusword() & 0xB400,
            0x9400,
            "attained, reached, referenced"
        );
        assert!(
            (0.0..3.0).contains(&rig.node().position_quadcounts()),
            "{}",
            rig.node().position_quadcounts()
        );
        assert_eq!(rig.read(0x6064, 0), -21_504);
        assert!(rig.emergencies().is_empty());
    }
}

#[test]
fn homing_moves_by_its_offset_and_sets_the_position_there() {
    let mut rig = Rig::feed(9000.0);
    rig.write(0x30B1, 0, &2048_i32.to_le_bytes());
    rig.home(17, 40.0);
    assert_eq!(rig.read(0x6064, 0), 0);
    assert!((rig.node().position_quadcounts() - 2048.0).abs() < 3.0);
    rig.write(0x6060, 0, &[1]);
    rig.control(0x0F);
    rig.move_to(5000, 2.0);
    assert!((rig.node().position_quadcounts() - 7048.0).abs() < 3.0);
    assert!(rig.has(15));
}

#[test]
fn homing_by_current_finds_the_hard_stop() {
    for (method, start_qc, stop_qc) in [(-4, 9000.0, 0.0), (-3, 9000.0, 30_000.0)] {
        let mut rig = Rig::with(
            NodeConfig {
                position_qc: start_qc,
                ..NodeConfig::new(2, 1)
            },
            |_| Mechanics {
                hard_stop_low_qc: Some(0.0),
                hard_stop_high_qc: Some(30_000.0),
                ..Mechanics::default()
            },
        );
        rig.write(0x6099, 1, &500_u32.to_le_bytes());
        rig.home(method, 30.0);
        assert_eq!(rig.statusword() & 0x3400, 0x1400);
        assert_eq!(
            (rig.node().position_quadcounts(), rig.read(0x6064, 0)),
            (stop_qc, 0),
            "method {method}"
        );
    }
}

#[test]
fn homing_by_current_below_the_threshold_ends_in_a_following_error() {
    let mut rig = Rig::with(NodeConfig::new(2, 1), |_| Mechanics {
        hard_stop_low_qc: Some(0.0),
        ..Mechanics::default()
    });
    rig.write(0x3001, 2, &400_u32.to_le_bytes());
    rig.home(-4, 5.0);
    assert_eq!(rig.statusword() & 0x3400, 0x2000, "homing error");
    assert_eq!(rig.emergencies(), [0x8611]);
    assert!(!rig.has(15));
}

#[test]
fn homing_on_home_switch_index_and_present_position() {
    let home_switch = |position_qc: f64| Mechanics {
        inputs: switches([
            position_qc < -10_000.0,
            position_qc > 20_000.0,
            (5000.0..8000.0).contains(&position_qc),
        ]),
        ..Mechanics::default()
    };
    for (method, start_qc, home_qc) in [
        (23, 0.0, 4999.0),
        (23, 6000.0, 4999.0),
        (23, 12_000.0, 4999.0),
        (27, 12_000.0, 8000.0),
        (27, 0.0, 8000.0),
        (7, 0.0, 4096.0),
        (11, 12_000.0, 8192.0),
        (1, 0.0, -8192.0),
        (2, 0.0, 18_432.0),
        (18, 0.0, 20_000.0),
        (33, 100.0, 0.0),
        (34, 100.0, 2048.0),
        (37, 1234.0, 1234.0),
    ] {
        let mut rig = Rig::with(
            NodeConfig {
                position_qc: start_qc,
                ..NodeConfig::new(2, 1)
            },
            home_switch,
        );
        rig.write(0x6099, 1, &200_u32.to_le_bytes());
        rig.write(0x6099, 2, &60_u32.to_le_bytes());
        rig.home(method, 60.0);
        assert_eq!(rig.statusword() & 0xB400, 0x9400, "method {method}");
        let position_qc = rig.node().position_quadcounts();
        assert!(
            (position_qc - home_qc).abs() < 6.0,
            "method {method} from {start_qc}: {position_qc}"
        );
        assert_eq!(rig.read(0x6064, 0), 0);
    }
}

#[test]
fn homing_is_interrupted_when_its_start_bit_falls() {
    let mut rig = Rig::feed(25_000.0);
    rig.write(0x6098, 0, &[17]);
    rig.write(0x6060, 0, &[6]);
    rig.enable();
    rig.control(0x1F);
    rig.run(0.5);
    rig.control(0x0F);
    rig.run_until(0.5, |rig| rig.statusword() & 0x3400 == 0x0400);
    assert!(!rig.has(15));
}

#[test]
fn the_present_position_is_taken_without_power_too() {
    let mut rig = Rig::feed(9000.0);
    rig.write(0x6098, 0, &[37]);
    rig.write(0x30B0, 0, &500_i32.to_le_bytes());
    rig.write(0x6060, 0, &[6]);
    rig.control(0x10);
    rig.run(STEP_S);
    assert_eq!(rig.state(), State::SwitchOnDisabled);
    assert_eq!(rig.statusword() & 0xB400, 0x9400);
    assert_eq!(rig.read(0x6064, 0), 500);
}

#[test]
fn an_index_that_is_none_is_searched_until_something_stops_it() {
    let mut config = NodeConfig::new(2, 1);
    config.parameters.push((objects::ENCODER_TYPE.address, 0));
    let mut rig = Rig::with(config, |_| Mechanics {
        hard_stop_high_qc: Some(5000.0),
        ..Mechanics::default()
    });
    rig.write(0x6099, 2, &200_u32.to_le_bytes());
    rig.home(34, 5.0);
    assert_eq!(rig.statusword() & 0xB400, 0x2000, "homing error");
    assert_eq!(rig.emergencies(), [0x8611]);
}

#[test]
fn a_switch_whose_function_no_input_has_is_never_found() {
    let mut rig = Rig::feed(9000.0);
    rig.write(0x3142, 1, &[255]);
    rig.write(0x6099, 1, &300_u32.to_le_bytes());
    rig.home(17, 10.0);
    assert_eq!(rig.statusword() & 0xB400, 0x2000);
    let position_qc = rig.node().position_quadcounts();
    assert!(position_qc <= -999.0, "it ran to the stop: {position_qc}");
}
