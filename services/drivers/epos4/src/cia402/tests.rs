use super::*;

#[test]
fn the_power_up_statusword_is_switch_on_disabled() {
    assert_eq!(Statusword(0x0040).state(), Some(State::SwitchOnDisabled));
}

#[test]
fn unrelated_bits_do_not_change_the_state() {
    let patterns = [
        (0x0000, State::NotReadyToSwitchOn),
        (0x0040, State::SwitchOnDisabled),
        (0x0021, State::ReadyToSwitchOn),
        (0x0023, State::SwitchedOn),
        (0x0027, State::OperationEnabled),
        (0x0007, State::QuickStopActive),
        (0x000F, State::FaultReactionActive),
        (0x0008, State::Fault),
    ];
    for (bits, state) in patterns {
        assert_eq!(Statusword(bits | 0xFF90).state(), Some(state));
    }
}

#[test]
fn a_pattern_outside_of_the_standard_is_no_state() {
    let known = (0u16..=0x6F)
        .filter(|bits| bits & !0x6F == 0)
        .filter(|bits| Statusword(*bits).state().is_some());
    assert_eq!(known.count(), 8);
    assert_eq!(Statusword(0x006F).state(), None);
}

#[test]
fn a_drive_is_enabled_in_three_orders() {
    let orders: Vec<_> = [
        State::SwitchOnDisabled,
        State::ReadyToSwitchOn,
        State::SwitchedOn,
        State::OperationEnabled,
    ]
    .map(towards_enabled)
    .map(|order| order.map(Command::controlword))
    .into();
    assert_eq!(orders, [Some(0x0006), Some(0x0007), Some(0x000F), None]);
}

#[test]
fn a_fault_is_not_left_by_enabling() {
    assert_eq!(towards_enabled(State::Fault), None);
    assert_eq!(towards_enabled(State::FaultReactionActive), None);
}

#[test]
fn a_drive_reads_the_orders_as_they_were_meant() {
    for command in [
        Command::Shutdown,
        Command::SwitchOn,
        Command::EnableOperation,
        Command::DisableVoltage,
        Command::QuickStop,
        Command::FaultReset,
    ] {
        assert_eq!(Command::from_controlword(0, command.controlword()), command);
    }
}

#[test]
fn a_fault_reset_is_an_edge() {
    assert_eq!(
        Command::from_controlword(0x0000, 0x0080),
        Command::FaultReset
    );
    assert_eq!(
        Command::from_controlword(0x0080, 0x0080),
        Command::DisableVoltage
    );
}
