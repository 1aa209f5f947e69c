//! The readers of the driver crate, which were written from the manuals by themselves, on what this controller sends.

use ur_link::primary::{Message as Packet, wire};
use ur_link::realtime;

use super::*;
use crate::ur5::primary::Detail;
use crate::ur5::{Button, Series};

/// A powered controller of some software that has moved a little.
fn moved(version: &str) -> Controller {
    let series = if version.starts_with('3') {
        Series::Cb3
    } else {
        Series::E
    };
    let mut config = Config {
        powered: true,
        version: Some(version.parse().unwrap()),
        ..Config::of(series)
    };
    config.calibration.d_m[0] = 1e-3;
    let mut bench = Bench(Controller::new(config));
    bench
        .0
        .load_program("def go():\nmovej([1, -1.7, 1.9, -1.77, -1.57, 0], v=0.5)\nend")
        .unwrap();
    bench.pass(1.0);
    bench.0
}

const VERSIONS: [&str; 6] = ["3.1.0", "3.5.4", "3.15.8", "5.4.0", "5.9.4", "5.12.6"];

#[test]
fn a_realtime_packet_of_every_version_is_read_as_it_was_meant() {
    for version in VERSIONS {
        let controller = moved(version);
        let mut bytes = Vec::new();
        controller.encode_realtime(&mut bytes);
        let packet = realtime::first(&bytes).unwrap().unwrap();
        let state = realtime::State::decode(packet).unwrap();
        assert_eq!(state.time_s, controller.timestamp_s(), "{version}");
        assert_eq!(state.actual_q, controller.robot.drives.q);
        assert_eq!(state.target_qd, controller.robot.target.qd);
        assert_eq!(state.actual_tool, controller.actual_tool_pose());
        assert_eq!(state.robot_mode, RobotMode::Running);
        assert_eq!(state.safety_mode, SafetyMode::Normal);
        assert_eq!(state.speed_scaling, 1.0);
    }
}

#[test]
fn a_robot_state_of_every_version_is_read_as_it_was_meant() {
    for version in VERSIONS {
        let mut controller = moved(version);
        controller.press_emergency_stop(Button::Robot);
        let mut bytes = Vec::new();
        controller.encode_state(Detail::WithConfiguration, &mut bytes);
        let packet = wire::Packet::first(&bytes).unwrap().unwrap();
        let Packet::State(state) = Packet::decode(packet).unwrap() else {
            panic!("not a state")
        };
        let mode = state.mode.unwrap();
        assert!(mode.power_on && mode.emergency_stopped && mode.program_running);
        assert_eq!(mode.robot_mode, RobotMode::Running, "{version}");
        let joints = state.joints.unwrap();
        assert_eq!(
            joints.map(|joint| joint.actual_q),
            controller.robot.drives.q
        );
        assert_eq!(
            state.masterboard.unwrap().safety_mode,
            SafetyMode::RobotEmergencyStop
        );
        let (drawn, real) = (state.configuration.unwrap(), state.kinematics.unwrap());
        assert!((real.dh_d[0] - drawn.dh_d[0] - 1e-3).abs() < 1e-12);
        assert_ne!(real.checksum, [0; 6]);
        let [major, minor, bugfix, build] = controller.robot.config.software().0;
        let software = ur_link::rtde::ControllerVersion {
            major,
            minor,
            bugfix,
            build,
        };
        let model = ur_link::Model::of(&drawn, software).unwrap();
        let expected = match controller.series() {
            Series::Cb3 => ur_link::Model::Ur5,
            Series::E => ur_link::Model::Ur5e,
        };
        assert_eq!(model, expected, "{version}");
        ur_link::Calibration::import(&real, model).unwrap();
    }
}
