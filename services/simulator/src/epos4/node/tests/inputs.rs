//! Input functions that command the drive or stop it without an error, and the outputs.

use super::*;

/// A drive with one switch on input 4 of this function, actuated from 5000 qc on.
fn with_function(function: u8) -> Rig {
    let mut rig = Rig::with(NodeConfig::new(2, 1), |position_qc| {
        let mut inputs = [Input::default(); INPUT_COUNT];
        inputs[3] = Input::new(Contact::NormallyOpen, position_qc >= 5000.0);
        Mechanics {
            inputs,
            ..Mechanics::default()
        }
    });
    rig.write(0x3142, 4, &[function]);
    rig.run(STEP_S);
    rig
}

#[test]
fn a_limit_switch_without_error_stops_the_way_in_and_leaves_the_way_out() {
    let mut rig = with_function(25);
    rig.enable();
    rig.write(0x607A, 0, &20_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(3.0);
    let stood_qc = rig.node().position_quadcounts();
    // 1000 rpm at 10 000 rpm/s need 1707 qc.
    assert!((5000.0..6800.0).contains(&stood_qc), "{stood_qc}");
    assert_eq!(
        (rig.state(), rig.emergencies()),
        (State::OperationEnabled, vec![])
    );
    assert_eq!(rig.read(0x60FD, 0), 1 << 25);
    rig.write(0x607A, 0, &0_i32.to_le_bytes());
    rig.control(0x0F);
    rig.control(0x3F);
    rig.run_until(3.0, |rig| rig.has(10));
    assert_eq!(rig.read(0x6064, 0), 0);
}

#[test]
fn without_drive_enable_the_power_stage_stays_off() {
    let mut rig = with_function(27);
    rig.control(0x06);
    rig.control(0x0F);
    assert_eq!(rig.state(), State::ReadyToSwitchOn);
    rig.inject(Fault::PressedSwitch(4));
    rig.run(STEP_S);
    rig.enable();
    assert_eq!(rig.drives.clear(None).len(), 1);
    rig.run(STEP_S);
    assert_eq!(rig.state(), State::SwitchOnDisabled);
}

#[test]
fn the_quick_stop_input_brakes_and_holds() {
    let mut rig = with_function(28);
    rig.enable();
    rig.write(0x607A, 0, &100_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run_until(3.0, |rig| rig.state() == State::QuickStopActive);
    rig.run(0.3);
    assert_eq!(
        (rig.state(), rig.read(0x606C, 0)),
        (State::QuickStopActive, 0)
    );
    rig.control(0x0F);
    assert_eq!(
        rig.state(),
        State::QuickStopActive,
        "while the input is active"
    );
}

#[test]
fn polarity_turns_the_level_of_a_pin_and_not_its_wire() {
    let mut rig = with_function(16);
    assert_eq!((rig.read(0x3141, 1), rig.read(0x60FD, 0)), (0, 0));
    rig.write(0x3141, 2, &0b1000_u16.to_le_bytes());
    rig.run(STEP_S);
    assert_eq!((rig.read(0x3141, 1), rig.read(0x60FD, 0)), (0, 1 << 16));
}

#[test]
fn outputs_show_what_their_function_says() {
    let mut rig = Rig::new();
    // Output 1 is general purpose A, output 2 the holding brake.
    rig.write(0x3151, 2, &[24]);
    rig.write(0x60FE, 1, &(1_u32 << 16).to_le_bytes());
    rig.run(STEP_S);
    assert_eq!((rig.read(0x3150, 1), rig.read(0x3158, 3)), (0b01, 1));
    rig.enable();
    rig.run(0.006);
    assert_eq!(rig.read(0x3158, 3), 1, "the brake takes 10 ms to open");
    rig.run(0.01);
    assert_eq!((rig.read(0x3150, 1), rig.read(0x3158, 3)), (0b11, 0));
    // Ready, and not ready while in fault.
    rig.write(0x3151, 2, &[25]);
    assert_eq!(rig.read(0x3150, 1), 0b11);
    rig.inject(Fault::Emergency(0x2310));
    rig.run(STEP_S);
    assert_eq!(rig.read(0x3150, 1), 0b01);
}
