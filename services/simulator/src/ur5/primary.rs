//! Packets of the primary and secondary interfaces (ports 30001, 30002): the robot state in sub-packages, and messages.

use ur_link::{RuntimeState, SafetyMode};

use super::{
    Controller, Series, Since, Teller,
    measurements::{JOINT_TEMPERATURE_C, SUPPLY_V},
    messages::Message,
    power::Button,
};

const ROBOT_STATE: u8 = 16;
const ROBOT_MESSAGE: u8 = 20;

const TEXT_MESSAGE: u8 = 0;
const POPUP_MESSAGE: u8 = 2;
const VERSION_MESSAGE: u8 = 3;
const SAFETY_MODE_MESSAGE: u8 = 5;
const ERROR_MESSAGE: u8 = 6;
const KEY_MESSAGE: u8 = 7;
const RUNTIME_EXCEPTION: u8 = 10;
/// First versions whose robot mode tells the limit of the speed slider.
const SPEED_LIMIT: Since = Since::new([3, 2, 0], [5, 0, 0]);
/// First versions whose Cartesian data tell the offset of the tool.
const TOOL_OFFSET: Since = Since::new([3, 1, 0], [5, 0, 0]);
/// The controller itself, as source of a message.
const SOURCE_CONTROLLER: i8 = -2;

/// Configuration of the kinematics goes out with the first state of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Detail {
    /// What changes.
    State,
    /// And what does not.
    WithConfiguration,
}

impl Controller {
    /// Appends the robot state.
    pub(super) fn encode_state(&self, detail: Detail, out: &mut Vec<u8>) {
        packet(out, ROBOT_STATE, |out| {
            packet(out, 0, |out| self.encode_mode(out));
            packet(out, 1, |out| self.encode_joints(out));
            packet(out, 2, |out| self.encode_tool(out));
            packet(out, 3, |out| self.encode_masterboard(out));
            packet(out, 4, |out| {
                doubles(out, &self.actual_tool_pose());
                if self.robot.config.software().has(TOOL_OFFSET) {
                    doubles(out, &self.robot.tcp_offset);
                }
            });
            packet(out, 7, |out| {
                doubles(out, &self.wrench());
                doubles(out, &[0.0]); // robot dexterity
            });
            packet(out, 8, |out| self.encode_additional(out));
            packet(out, 9, |out| doubles(out, &[0.0; 6])); // calibration of the force
            if self.robot.config.series == Series::E {
                packet(out, 11, encode_tool_communication);
                packet(out, 12, |out| out.extend([0, 0, 0])); // modes of the tool's outputs
            }
            if detail == Detail::WithConfiguration {
                packet(out, 5, |out| self.encode_kinematics(out));
                packet(out, 6, |out| self.encode_configuration(out));
            }
        });
    }

    /// Appends the message that follows a connection.
    pub(super) fn encode_version(&self, out: &mut Vec<u8>) {
        let [major, minor, bugfix, build] = self.told_version(Teller::Primary).0;
        self.message(out, VERSION_MESSAGE, |out| {
            short_text(out, "URControl");
            out.extend([major as u8, minor as u8]);
            out.extend(bugfix.to_be_bytes());
            out.extend(build.to_be_bytes());
            out.extend(b"01-01-2024, 00:00:00");
        });
    }

    /// Appends what was logged from this number on; gives the number of the next message.
    pub(super) fn encode_messages(&self, since: u64, out: &mut Vec<u8>) -> u64 {
        for message in self.robot.log.since(since) {
            match message {
                Message::Text(text) => {
                    self.message(out, TEXT_MESSAGE, |out| out.extend(text.as_bytes()));
                }
                Message::Popup(text) => self.message(out, POPUP_MESSAGE, |out| {
                    out.extend(0u32.to_be_bytes()); // request
                    out.extend([0, 0, 0, 0]); // requested type; warning, error, blocking
                    short_text(out, "Popup");
                    out.extend(text.as_bytes());
                }),
                Message::Safety(mode) => self.message(out, SAFETY_MODE_MESSAGE, |out| {
                    out.extend([0; 8]); // code, argument
                    out.push(mode.code() as u8);
                    out.extend([0; 8]); // type and value of a report
                }),
                Message::Key { title, text } => self.message(out, KEY_MESSAGE, |out| {
                    out.extend([0; 8]); // code, argument
                    short_text(out, title);
                    out.extend(text.as_bytes());
                }),
                Message::Error {
                    code,
                    argument,
                    level,
                    text,
                } => self.message(out, ERROR_MESSAGE, |out| {
                    for number in [*code, *argument, *level as i32, 0, 0] {
                        out.extend(number.to_be_bytes());
                    }
                    out.extend(text.as_bytes());
                }),
                Message::RuntimeException { line, column, text } => {
                    self.message(out, RUNTIME_EXCEPTION, |out| {
                        out.extend(line.to_be_bytes());
                        out.extend(column.to_be_bytes());
                        out.extend(text.as_bytes());
                    })
                }
            }
        }
        self.robot.log.next()
    }

