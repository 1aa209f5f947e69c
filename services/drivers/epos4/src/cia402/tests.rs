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

/// What a drive makes of an order (CiA 402, 6.2, without the transitions that it makes by itself).
fn obeyed(state: State, command: Command) -> State {
    match (state, command) {
        (State::Fault, _) => State::Fault,
        (_, Command::DisableVoltage) => State::SwitchOnDisabled,
        (State::OperationEnabled, Command::QuickStop) => State::QuickStopActive,
        (
            State::SwitchOnDisabled | State::SwitchedOn | State::OperationEnabled,
            Command::Shutdown,
        ) => State::ReadyToSwitchOn,
        (State::ReadyToSwitchOn, Command::SwitchOn) => State::SwitchedOn,
        (State::OperationEnabled, Command::DisableOperation) => State::SwitchedOn,
        (State::SwitchedOn | State::QuickStopActive, Command::EnableOperation) => {
            State::OperationEnabled
        }
        (state, _) => state,
    }
}

#[test]
fn every_state_is_reached_from_every_other_by_a_few_orders() {
    let reachable = [
        State::SwitchOnDisabled,
        State::ReadyToSwitchOn,
        State::SwitchedOn,
        State::OperationEnabled,
        State::QuickStopActive,
    ];
    for from in reachable {
        for wanted in reachable {
            let mut state = from;
            let mut orders = 0;
            while let Some(command) = towards(state, wanted) {
                state = obeyed(state, command);
                orders += 1;
                assert!(orders < 6, "{from} to {wanted} stands at {state}");
            }
            assert_eq!(state, wanted, "from {from}");
        }
        assert_eq!(towards(from, State::Fault), None);
    }
}

#[test]
fn the_bits_of_each_mode_are_read_as_that_mode_means_them() {
    let word = Statusword(0x1427);
    assert_eq!(homing::View::from(word), homing::View::Attained);
    assert_eq!(
        homing::View::from(Statusword(0x0027)),
        homing::View::UnderWay
    );
    assert_eq!(
        homing::View::from(Statusword(0x0427)),
        homing::View::Interrupted
    );
    assert_eq!(homing::View::from(Statusword(0x2427)), homing::View::Error);
    assert!(profile_position::View::from(word).setpoint_acknowledged);
    assert!(profile_velocity::View::from(word).speed_zero);
    assert!(cyclic::View::from(word).follows);
    assert!(!cyclic::View::from(word).following_error);
    assert_eq!(
        profile_position::start(profile_position::CHANGE_IMMEDIATELY),
        0x003F
    );
    assert_eq!(homing::start(), 0x001F);
}

#[test]
fn modes_are_those_of_object_6502() {
    let supported = Mode::ALL
        .iter()
        .fold(0_u32, |bits, mode| bits | 1 << (mode.code() - 1));
    assert_eq!(supported, 0x03A5);
    assert_eq!(Mode::from_code(8), Some(Mode::CyclicPosition));
    assert_eq!(Mode::from_code(2), None);
}
