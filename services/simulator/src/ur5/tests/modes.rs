//! Every change of mode that a person, an accident or a client causes, and what programs and clients see of it.

use super::*;
use crate::ur5::{Breakdown, Button, Control, Input, Output, Safeguard, Series, link_fault};
use ur_link::rtde::wire::Value;

const MOVE: &str = "def go():\nmovej([1, -1.7, 1.9, -1.77, -1.57, 0], v=0.5)\nend";

impl Bench {
    fn of(series: Series) -> Self {
        Self(Controller::new(Config {
            powered: true,
            ..Config::of(series)
        }))
    }

    /// In the middle of a move of the base.
    fn moving() -> Self {
        let mut bench = Self::ready();
        bench.0.load_program(MOVE).unwrap();
        bench.pass(1.0);
        assert!(bench.0.speeds_rad_s()[0] > 0.45);
        bench
    }

    fn told(&self, output: &str) -> Value {
        let software = self.0.robot.config.software();
        Output::from_name(output, software).unwrap().0.read(&self.0)
    }

    fn modes(&self) -> (RobotMode, SafetyMode, RuntimeState) {
        let controller = &self.0;
        (
            controller.robot_mode(),
            controller.safety_mode(),
            controller.runtime_state(),
        )
    }

    /// The states of programs as they followed each other.
    fn states(&mut self, seconds: f64) -> Vec<RuntimeState> {
        let mut seen = vec![self.0.runtime_state()];
        for _ in 0..(seconds / self.0.step_s()).round() as usize {
            self.0.tick();
            seen.push(self.0.runtime_state());
        }
        seen.dedup();
        seen
    }

    fn bring_up(&mut self) {
        assert_eq!(self.0.dashboard("power on"), "Powering on");
        self.pass(2.2);
        assert_eq!(self.0.dashboard("brake release"), "Brake releasing");
        self.pass(1.2);
    }
}

#[test]
fn an_emergency_stop_stops_the_arm_takes_its_power_and_must_be_powered_on_again() {
    for (button, mode) in [
        (Button::Robot, SafetyMode::RobotEmergencyStop),
        (Button::System, SafetyMode::SystemEmergencyStop),
    ] {
        let mut bench = Bench::moving();
        bench.0.press_emergency_stop(button);
        bench.0.tick();
        assert_eq!(
            bench.modes(),
            (RobotMode::Running, mode, RuntimeState::Stopping)
        );
        bench.pass(0.4);
        // At rest before the brakes close.
        assert!(bench.0.speeds_rad_s()[0].abs() < 1e-3);
        bench.pass(0.2);
        assert_eq!(
            bench.modes(),
            (RobotMode::PowerOff, mode, RuntimeState::Stopped)
        );
        let bit = if button == Button::Robot { 6 } else { 5 };
        let bits = 1 << bit | 1 << 7 | 1 << 10;
        assert_eq!(bench.told("safety_status_bits"), Value::UInt32(bits));
        assert_eq!(bench.0.dashboard("power on"), "Failed to execute: power on");
        let at = bench.0.joints_rad();
        bench.0.release_emergency_stop(button);
        bench.pass(10.0);
        let off = (
            RobotMode::PowerOff,
            SafetyMode::Normal,
            RuntimeState::Stopped,
        );
        assert_eq!(bench.modes(), off);
        bench.bring_up();
        assert_eq!(bench.0.robot_mode(), RobotMode::Running);
        assert_eq!(bench.0.joints_rad(), at, "moved by itself");
    }
}

#[test]
fn of_two_emergency_stops_each_must_be_released() {
    let mut bench = Bench::ready();
    bench.0.press_emergency_stop(Button::System);
    bench.0.press_emergency_stop(Button::Robot);
    assert_eq!(bench.0.safety_mode(), SafetyMode::RobotEmergencyStop);
    bench.0.release_emergency_stop(Button::Robot);
    assert_eq!(bench.0.safety_mode(), SafetyMode::SystemEmergencyStop);
    bench.0.release_emergency_stop(Button::System);
    assert_eq!(bench.0.safety_mode(), SafetyMode::Normal);
}