    fn message(&self, out: &mut Vec<u8>, kind: u8, write: impl FnOnce(&mut Vec<u8>)) {
        packet(out, ROBOT_MESSAGE, |out| {
            out.extend(self.timestamp_us().to_be_bytes());
            out.extend(SOURCE_CONTROLLER.to_be_bytes());
            out.push(kind);
            write(out);
        });
    }

    fn timestamp_us(&self) -> u64 {
        (self.timestamp_s() * 1e6) as u64
    }

    fn encode_mode(&self, out: &mut Vec<u8>) {
        let runtime = self.runtime_state();
        out.extend(self.timestamp_us().to_be_bytes());
        for flag in [
            true,
            true,
            self.has_power(),
            [Button::Robot, Button::System]
                .into_iter()
                .any(|button| self.robot.power.is_pressed(button)),
            self.safety_mode() == SafetyMode::ProtectiveStop,
            matches!(runtime, RuntimeState::Playing | RuntimeState::Resuming),
            matches!(runtime, RuntimeState::Paused | RuntimeState::Pausing),
        ] {
            out.push(u8::from(flag));
        }
        out.push(self.robot_mode().code() as u8);
        out.push(0); // position control
        doubles(out, &[self.robot.speed_slider, self.robot.scaling()]);
        if self.robot.config.software().has(SPEED_LIMIT) {
            doubles(out, &[1.0]);
        }
        if self.robot.config.series == Series::E {
            out.push(0); // reserved
        }
    }

    fn encode_joints(&self, out: &mut Vec<u8>) {
        let (currents, modes) = (self.actual_current_a(), self.joint_modes());
        for joint in 0..6 {
            doubles(
                out,
                &[
                    self.robot.drives.q[joint],
                    self.robot.target.q[joint],
                    self.robot.drives.qd[joint],
                ],
            );
            floats(
                out,
                &[
                    currents[joint] as f32,
                    self.robot_voltage_v() as f32,
                    JOINT_TEMPERATURE_C as f32,
                    0.0,
                ],
            );
            out.push(modes[joint] as u8);
        }
    }

    fn encode_masterboard(&self, out: &mut Vec<u8>) {
        out.extend(0u32.to_be_bytes());
        out.extend((self.robot.digital_outputs as u32).to_be_bytes());
        out.extend([0, 0]);
        doubles(out, &[0.0, 0.0]);
        let volts = self.robot.analog_in_volts;
        out.extend([volts & 1, volts >> 1 & 1]);
        doubles(out, &self.robot.analog_outputs);
        let (volts, amperes) = (SUPPLY_V as f32, self.robot_current_a() as f32);
        floats(out, &[JOINT_TEMPERATURE_C as f32, volts, amperes, 0.0]);
        out.push(self.safety_mode().code() as u8);
        out.extend([0, 0]); // reduced mode, euromap
        out.extend(0u32.to_be_bytes());
        // Operational mode, enabling device, reserved.
        out.extend([self.operational_selector(), 0, 0]);
    }

    fn encode_tool(&self, out: &mut Vec<u8>) {
        out.extend([0, 0]); // analog input ranges
        doubles(out, &[0.0, 0.0]); // analog inputs
        floats(out, &[self.robot_voltage_v() as f32]);
        out.push(0); // output voltage
        floats(out, &[0.0, JOINT_TEMPERATURE_C as f32]);
        out.push(self.joint_modes()[5] as u8);
    }

    fn encode_additional(&self, out: &mut Vec<u8>) {
        // Tool buttons, free drive, and whether a client commands an e-Series.
        out.extend([0, 0, 0, 0]);
        if self.robot.config.series == Series::E {
            out.push(u8::from(self.takes_commands()));
        }
    }

