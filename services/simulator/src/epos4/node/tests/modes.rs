//! The modes of operation but for homing.

use super::*;

#[test]
fn a_profile_position_move_ends_within_a_quadcount_in_the_time_of_its_trapezoid() {
    let mut rig = Rig::new();
    rig.write(0x6081, 0, &3000_u32.to_le_bytes());
    rig.enable();
    for target_qc in [21_504, -5376, -5375, 100_000, 0] {
        let distance_qc = (f64::from(target_qc) - rig.node().position_quadcounts()).abs();
        // 3000 rpm, 10 000 rpm/s both ways.
        let (speed, acceleration) = (102_400.0_f64, 341_333.3);
        let ideal_s = if distance_qc > speed * speed / acceleration {
            distance_qc / speed + speed / acceleration
        } else {
            2.0 * (distance_qc / acceleration).sqrt()
        };
        let took_s = rig.move_to(target_qc, 10.0);
        assert!(
            (took_s - ideal_s).abs() < 0.02 + 0.01 * ideal_s,
            "{target_qc}: {took_s} s for {ideal_s} s"
        );
        rig.run(0.05);
        assert!((rig.node().position_quadcounts() - f64::from(target_qc)).abs() < 1.0);
        assert_eq!(rig.read(0x6064, 0), i64::from(target_qc));
        assert_eq!(rig.read(0x606C, 0), 0);
    }
}

#[test]
fn set_points_are_buffered_replaced_and_added() {
    let mut rig = Rig::new();
    rig.enable();
    let target = |rig: &mut Rig, target_qc: i32, controlword: u16| {
        rig.write(0x607A, 0, &target_qc.to_le_bytes());
        rig.control(controlword);
    };
    target(&mut rig, 5000, 0x1F);
    rig.control(0x0F);
    // A second one waits, and its acknowledge stays until the first is reached.
    target(&mut rig, 7000, 0x1F);
    rig.control(0x0F);
    assert!(rig.has(12));
    rig.run_until(2.0, |rig| !rig.has(12));
    assert!((rig.node().position_quadcounts() - 5000.0).abs() < 20.0);
    rig.run_until(2.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 7000);
    // At once, leaving the present one.
    target(&mut rig, 100_000, 0x1F);
    rig.run(0.1);
    target(&mut rig, 6000, 0x0F);
    rig.control(0x3F);
    rig.run_until(3.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 6000);
    // A distance.
    target(&mut rig, -500, 0x0F);
    rig.control(0x5F);
    rig.run_until(2.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 5500);
}

#[test]
fn halt_stops_and_its_end_goes_on() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &50_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(0.5);
    rig.control(0x11F);
    rig.run_until(0.5, |rig| rig.has(10));
    let halted_qc = rig.node().position_quadcounts();
    rig.run(0.5);
    assert!((rig.node().position_quadcounts() - halted_qc).abs() < 1.0 && halted_qc < 40_000.0);
    rig.control(0x1F);
    rig.run_until(3.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 50_000);
}

#[test]
fn velocity_mode_turns_at_the_target_velocity() {
    let mut rig = Rig::new();
    rig.write(0x6060, 0, &[3]);
    rig.write(0x60FF, 0, &(-600_i32).to_le_bytes());
    rig.enable();
    rig.run_until(0.2, |rig| rig.has(10));
    assert!(!rig.has(12));
    let from_qc = rig.node().position_quadcounts();
    rig.run(1.0);
    assert!((rig.node().position_quadcounts() - from_qc + 20_480.0).abs() < 30.0);
    assert_eq!(rig.read(0x606C, 0), -600);
    rig.control(0x10F);
    rig.run(0.2);
    assert!(rig.has(10) && rig.has(12));
}

#[test]
fn the_current_limit_stalls_the_drive_on_a_load() {
    // From 10 000 qc on a spring of 50 mA per 1000 qc.
    let mut rig = Rig::with(NodeConfig::new(2, 1), |position_qc| Mechanics {
        load_ma: ((position_qc - 10_000.0) * 0.05).max(0.0),
        ..Mechanics::default()
    });
    rig.write(0x3001, 2, &300_u32.to_le_bytes());
    rig.write(0x6065, 0, &u32::MAX.to_le_bytes());
    rig.enable();
    rig.write(0x607A, 0, &100_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(4.0);
    assert!(rig.has(11), "internal limit active");
    assert!(
        rig.has(10),
        "without a position window the end of the profile counts"
    );
    rig.write(0x6067, 0, &100_u32.to_le_bytes());
    assert!(!rig.has(10));
    assert_eq!((rig.read(0x30D1, 2), rig.read(0x30D1, 1)), (300, 300));
    assert_eq!(rig.read(0x6077, 0), 600);
    // 300 mA are 40 mA friction and 260 mA spring; momentum carries the shaft a little further. the rotor's momentum presses a little further.
    let position_qc = rig.node().position_quadcounts();
    assert!((15_200.0..15_850.0).contains(&position_qc), "{position_qc}");
    assert_eq!(rig.read(0x606C, 0), 0);
    // And back.
    rig.control(0x0F);
    rig.write(0x6067, 0, &u32::MAX.to_le_bytes());
    rig.move_to(0, 5.0);
}