#[test]
fn a_safeguard_holds_the_program_until_it_is_closed_and_reset() {
    let mut bench = Bench::moving();
    bench.0.set_safeguard(Safeguard::Open);
    assert_eq!(
        bench.states(0.5),
        [RuntimeState::Pausing, RuntimeState::Paused]
    );
    assert_eq!(bench.0.safety_mode(), SafetyMode::SafeguardStop);
    assert!(
        bench.0.load_program(MOVE).is_err(),
        "starts behind an open door"
    );
    let at = bench.0.joints_rad();
    bench.0.set_safeguard(Safeguard::AwaitsReset);
    bench.pass(3.0);
    assert!(largest_difference(&bench.0.joints_rad(), &at) < 1e-6);
    bench.0.set_safeguard(Safeguard::Clear);
    assert_eq!(
        bench.states(3.0),
        [
            RuntimeState::Resuming,
            RuntimeState::Playing,
            RuntimeState::Stopped
        ]
    );
    assert!((bench.0.joints_rad()[0] - 1.0).abs() < 1e-6);
}

#[test]
fn a_program_that_was_paused_stays_so_after_the_safeguard() {
    let mut bench = Bench::moving();
    bench.0.dashboard("pause");
    bench.0.set_safeguard(Safeguard::Open);
    bench.pass(0.5);
    bench.0.set_safeguard(Safeguard::Clear);
    bench.pass(1.0);
    assert_eq!(bench.0.runtime_state(), RuntimeState::Paused);
    assert_eq!(bench.0.dashboard("play"), "Starting program");
    bench.pass(3.0);
    assert_eq!(bench.0.runtime_state(), RuntimeState::Stopped);
}

#[test]
fn pause_play_and_stop_go_through_their_states() {
    let mut bench = Bench::moving();
    bench.0.dashboard("pause");
    assert_eq!(
        bench.states(0.5),
        [RuntimeState::Pausing, RuntimeState::Paused]
    );
    bench.0.dashboard("play");
    assert_eq!(
        bench.states(0.5),
        [RuntimeState::Resuming, RuntimeState::Playing]
    );
    assert_eq!(bench.0.dashboard("stop"), "Stopped");
    assert_eq!(
        bench.states(0.5),
        [RuntimeState::Stopping, RuntimeState::Stopped]
    );
    assert_eq!(bench.0.dashboard("programState"), "STOPPED <unnamed>");
}

#[test]
fn a_protective_stop_can_be_unlocked_after_five_seconds_and_not_before() {
    let mut bench = Bench::ready();
    bench.0.protective_stop("collision");
    bench.pass(4.992);
    assert!(
        bench
            .0
            .dashboard("unlock protective stop")
            .starts_with("Cannot unlock")
    );
    bench.pass(0.008);
    assert_eq!(
        bench.0.dashboard("unlock protective stop"),
        "Protective stop releasing"
    );
    // The answer comes before the change.
    assert_eq!(bench.0.safety_mode(), SafetyMode::ProtectiveStop);
    bench.pass(0.6);
    assert_eq!(
        bench.modes(),
        (
            RobotMode::Running,
            SafetyMode::Normal,
            RuntimeState::Stopped
        )
    );
}

#[test]
fn a_failed_joint_takes_the_power_until_it_is_whole_and_safety_restarted() {
    let mut bench = Bench::moving();
    bench.0.set_joint_failed(3, true);
    bench.pass(0.1);
    assert_eq!(
        bench.modes(),
        (
            RobotMode::PowerOff,
            SafetyMode::Fault,
            RuntimeState::Stopped
        )
    );
    assert_eq!(bench.0.speeds_rad_s(), [0.0; 6]);
    let modes = [239, 239, 239, 252, 239, 239];
    assert_eq!(bench.told("joint_mode"), Value::Vector6Int32(modes));
    assert!(
        bench
            .exceptions()
            .iter()
            .any(|text| text.contains("joint 3"))
    );
    assert_eq!(bench.0.dashboard("restart safety"), "Restarting safety");
    bench.pass(1.5);
    assert_eq!(bench.0.safety_mode(), SafetyMode::Fault, "still broken");
    bench.0.set_joint_failed(3, false);
    bench.pass(5.0);
    assert_eq!(bench.0.safety_mode(), SafetyMode::Fault, "not restarted");
    bench.0.dashboard("restart safety");
    bench.pass(1.5);
    assert_eq!(bench.0.safety_mode(), SafetyMode::Normal);
    bench.bring_up();
    assert_eq!(bench.0.robot_mode(), RobotMode::Running);
}

