//! The cyclic modes: position with interpolation, velocity, torque, and their offsets.

use super::*;

impl Rig {
    fn cyclic(mode: u8) -> Self {
        let mut rig = Self::new();
        rig.step_s = 0.001;
        rig.write(0x6060, 0, &[mode]);
        rig.enable();
        rig.nmt(Command::Start);
        rig
    }
}

#[test]
fn cyclic_position_follows_a_sine_of_targets_taken_with_sync() {
    let mut rig = Rig::cyclic(8);
    rig.write(0x60C2, 1, &[10]);
    // Target and controlword in RPDO3, taken with SYNC.
    rig.write(0x1402, 2, &[1]);
    let mut worst_qc: f64 = 0.0;
    let mut previous_qc = 0.0;
    for step in 0..200 {
        let target_qc = 3000.0 * (f64::from(step) * 0.01 * 3.0).sin();
        let [a, b, c, d] = (target_qc as i32).to_le_bytes();
        rig.send(Frame::standard(0x402, [0x0F, 0, a, b, c, d]));
        rig.run(0.001);
        let taken_qc = rig.read(0x607A, 0);
        assert_eq!(taken_qc, previous_qc as i64, "nothing before SYNC");
        rig.send(Frame::standard(0x080, []));
        rig.run(0.009);
        if step > 5 {
            let actual_qc = rig.node().position_quadcounts();
            let demanded_qc = previous_qc + (target_qc - previous_qc) * 0.9;
            worst_qc = worst_qc.max((actual_qc - demanded_qc).abs());
        }
        previous_qc = target_qc;
    }
    // It runs one period behind its targets, by the nature of interpolation, and hardly behind its demand.
    assert!(worst_qc < 60.0, "{worst_qc}");
    assert!(rig.has(12) && !rig.has(13));
}

#[test]
fn without_a_period_the_demand_steps_to_the_target_and_its_offset() {
    let mut rig = Rig::cyclic(8);
    rig.write(0x607A, 0, &100_i32.to_le_bytes());
    rig.write(0x60B0, 0, &(-30_i32).to_le_bytes());
    rig.run(0.1);
    assert_eq!((rig.read(0x6062, 0), rig.read(0x6064, 0)), (70, 70));
}

#[test]
fn cyclic_velocity_adds_its_offset() {
    let mut rig = Rig::cyclic(9);
    rig.write(0x60FF, 0, &500_i32.to_le_bytes());
    rig.write(0x60B1, 0, &(-200_i32).to_le_bytes());
    rig.run(0.2);
    assert_eq!(rig.read(0x606C, 0), 300);
    assert!(rig.has(12));
}

#[test]
fn cyclic_torque_asks_for_its_share_of_the_rated_torque() {
    // Against a wall, so that the current is all there is.
    let mut rig = Rig::with(NodeConfig::new(2, 1), |_| Mechanics {
        hard_stop_high_qc: Some(0.0),
        ..Mechanics::default()
    });
    rig.write(0x6060, 0, &[10]);
    rig.write(0x6071, 0, &400_i16.to_le_bytes());
    rig.write(0x60B2, 0, &(-100_i16).to_le_bytes());
    rig.enable();
    rig.run(0.1);
    // 300 per mille of 500 mA.
    assert_eq!((rig.read(0x30D1, 2), rig.read(0x6077, 0)), (150, 300));
    rig.write(0x6071, 0, &3000_i16.to_le_bytes());
    rig.run(0.1);
    assert_eq!(rig.read(0x30D1, 2), 800, "0x3001:02 holds in every mode");
    assert!(rig.has(11));
}

#[test]
fn torque_mode_does_not_run_away_beyond_the_motor_speed() {
    let mut rig = Rig::cyclic(10);
    rig.write(0x6080, 0, &3000_u32.to_le_bytes());
    rig.write(0x6071, 0, &500_i16.to_le_bytes());
    rig.run(1.0);
    let rpm = rig.read(0x606C, 0);
    assert!((2900..3100).contains(&rpm), "{rpm}");
}
