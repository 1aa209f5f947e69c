//! What the drive watches: heat, supply, safe torque off, and the heartbeat of its master to the cycle.

use super::*;

/// A drive that presses against a wall with this current limit.
fn pressing(limit_ma: u32) -> Rig {
    let mut rig = Rig::with(NodeConfig::new(2, 1), |_| Mechanics {
        hard_stop_high_qc: Some(100.0),
        ..Mechanics::default()
    });
    rig.write(0x3001, 2, &limit_ma.to_le_bytes());
    rig.write(0x6065, 0, &u32::MAX.to_le_bytes());
    rig.enable();
    rig.write(0x607A, 0, &10_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig
}

#[test]
fn i2t_cuts_the_current_to_the_nominal_one() {
    let mut rig = pressing(1000);
    rig.run(0.1);
    assert_eq!(rig.read(0x30D1, 2), 1000);
    // Twice the nominal 500 mA: 100 % after 4 s · ln(4/3) = 1.15 s.
    let took_s = rig.run_until(3.0, |rig| rig.read(0x30D1, 2) == 500);
    assert!((0.9..1.2).contains(&took_s), "{took_s}");
    assert!(rig.read(0x3200, 1) >= 99 && rig.has(11));
    rig.run(5.0);
    assert_eq!(
        (rig.read(0x30D1, 2), rig.state()),
        (500, State::OperationEnabled)
    );
    // Relieved, it cools down and the full current is back.
    rig.control(0x07);
    rig.run(8.0);
    assert!(rig.read(0x3200, 1) < 20);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.run(0.2);
    assert_eq!(rig.read(0x30D1, 2), 1000);
}

#[test]
fn below_the_nominal_current_nothing_is_cut() {
    let mut rig = pressing(450);
    rig.run(30.0);
    assert_eq!(rig.read(0x30D1, 2), 450);
    assert_eq!(
        rig.read(0x3200, 1),
        80,
        "(450/500)² is 81 %, the pull of the end still missing"
    );
}

#[test]
fn an_i2t_level_can_be_given() {
    let mut rig = pressing(800);
    rig.run(0.1);
    rig.inject(Fault::I2tLevel(120.0));
    rig.run(0.01);
    assert_eq!(
        (rig.read(0x30D1, 2), rig.read(0x3200, 1) >= 100),
        (500, true)
    );
}

#[test]
fn supply_and_temperature_beyond_their_limits_disable_until_they_are_back() {
    for (fault, code, register, shown) in [
        (Fault::Supply(5.0), 0x3220, 0x04, (0x2200, 50)),
        (Fault::Supply(60.0), 0x3210, 0x04, (0x2200, 600)),
        (
            Fault::PowerStageTemperature(110.0),
            0x4210,
            0x08,
            (0x3201, 1100),
        ),
    ] {
        let mut rig = Rig::new();
        rig.enable();
        let id = rig.inject(fault);
        rig.run(STEP_S);
        assert_eq!((rig.state(), rig.emergencies()), (State::Fault, vec![code]));
        assert_eq!(rig.read(0x1001, 0), register);
        assert_eq!(rig.read(shown.0, 1), shown.1);
        // Acknowledged too early it comes again.
        rig.control(0x80);
        rig.run(STEP_S);
        assert_eq!(
            (rig.state(), rig.emergencies()),
            (State::Fault, vec![code, 0, code])
        );
        rig.clear(id);
        rig.control(0x00);
        rig.control(0x80);
        rig.run(STEP_S);
        rig.enable();
    }
}

#[test]
fn safe_torque_off_is_an_error_under_power() {
    let mut rig = Rig::new();
    let id = rig.inject(Fault::StoOpen);
    rig.run(STEP_S);
    assert_eq!((rig.read(0x3202, 1), rig.emergencies()), (0, vec![]));
    rig.control(0x06);
    rig.control(0x0F);
    rig.run(STEP_S);
    assert_eq!(
        (rig.state(), rig.emergencies()),
        (State::Fault, vec![0x8A88])
    );
    rig.clear(id);
    rig.control(0x80);
    rig.run(STEP_S);
    assert_eq!(
        (rig.read(0x3202, 1), rig.state()),
        (3, State::SwitchOnDisabled)
    );
}

#[test]
fn a_drive_stops_within_5_ms_of_its_masters_timeout() {
    const CYCLE_S: f64 = 0.0004;
    const TIMEOUT_S: f64 = 0.3;
    let mut rig = Rig::new();
    rig.step_s = CYCLE_S;
    rig.write(0x1016, 1, &(0x7F_0000_u32 | 300).to_le_bytes());
    rig.write(0x6081, 0, &3000_u32.to_le_bytes());
    rig.write(0x6085, 0, &50_000_u32.to_le_bytes());
    rig.nmt(Command::Start);
    rig.enable();
    rig.write(0x607A, 0, &2_000_000_i32.to_le_bytes());
    rig.control(0x1F);
    for _ in 0..10 {
        rig.run(0.1);
        rig.send(heartbeat::encode(0x7F, NmtState::Operational));
    }
    let cruising_qc_s = rig.node().speed_quadcounts_s();
    let last_beat_s = rig.now_s;
    rig.run_until(0.4, |rig| {
        rig.node().drive_state() != State::OperationEnabled
    });
    let noticed_s = rig.now_s - last_beat_s;
    rig.run_until(0.01, |rig| {
        rig.node().speed_quadcounts_s() < cruising_qc_s - 1.0
    });
    let brakes_s = rig.now_s - last_beat_s;
    rig.run_until(0.2, |rig| rig.node().speed_quadcounts_s() == 0.0);
    let stands_s = rig.now_s - last_beat_s;
    let braking_s = 3000.0 / 50_000.0;
    assert!(
        (TIMEOUT_S..=TIMEOUT_S + 0.001).contains(&noticed_s),
        "{noticed_s}"
    );
    assert!(brakes_s <= TIMEOUT_S + 0.005, "{brakes_s}");
    assert!(stands_s <= TIMEOUT_S + braking_s + 0.005, "{stands_s}");
}
