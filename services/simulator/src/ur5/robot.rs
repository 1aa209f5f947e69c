//! The arm without its programs: modes, motion, joints, registers. Programs act on it through these methods; it moves
//! by one cycle at a time.

use nalgebra::{Isometry3, Translation3};
use ur_link::{RobotMode, SafetyMode, rtde::wire::Value};

use super::{
    Config,
    joints::{Drives, Limits},
    kinematics::{self, Dh, Joints},
    motion::{self, Motion, Progress, Target},
    power::{Breakdown, Button, Power},
    registers::{Bank, Input, Outputs},
    watchdog::Watchdogs,
};

pub use super::messages::{Level, Log, Message};
pub use super::watchdog::WatchdogAction;

/// Deceleration when a program ends or loses its motion, rad/s².
const PROGRAM_STOP_RAD_S2: f64 = 4.0;
/// Deceleration of a protective stop, rad/s².
const PROTECTIVE_STOP_RAD_S2: f64 = 20.0;
/// Largest change of the speed scaling, 1/s: full speed to pause in 80 ms.
const SCALING_PER_S: f64 = 12.5;
/// Gravity where the arm stands, m/s².
pub const GRAVITY_M_S2: f64 = 9.82;
/// Number of the error that a protective stop is told with.
const PROTECTIVE_STOP_CODE: i32 = 153;
/// Number of the error that a failed joint is told with; its argument is the joint.
const JOINT_FAULT_CODE: i32 = 4;

/// A thread of any program; no two of one controller share a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThreadId(u64);

/// One motion function begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// State of the arm.
#[derive(Debug)]
pub struct Robot {
    /// As configured.
    pub config: Config,
    /// Geometry of the arm.
    pub dh: Dh,
    /// Power, brakes, safety.
    pub power: Power,
    /// Joints as commanded.
    pub target: Target,
    /// Change of the commanded speeds, rad/s².
    pub target_qdd: Joints,
    /// Joints as they are.
    pub drives: Drives,
    /// Written by RTDE clients.
    pub inputs: Bank,
    /// Written by programs.
    pub outputs: Bank,
    /// Standard, configurable and tool outputs as bits 0..17.
    pub digital_outputs: u64,
    /// Analog outputs, 0..1.
    pub analog_outputs: [f64; 2],
    /// Which of them are volts, not amperes.
    pub analog_in_volts: u8,
    /// What an external sensor told: N and Nm.
    pub external_wrench: Joints,
    /// `set_tcp`: flange from tool, m and rotation vector.
    pub tcp_offset: Joints,
    /// `set_payload`, kg.
    pub payload_kg: f64,
    /// Centre of gravity at the flange, m.
    pub payload_cog_m: [f64; 3],
    /// 0..1
    pub speed_slider: f64,
    /// What clients are told, newest last.
    pub log: Log,
    cycle: u64,
    scaling: f64,
    paused: bool,
    flange_from_tool: Isometry3<f64>,
    motion: Motion,
    owner: Option<ThreadId>,
    ticket: Ticket,
    reached: Ticket,
    threads: u64,
    output_masks: [u8; 3],
    slider_unlocked: bool,
    analog_mask: u8,
    watchdogs: Watchdogs,
    extra_lag_s: Joints,
    failed_joints: [bool; 6],
    safety_told: SafetyMode,
}

impl Robot {
    /// At rest in its first position.
    pub fn new(config: Config) -> Self {
        let mode = if config.powered {
            RobotMode::Running
        } else {
            RobotMode::PowerOff
        };
        let q = config.joints_rad;
        Self {
            dh: config.dh(),
            power: Power::new(mode, config.boot_s, config.brake_release_s),
            target: Target::resting(q),
            target_qdd: [0.0; 6],
            drives: Drives::resting(
                q,
                config.joint_lag_s,
                config.joint_friction_rad,
                Limits {
                    speed_rad_s: config.joint_speed_rad_s,
                    accel_rad_s2: config.joint_accel_rad_s2,
                    torque_nm: config.joint_torque_nm,
                },
            ),
            inputs: Bank::default(),
            outputs: Bank::default(),
            digital_outputs: 0,
            analog_outputs: [0.0; 2],
            analog_in_volts: 0,
            external_wrench: [0.0; 6],
            tcp_offset: [0.0; 6],
            payload_kg: 0.0,
            payload_cog_m: [0.0; 3],
            speed_slider: 1.0,
            log: Log::default(),
            cycle: 0,
            scaling: 1.0,
            paused: false,
            flange_from_tool: Isometry3::identity(),
            motion: Motion::Rest,
            owner: None,
            ticket: Ticket(0),
            reached: Ticket(0),
            threads: 0,
            output_masks: [0; 3],
            slider_unlocked: false,
            analog_mask: 0,
            watchdogs: Watchdogs::default(),
            extra_lag_s: [0.0; 6],
            failed_joints: [false; 6],
            safety_told: SafetyMode::Normal,
            config,
        }
    }