#[test]
fn a_violation_needs_a_restart_of_the_safety_system() {
    let mut bench = Bench::ready();
    bench.0.break_down(Breakdown::Violation);
    bench.pass(0.1);
    assert_eq!(bench.0.dashboard("safetymode"), "Safetymode: VIOLATION");
    assert_eq!(bench.0.dashboard("robotmode"), "Robotmode: POWER_OFF");
    assert_eq!(bench.0.dashboard("power on"), "Failed to execute: power on");
    bench.0.dashboard("restart safety");
    bench.pass(1.1);
    assert_eq!(bench.0.dashboard("safetymode"), "Safetymode: NORMAL");
}

#[test]
fn an_emergency_stop_is_graver_than_a_protective_stop_and_ends_it() {
    let mut bench = Bench::ready();
    bench.0.protective_stop("collision");
    bench.0.press_emergency_stop(Button::Robot);
    bench.pass(1.0);
    bench.0.release_emergency_stop(Button::Robot);
    assert_eq!(bench.0.safety_mode(), SafetyMode::Normal);
    assert_eq!(bench.0.robot_mode(), RobotMode::PowerOff);
}

#[test]
fn in_local_control_clients_may_look_and_not_command() {
    let mut bench = Bench::of(Series::E);
    assert_eq!(bench.0.dashboard("is in remote control"), "true");
    bench.0.set_control(Control::Local);
    assert_eq!(bench.0.dashboard("is in remote control"), "false");
    assert_eq!(bench.0.dashboard("robotmode"), "Robotmode: RUNNING");
    for command in ["play", "power off", "load x.urp", "unlock protective stop"] {
        let answer = bench.0.dashboard(command);
        assert_eq!(answer, "Command is not allowed due to safety reasons");
    }
    assert!(bench.0.load_program(MOVE).is_err());
    assert_eq!(bench.0.robot_mode(), RobotMode::Running);
    bench.0.set_control(Control::Remote);
    assert!(bench.0.load_program(MOVE).is_ok());
}

#[test]
fn each_series_knows_its_own_dashboard_commands() {
    let (mut cb3, mut e) = (Bench::of(Series::Cb3), Bench::of(Series::E));
    let unknown = |answer: String| answer.starts_with("could not understand");
    for (command, by_cb3, by_e) in [
        ("is in remote control", false, true),
        ("get operational mode", false, true),
        ("setUserRole operator", true, false),
        ("getUserRole", true, false),
        ("safetystatus", true, true),
        ("nonsense", false, false),
        ("play now", false, false),
    ] {
        assert_eq!(!unknown(cb3.0.dashboard(command)), by_cb3, "cb3: {command}");
        assert_eq!(!unknown(e.0.dashboard(command)), by_e, "e: {command}");
    }
    assert_eq!(cb3.0.dashboard("getUserRole"), "OPERATOR");
    assert_eq!(e.0.dashboard("get operational mode"), "NONE");
    assert_eq!(
        e.0.dashboard("set operational mode automatic"),
        "Operational mode AUTOMATIC is set"
    );
    assert_eq!(e.0.dashboard("get operational mode"), "AUTOMATIC");
    assert!(
        e.0.dashboard("clear operational mode")
            .starts_with("No longer")
    );
    assert_eq!(e.0.dashboard("get operational mode"), "NONE");
    assert!(e.0.dashboard("get serial number").starts_with("20"));
    assert_eq!(e.0.dashboard("load a b.urp"), "File not found: a b.urp");
    assert_eq!(e.0.dashboard("addToLog"), "No log message to add");
    assert_eq!(e.0.dashboard("addToLog hello"), "Added log message");
    let old = Config {
        version: Some("3.6.0".parse().unwrap()),
        ..Config::default()
    };
    assert!(unknown(Controller::new(old).dashboard("restart safety")));
}

