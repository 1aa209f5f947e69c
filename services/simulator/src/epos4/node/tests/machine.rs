//! The state machine of CiA 402, its transitions and option codes.

use super::*;

#[test]
fn the_state_machine_follows_the_standard() {
    use State::{OperationEnabled, QuickStopActive, ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn};
    for (path, state) in [
        (&[0x0006_u16][..], ReadyToSwitchOn),
        (&[0x07], SwitchOnDisabled),
        (&[0x0F], SwitchOnDisabled),
        (&[0x06, 0x07], SwitchedOn),
        (&[0x06, 0x0F], OperationEnabled),
        (&[0x06, 0x07, 0x0F], OperationEnabled),
        (&[0x06, 0x07, 0x06], ReadyToSwitchOn),
        (&[0x06, 0x07, 0x00], SwitchOnDisabled),
        (&[0x06, 0x07, 0x02], SwitchOnDisabled),
        (&[0x06, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x07], SwitchedOn),
        (&[0x06, 0x0F, 0x06], ReadyToSwitchOn),
        (&[0x06, 0x0F, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x02], QuickStopActive),
        (&[0x06, 0x0F, 0x02, 0x0F], OperationEnabled),
        (&[0x06, 0x0F, 0x02, 0x00], SwitchOnDisabled),
        (&[0x06, 0x0F, 0x80], OperationEnabled),
    ] {
        let mut rig = Rig::new();
        for controlword in path {
            rig.control(*controlword);
            rig.run(0.01);
        }
        assert_eq!(rig.state(), state, "{path:X?}");
    }
}

#[test]
fn a_quick_stop_brakes_and_holds() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(1.0);
    let from_qc = rig.node().position_quadcounts();
    rig.control(0x02);
    assert_eq!(rig.state(), State::QuickStopActive);
    rig.run(0.3);
    assert_eq!(
        (rig.state(), rig.read(0x606C, 0)),
        (State::QuickStopActive, 0)
    );
    // 1000 rpm at 10 000 rpm/s
    let way_qc = rig.node().position_quadcounts() - from_qc;
    assert!((way_qc - 1706.7).abs() < 40.0, "{way_qc}");
    rig.control(0x0F);
    rig.run(0.5);
    assert_eq!(
        (rig.state(), rig.read(0x606C, 0)),
        (State::OperationEnabled, 0),
        "nothing goes on by itself"
    );
}

#[test]
fn leaving_operation_waits_for_standstill() {
    let mut rig = Rig::new();
    rig.enable();
    rig.write(0x607A, 0, &500_000_i32.to_le_bytes());
    rig.control(0x1F);
    rig.run(1.0);
    rig.control(0x07);
    assert_eq!(rig.state(), State::OperationEnabled);
    let took_s = rig.run_until(1.0, |rig| rig.state() == State::SwitchedOn);
    assert!((0.1..0.13).contains(&took_s), "{took_s}");
}