    /// s since the controller started.
    pub fn now_s(&self) -> f64 {
        self.cycle as f64 * self.step_s()
    }

    /// One cycle of the controller, s.
    pub fn step_s(&self) -> f64 {
        self.config.series.step_s()
    }

    /// 0..1: the share of nominal speed at which paths advance.
    pub fn scaling(&self) -> f64 {
        self.scaling
    }

    /// Paths advance as fast as the slider says.
    pub fn is_at_speed(&self) -> bool {
        !self.paused && (self.scaling - self.speed_slider).abs() < 1e-9
    }

    /// The arm moves under a command.
    pub fn is_moving(&self) -> bool {
        !matches!(self.motion, Motion::Rest)
    }

    /// Nothing moved noticeably in the last cycle.
    pub fn is_steady(&self) -> bool {
        let fastest = self
            .drives
            .qd
            .iter()
            .fold(0.0, |fastest: f64, speed| fastest.max(speed.abs()));
        fastest < 1e-3 && motion::largest_difference(&self.drives.q, &self.target.q) < 1e-3
    }

    /// Flange from tool, as set by `set_tcp`.
    pub fn flange_from_tool(&self) -> &Isometry3<f64> {
        &self.flange_from_tool
    }

    /// `set_tcp`.
    pub fn set_tcp(&mut self, pose: Joints) {
        self.tcp_offset = pose;
        self.flange_from_tool = kinematics::from_pose(&pose);
    }

    /// Base from tool for these joints, as URScript writes it.
    pub fn tool_pose(&self, joints: &Joints) -> Joints {
        kinematics::to_pose(&(self.dh.flange(joints) * self.flange_from_tool))
    }

    /// Twist of the tool in base axes.
    pub fn tool_speed(&self, joints: &Joints, speeds: &Joints) -> Joints {
        let twist =
            self.dh.jacobian(joints, &self.flange_from_tool) * nalgebra::Vector6::from(*speeds);
        twist.into()
    }

    /// `speedl` or `stopl` from how the tool moves now.
    pub fn tool_motion(&self, speed: nalgebra::Vector6<f64>, accel: f64) -> Motion {
        let (step_s, tool) = (self.step_s(), &self.flange_from_tool);
        Motion::tool_speed(&self.dh, &self.target, step_s, tool, speed, accel)
    }

    /// A number for a new thread.
    pub fn new_thread(&mut self) -> ThreadId {
        self.threads += 1;
        ThreadId(self.threads)
    }

    /// Begins a motion for a thread.
    ///
    /// # Errors
    /// Another thread's move is under way, or the arm may not move.
    pub fn begin(&mut self, owner: ThreadId, motion: Motion) -> Result<Ticket, String> {
        if !self.power.may_move() {
            return Err(format!(
                "arm may not move in robot mode {}, safety mode {}",
                self.power.mode,
                self.power.safety()
            ));
        }
        let held = matches!(self.motion, Motion::Joints { .. } | Motion::Line { .. });
        if held && self.owner.is_some_and(|other| other != owner) {
            return Err("another thread is already controlling the robot".to_owned());
        }
        self.ticket.0 += 1;
        self.motion = motion;
        self.owner = Some(owner);
        Ok(self.ticket)
    }

    /// The motion of this ticket has reached its goal, or another has replaced it.
    pub fn has_ended(&self, ticket: Ticket) -> bool {
        self.reached >= ticket || self.ticket > ticket
    }

    /// The thread ended or was killed: what it moved comes to rest.
    pub fn release(&mut self, owner: ThreadId) {
        if self.owner == Some(owner) {
            self.stop(PROGRAM_STOP_RAD_S2);
        }
    }

    /// Every joint to rest, leading joint with this deceleration.
    fn stop(&mut self, accel: f64) {
        self.owner = None;
        self.ticket.0 += 1;
        self.motion = Motion::JointSpeed {
            speed: [0.0; 6],
            accel,
        };
    }

    /// Stops the arm until a person unlocks it.
    pub fn protective_stop(&mut self, reason: &str) {
        if self.power.protective_stop() {
            tracing::warn!(reason, now_s = self.now_s(), "protective stop");
            self.log.push(Message::Error {
                code: PROTECTIVE_STOP_CODE,
                argument: 0,
                level: Level::Violation,
                text: format!("protective stop: {reason}"),
            });
            self.stop(PROTECTIVE_STOP_RAD_S2);
        }
    }