#[test]
fn an_e_series_has_five_hundred_cycles_in_a_second_and_the_same_moves() {
    let mut bench = Bench::of(Series::E);
    for _ in 0..500 {
        bench.0.tick();
    }
    assert!((bench.0.timestamp_s() - 1.0).abs() < 1e-9);
    let lines = "q = get_target_joint_positions()\nq[0] = q[0] + 1.0\nmovej(q, a=2.0, v=0.5)";
    let seconds = bench.run(lines);
    // 2.25 s of way, after the 24 ms that every program takes to begin.
    assert!((seconds - 2.274).abs() < 0.01, "{seconds}");
    bench.run("write_output_float_register(0, get_steptime())");
    assert_eq!(bench.0.robot.outputs.doubles[0], 0.002);
}

#[test]
fn slipped_encoders_tell_clients_what_is_not_true() {
    let mut bench = Bench::ready();
    let truth = bench.0.joints_rad();
    bench.0.slip_encoders([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]);
    bench.pass(1.0);
    let Value::Vector6D(told) = bench.told("actual_q") else {
        panic!("actual_q is six numbers")
    };
    assert!(
        (told[1] - truth[1]).abs() < 1e-6,
        "the loop brings back what it sees"
    );
    assert!((bench.0.joints_rad()[1] - (truth[1] - 0.01)).abs() < 1e-6);
}

#[test]
fn joints_that_lag_too_much_are_a_protective_stop() {
    let mut bench = Bench::ready();
    bench.0.set_extra_lag([1.0; 6]);
    bench
        .0
        .load_program("def go():\nmovej([2, -1.7, 1.9, -1.77, -1.57, 0], v=1.0)\nend")
        .unwrap();
    bench.pass(2.0);
    assert_eq!(bench.0.safety_mode(), SafetyMode::ProtectiveStop);
    assert!(
        bench
            .exceptions()
            .iter()
            .any(|text| text.contains("deviates from path"))
    );
}

#[test]
fn analog_outputs_obey_their_mask() {
    let mut bench = Bench::ready();
    let mut write = |name: &str, value| bench.0.write_input(Input::from_name(name).unwrap(), value);
    write("standard_analog_output_mask", Value::UInt8(0b10));
    write("standard_analog_output_type", Value::UInt8(0b11));
    write("standard_analog_output_0", Value::Double(0.4));
    write("standard_analog_output_1", Value::Double(0.7));
    assert_eq!(bench.told("standard_analog_output0"), Value::Double(0.0));
    assert_eq!(bench.told("standard_analog_output1"), Value::Double(0.7));
    assert_eq!(bench.told("analog_io_types"), Value::UInt32(0b1000));
}

#[test]
fn what_is_carried_and_not_declared_is_felt_as_a_force() {
    let mut bench = Bench(Controller::new(Config {
        powered: true,
        carried_kg: Some(1.5),
        ..Config::default()
    }));
    bench.run("set_payload(1.0)");
    let Value::Vector6D(force) = bench.told("actual_TCP_force") else {
        panic!("a force is six numbers")
    };
    assert!((force[2] + 0.5 * 9.82).abs() < 1e-9, "{force:?}");
}

#[test]
fn currents_follow_acceleration_and_friction() {
    let mut bench = Bench::moving();
    let Value::Vector6D(cruising) = bench.told("actual_current") else {
        panic!("currents are six numbers")
    };
    assert!(cruising[0] > 0.5 && cruising[1] == 0.0, "{cruising:?}");
    bench.pass(3.0);
    assert_eq!(bench.told("actual_current"), Value::Vector6D([0.0; 6]));
}

#[test]
fn faults_of_links_are_bounded_in_number() {
    let mut faults = link_fault::Faults::default();
    let spec = link_fault::Spec {
        service: None,
        direction: link_fault::Direction::FromController,
        kind: link_fault::Kind::Drop,
        share: 1.0,
        limit: 0,
        seed: 0,
    };
    let added = (0..1000).filter(|id| faults.add(*id, spec.clone())).count();
    assert_eq!(added, link_fault::MAX_FAULTS);
}