    fn encode_configuration(&self, out: &mut Vec<u8>) {
        let config = &self.robot.config;
        for _ in 0..6 {
            doubles(out, &[-config.joint_range_rad, config.joint_range_rad]);
        }
        for _ in 0..6 {
            doubles(out, &[config.joint_speed_rad_s, config.joint_accel_rad_s2]);
        }
        // Defaults of movej and movel, and the radius that turns tool rotation into way.
        doubles(out, &[1.05, 1.4, 0.25, 1.2, 0.5]);
        let dh = &self.robot.dh;
        doubles(out, &dh.a_m);
        doubles(out, &dh.d_m);
        doubles(out, &dh.alpha_rad);
        doubles(out, &dh.theta_rad);
        // Masterboard version, box, UR5, sub type; the last two tell an e-Series.
        let numbers: [i32; 4] = match config.series {
            Series::Cb3 => [0, 2, 1, 0],
            Series::E => [0, 3, 1, 1],
        };
        for number in numbers {
            out.extend(number.to_be_bytes());
        }
    }

    fn encode_kinematics(&self, out: &mut Vec<u8>) {
        let dh = &self.robot.dh;
        out.extend([0; 24]); // checksums
        doubles(out, &dh.theta_rad);
        doubles(out, &dh.a_m);
        doubles(out, &dh.d_m);
        doubles(out, &dh.alpha_rad);
        out.extend(0u32.to_be_bytes());
    }
}

/// Switched off: enabled, baud rate, parity, stop bits, idle characters of receiver and sender.
fn encode_tool_communication(out: &mut Vec<u8>) {
    out.push(0);
    for number in [115_200i32, 0, 1] {
        out.extend(number.to_be_bytes());
    }
    floats(out, &[1.5, 3.5]);
}

/// Size, type, body: packets and sub-packages alike.
fn packet(out: &mut Vec<u8>, kind: u8, write: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.extend([0, 0, 0, 0, kind]);
    write(out);
    let size = (out.len() - start) as i32;
    out[start..start + 4].copy_from_slice(&size.to_be_bytes());
}

fn doubles(out: &mut Vec<u8>, values: &[f64]) {
    values
        .iter()
        .for_each(|value| out.extend(value.to_be_bytes()));
}

fn floats(out: &mut Vec<u8>, values: &[f32]) {
    values
        .iter()
        .for_each(|value| out.extend(value.to_be_bytes()));
}

fn short_text(out: &mut Vec<u8>, text: &str) {
    let bytes = &text.as_bytes()[..text.len().min(255)];
    out.push(bytes.len() as u8);
    out.extend(bytes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ur5::{Config, Level};

    /// Types and sizes of the sub-packages of a state.
    fn sizes(config: Config) -> Vec<(u8, usize)> {
        let mut out = Vec::new();
        Controller::new(config).encode_state(Detail::WithConfiguration, &mut out);
        assert_eq!(out[..4], (out.len() as i32).to_be_bytes());
        let mut sizes = Vec::new();
        let mut rest = &out[5..];
        while let [a, b, c, d, kind, ..] = rest {
            let size = i32::from_be_bytes([*a, *b, *c, *d]) as usize;
            sizes.push((*kind, size));
            rest = &rest[size..];
        }
        sizes
    }

    #[test]
    fn sub_packages_have_the_sizes_that_clients_choose_versions_by() {
        assert_eq!(
            sizes(Config::default()),
            [
                (0, 46),
                (1, 251),
                (2, 37),
                (3, 75),
                (4, 101),
                (7, 61),
                (8, 9),
                (9, 53),
                (5, 225),
                (6, 445)
            ]
        );
        let old = Config {
            version: Some("3.0.2".parse().unwrap()),
            ..Config::default()
        };
        assert_eq!(
            sizes(old)[..5],
            [(0, 38), (1, 251), (2, 37), (3, 75), (4, 53)]
        );
        let e = sizes(Config::of(Series::E));
        assert_eq!(
            (e[0], &e[6..10]),
            ((0, 47), &[(8, 10), (9, 53), (11, 26), (12, 8)][..])
        );
    }

    #[test]
    fn what_happens_is_told_in_messages() {
        let mut controller = Controller::new(Config {
            powered: true,
            ..Config::default()
        });
        controller.protective_stop("collision");
        controller.tick();
        let mut out = Vec::new();
        let after = controller.encode_messages(0, &mut out);
        assert_eq!(after, 2);
        let size = i32::from_be_bytes([out[0], out[1], out[2], out[3]]) as usize;
        assert_eq!((out[4], out[14]), (ROBOT_MESSAGE, ERROR_MESSAGE));
        assert_eq!(out[15..19], 153i32.to_be_bytes());
        assert_eq!(out[23..27], (Level::Violation as i32).to_be_bytes());
        let safety = &out[size..];
        assert_eq!(
            (safety[4], safety[14]),
            (ROBOT_MESSAGE, SAFETY_MODE_MESSAGE)
        );
        assert_eq!(safety[23], SafetyMode::ProtectiveStop.code() as u8);
    }
}