    /// Presses an emergency stop: the arm stops, then loses its power.
    pub fn press(&mut self, button: Button) {
        self.power.press(button);
        if self.is_moving() {
            self.stop(PROTECTIVE_STOP_RAD_S2);
        }
    }

    /// A joint fails, or is whole again; the safety system needs a restart after that.
    pub fn set_joint_failed(&mut self, joint: usize, failed: bool) {
        if let Some(state) = self.failed_joints.get_mut(joint)
            && std::mem::replace(state, failed) != failed
            && failed
        {
            self.log.push(Message::Error {
                code: JOINT_FAULT_CODE,
                argument: joint as i32,
                level: Level::Fault,
                text: format!("joint {joint} does not respond"),
            });
        }
    }

    /// Which joints have failed.
    pub fn failed_joints(&self) -> &[bool; 6] {
        &self.failed_joints
    }

    /// Lets the joints lag more than they are made to, s.
    pub fn set_extra_lag(&mut self, extra_lag_s: Joints) {
        self.extra_lag_s = extra_lag_s;
        let made = self.config.joint_lag_s;
        self.drives.lag_s = std::array::from_fn(|joint| made[joint] + extra_lag_s[joint]);
    }

    /// What the joints lag too much, s.
    pub fn extra_lag_s(&self) -> Joints {
        self.extra_lag_s
    }

    /// What truly hangs at the flange, kg.
    pub fn carried_kg(&self) -> f64 {
        self.config.carried_kg.unwrap_or(self.payload_kg)
    }

    /// Force and torque that the controller believes to feel, in base axes: the weight that was not declared, and what an
    /// external sensor tells. N and Nm.
    pub fn wrench(&self) -> Joints {
        let mut wrench = self.external_wrench;
        wrench[2] -= (self.carried_kg() - self.payload_kg) * GRAVITY_M_S2;
        wrench
    }

    /// Brakes on, power off.
    pub fn power_off(&mut self) {
        self.power.power_off();
    }

    /// A program waits or goes on; a motion slows down along its path.
    pub fn set_paused(&mut self, paused: bool) {
        self.paused = paused;
    }

    /// Nothing of an ended program stays: motion, pause, watchdogs.
    pub fn program_ended(&mut self) {
        self.paused = false;
        self.watchdogs.clear();
        if self.is_moving() {
            self.stop(PROGRAM_STOP_RAD_S2);
        }
    }

    /// `rtde_set_watchdog`.
    pub fn set_watchdog(&mut self, input: Input, min_frequency_hz: f64, action: WatchdogAction) {
        let now_s = self.now_s();
        self.watchdogs
            .set(input, 1.0 / min_frequency_hz, now_s, action);
    }

    /// The action of a watchdog whose input was not written in time.
    pub fn watchdog_bite(&self) -> Option<WatchdogAction> {
        self.watchdogs.bite(self.now_s())
    }

    /// What an RTDE client writes; takes effect in the next cycle.
    pub fn write_input(&mut self, input: Input, value: Value) {
        self.watchdogs.feed(input, self.now_s());
        match (input, value) {
            (Input::Register(register), value) => register.write(&mut self.inputs, value),
            (Input::SpeedSliderMask, Value::UInt32(mask)) => self.slider_unlocked = mask & 1 == 1,
            (Input::SpeedSliderFraction, Value::Double(fraction))
                if self.slider_unlocked && fraction.is_finite() =>
            {
                self.speed_slider = fraction.clamp(0.0, 1.0);
            }
            (Input::OutputMask(group), Value::UInt8(mask)) => {
                self.output_masks[group as usize] = mask
            }
            (Input::Output(group), Value::UInt8(bits)) => {
                let mask = self.output_masks[group as usize];
                for bit in (0..group.count()).filter(|bit| mask >> bit & 1 == 1) {
                    self.set_output(group, bit, bits >> bit & 1 == 1);
                }
            }
            (Input::AnalogMask, Value::UInt8(mask)) => self.analog_mask = mask,
            (Input::AnalogType, Value::UInt8(volts)) => {
                let mask = self.analog_mask;
                self.analog_in_volts = self.analog_in_volts & !mask | volts & mask;
            }
            (Input::Analog(output), Value::Double(value))
                if self.analog_mask >> output & 1 == 1 && value.is_finite() =>
            {
                self.analog_outputs[output] = value.clamp(0.0, 1.0)
            }
            (Input::ExternalForceTorque, Value::Vector6D(wrench))
                if wrench.iter().all(|part| part.is_finite()) =>
            {
                self.external_wrench = wrench;
            }
            _ => {}
        }
    }

    /// Switches one digital output; numbers outside the group are left out.
    pub fn set_output(&mut self, group: Outputs, number: u32, on: bool) {
        if number < group.count() {
            let mask = 1 << (group.first_bit() + number);
            self.digital_outputs = if on {
                self.digital_outputs | mask
            } else {
                self.digital_outputs & !mask
            };
        }
    }

    /// One cycle of motion.
    pub fn advance(&mut self) {
        self.cycle += 1;
        let step_s = self.step_s();
        self.power.tick(self.now_s());
        if self.failed_joints.contains(&true) {
            self.power.break_down(Breakdown::Fault);
        }
        self.tell_safety();
        let wanted = if self.paused { 0.0 } else { self.speed_slider };
        self.scaling +=
            (wanted - self.scaling).clamp(-SCALING_PER_S * step_s, SCALING_PER_S * step_s);
        if self.power.mode != RobotMode::Running {
            self.rest_where_it_is();
            return;
        }
        let before = self.target;
        self.carry_payload();
        self.move_target();
        self.drives.follow(&self.target.q, step_s);
        for joint in 0..6 {
            self.target_qdd[joint] = (self.target.qd[joint] - before.qd[joint]) / step_s;
        }
        let lead = motion::largest_difference(&self.target.q, &self.drives.q);
        if lead > self.config.tracking_limit_rad {
            self.protective_stop(&format!("position deviates from path by {lead:.3} rad"));
        }
    }

    fn move_target(&mut self) {
        let (before, step_s) = (self.target, self.step_s());
        // A stop takes its real time whatever the slider says.
        let stopping = matches!(self.motion, Motion::JointSpeed { speed, .. } if speed == [0.0; 6]);
        let dt = if stopping {
            step_s
        } else {
            step_s * self.scaling
        };
        let progress = self.motion.advance(
            &self.dh,
            &mut self.target,
            &self.flange_from_tool,
            dt,
            step_s,
        );
        let fault = match progress {
            Progress::NoSolution => Some("no joint positions for the pose on the path".to_owned()),
            Progress::Moving | Progress::Reached => self.broken_limit(),
        };
        if let Some(fault) = fault {
            self.target = before;
            self.protective_stop(&fault);
            return;
        }
        if progress == Progress::Reached {
            self.reached = self.ticket;
            let ends = match &self.motion {
                Motion::Joints { .. } | Motion::Line { .. } => true,
                Motion::JointSpeed { .. } | Motion::ToolSpeed { .. } => self.target.qd == [0.0; 6],
                Motion::Rest | Motion::Servo { .. } => false,
            };
            if ends {
                self.motion = Motion::Rest;
                self.owner = None;
                self.target.qd = [0.0; 6];
            }
        }
    }

    /// The first limit that the commanded joints break.
    fn broken_limit(&self) -> Option<String> {
        let (position, speed) = (self.config.joint_range_rad, self.config.joint_speed_rad_s);
        (0..6).find_map(|joint| {
            let (q, qd) = (self.target.q[joint], self.target.qd[joint]);
            if !(q.is_finite() && q.abs() <= position) {
                Some(format!("joint {joint} at {q:.3} rad, limit {position:.3}"))
            } else if qd.abs() > speed * 1.05 {
                Some(format!("joint {joint} at {qd:.3} rad/s, limit {speed:.3}"))
            } else {
                None
            }
        })
    }

    fn tell_safety(&mut self) {
        let safety = self.power.safety();
        if safety != self.safety_told {
            tracing::info!(%safety, now_s = self.now_s(), "safety mode");
            self.safety_told = safety;
            self.log.push(Message::Safety(safety));
        }
    }

    /// What hangs at the flange is inertia to the joints that swing it.
    fn carry_payload(&mut self) {
        let carried_kg = self.carried_kg();
        let inertia_kg_m2 = if carried_kg > 0.0 {
            let flange_from_cog = Isometry3::from(Translation3::from(self.payload_cog_m));
            let jacobian = self.dh.jacobian(&self.drives.q, &flange_from_cog);
            std::array::from_fn(|joint| {
                carried_kg * jacobian.fixed_view::<3, 1>(0, joint).norm_squared()
            })
        } else {
            [0.0; 6]
        };
        self.drives.carry(inertia_kg_m2);
    }

    fn rest_where_it_is(&mut self) {
        self.drives.brake();
        self.target = Target::resting(self.drives.q);
        self.target_qdd = [0.0; 6];
        if self.is_moving() {
            self.stop(PROGRAM_STOP_RAD_S2);
            self.motion = Motion::Rest;
        }
    }
}
