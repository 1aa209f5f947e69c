//! The arm without its programs: modes, motion, joints, registers. Programs act on it through these methods; it moves
//! by one cycle at a time.

use std::{collections::VecDeque, sync::Arc};

use nalgebra::Isometry3;
use ur_link::{RobotMode, rtde::wire::Value};

use super::{
    Config,
    joints::Drives,
    kinematics::{self, Dh, Joints},
    motion::{self, Blend, Chase, Motion, Progress, Target},
    power::Power,
    registers::{Bank, Input, Outputs},
    urscript::{Isolated, Network},
};

/// Deceleration when a program ends or loses its motion, rad/s².
const PROGRAM_STOP_RAD_S2: f64 = 4.0;
/// Deceleration of a protective stop, rad/s².
const PROTECTIVE_STOP_RAD_S2: f64 = 20.0;
/// Largest change of the speed scaling, 1/s: full speed to pause in 80 ms.
const SCALING_PER_S: f64 = 12.5;
/// Lines kept for clients that are slow to fetch them.
const LOG_LINES: usize = 256;

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
    /// `set_tcp`: flange from tool, m and rotation vector.
    pub tcp_offset: Joints,
    /// `set_payload`, kg.
    pub payload_kg: f64,
    /// Centre of gravity at the flange, m.
    pub payload_cog_m: [f64; 3],
    /// 0..1
    pub speed_slider: f64,
    /// Where sockets of programs lead.
    pub network: Arc<dyn Network>,
    /// A message box waits for a person to close it.
    pub popup_open: bool,
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
    /// How near to its goal the present path may be followed by the next, m.
    blend_m: f64,
    /// The present path is that near.
    blending: bool,
    threads: u64,
    output_masks: [u8; 3],
    slider_unlocked: bool,
    watchdogs: Vec<Watchdog>,
}

#[derive(Debug)]
struct Watchdog {
    input: Input,
    period_s: f64,
    last_s: f64,
    action: WatchdogAction,
}

/// What `rtde_set_watchdog` does when its input is not written in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchdogAction {
    /// The program waits.
    Pause,
    /// The program ends.
    Stop,
    /// Nothing.
    Ignore,
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
                config.joint_speed_rad_s,
                config.joint_accel_rad_s2,
            ),
            inputs: Bank::default(),
            outputs: Bank::default(),
            digital_outputs: 0,
            analog_outputs: [0.0; 2],
            tcp_offset: [0.0; 6],
            payload_kg: 0.0,
            payload_cog_m: [0.0; 3],
            speed_slider: 1.0,
            network: Arc::new(Isolated),
            popup_open: false,
            log: Log::default(),
            cycle: 0,
            scaling: 1.0,
            paused: false,
            flange_from_tool: Isometry3::identity(),
            motion: Motion::Rest,
            owner: None,
            ticket: Ticket(0),
            reached: Ticket(0),
            blend_m: 0.0,
            blending: false,
            threads: 0,
            output_masks: [0; 3],
            slider_unlocked: false,
            watchdogs: Vec::new(),
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

    /// `servoc` from how the tool moves now.
    pub fn chase(&self, goal: Isometry3<f64>, speed: f64, accel: f64) -> Motion {
        let tool = self.dh.flange(&self.target.q) * self.flange_from_tool;
        let chase = match &self.motion {
            Motion::Chase(chase) => chase.towards(tool, goal, speed, accel),
            _ => {
                let twist = self.tool_speed(&self.target.q, &self.target.qd).into();
                Chase::new(tool, twist, goal, speed, accel)
            }
        };
        Motion::Chase(Box::new(chase))
    }

    /// `speedl` or `stopl` from how the tool moves now.
    pub fn tool_motion(&self, speed: nalgebra::Vector6<f64>, accel: f64) -> Motion {
        // Of a motion that goes on, the twist is known better than from its last way.
        if let Motion::ToolSpeed { twist, .. } = &self.motion {
            let pose = self.dh.flange(&self.target.q) * self.flange_from_tool;
            let twist = *twist;
            return Motion::ToolSpeed {
                pose,
                twist,
                speed,
                accel,
            };
        }
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
                self.power.mode, self.power.safety
            ));
        }
        if self.motion.is_path() && self.owner.is_some_and(|other| other != owner) {
            return Err("another thread is already controlling the robot".to_owned());
        }
        self.ticket.0 += 1;
        self.motion = motion;
        self.owner = Some(owner);
        (self.blend_m, self.blending) = (0.0, false);
        Ok(self.ticket)
    }

    /// Begins a path that `build` makes from the joints at its start: where the last path ends when the arm is within
    /// its blend radius, where the arm is otherwise. The next path may begin within `blend_m` of the goal.
    ///
    /// # Errors
    /// As [`Robot::begin`], and what `build` refuses.
    pub fn begin_path(
        &mut self,
        owner: ThreadId,
        blend_m: f64,
        build: impl FnOnce(&Self, &Joints) -> Result<Motion, String>,
    ) -> Result<Ticket, String> {
        let corner = if self.blending && self.owner == Some(owner) {
            self.corner()
        } else {
            None
        };
        let start = corner.unwrap_or(self.target.q);
        let path = build(self, &start)?;
        // Of a short way only a half may be cut off.
        let goal = path.goal(&self.dh, &self.flange_from_tool);
        let way_m = goal.map_or(0.0, |goal| {
            let from = self.dh.flange(&start) * self.flange_from_tool;
            (goal.translation.vector - from.translation.vector).norm()
        });
        let motion = match corner {
            Some(corner) => {
                let first = self.motion.clone();
                Motion::Blend(Box::new(Blend::new(first, self.target, corner, path)))
            }
            None => path,
        };
        let ticket = self.begin(owner, motion)?;
        self.blend_m = blend_m.min(0.5 * way_m);
        Ok(ticket)
    }

    /// The path of this ticket is within its blend radius: the next one may begin.
    pub fn may_blend(&self, ticket: Ticket) -> bool {
        self.blending && self.ticket == ticket
    }

    /// The joints at the goal of the present path.
    fn corner(&self) -> Option<Joints> {
        if let Motion::Joints { to, .. } = &self.motion {
            return Some(*to);
        }
        let goal = self.motion.goal(&self.dh, &self.flange_from_tool)?;
        self.dh
            .inverse(&goal, &self.flange_from_tool, &self.target.q)
    }

    fn watch_blend(&mut self) {
        if self.blend_m > 0.0
            && let Some(goal) = self.motion.goal(&self.dh, &self.flange_from_tool)
        {
            let tool = self.dh.flange(&self.target.q) * self.flange_from_tool;
            let left_m = (goal.translation.vector - tool.translation.vector).norm();
            self.blending = left_m <= self.blend_m;
        }
    }

    /// Where the present path leads the tool, or where the tool is commanded to be.
    pub fn waypoint(&self) -> Joints {
        let goal = self.motion.goal(&self.dh, &self.flange_from_tool);
        goal.map_or_else(
            || self.tool_pose(&self.target.q),
            |goal| kinematics::to_pose(&goal),
        )
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
        (self.blend_m, self.blending) = (0.0, false);
        self.motion = Motion::JointSpeed {
            speed: [0.0; 6],
            accel,
        };
    }

    /// Stops the arm until a person unlocks it.
    pub fn protective_stop(&mut self, reason: &str) {
        if self.power.safety.allows_motion() && self.power.mode == RobotMode::Running {
            tracing::warn!(reason, now_s = self.now_s(), "protective stop");
            self.log.push(Message::Error {
                code: 153,
                argument: 0,
                text: format!("protective stop: {reason}"),
            });
            self.power.protective_stop();
            self.stop(PROTECTIVE_STOP_RAD_S2);
        }
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
        self.watchdogs.retain(|watchdog| watchdog.input != input);
        self.watchdogs.push(Watchdog {
            input,
            period_s: 1.0 / min_frequency_hz,
            last_s: self.now_s(),
            action,
        });
    }

    /// The action of a watchdog whose input was not written in time.
    pub fn watchdog_bite(&self) -> Option<WatchdogAction> {
        let late = |watchdog: &&Watchdog| self.now_s() - watchdog.last_s > watchdog.period_s + 1e-9;
        self.watchdogs
            .iter()
            .find(late)
            .map(|watchdog| watchdog.action)
    }

    /// What an RTDE client writes; takes effect in the next cycle.
    pub fn write_input(&mut self, input: Input, value: Value) {
        let now_s = self.now_s();
        for watchdog in self
            .watchdogs
            .iter_mut()
            .filter(|watchdog| watchdog.input == input)
        {
            watchdog.last_s = now_s;
        }
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
            (Input::Analog(output), Value::Double(value)) => {
                self.analog_outputs[output] = value.clamp(0.0, 1.0)
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
        let wanted = if self.paused { 0.0 } else { self.speed_slider };
        self.scaling +=
            (wanted - self.scaling).clamp(-SCALING_PER_S * step_s, SCALING_PER_S * step_s);
        if self.power.mode != RobotMode::Running {
            self.rest_where_it_is();
            return;
        }
        let before = self.target;
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
        self.watch_blend();
        if progress == Progress::Reached {
            self.reached = self.ticket;
            let ends = match &self.motion {
                Motion::Joints { .. } | Motion::Line { .. } | Motion::Arc(_) | Motion::Blend(_) => {
                    true
                }
                Motion::JointSpeed { .. } | Motion::ToolSpeed { .. } => self.target.qd == [0.0; 6],
                Motion::Rest | Motion::Servo { .. } | Motion::Chase(_) => false,
            };
            if ends {
                self.motion = Motion::Rest;
                self.owner = None;
                self.blending = false;
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

/// What the controller tells its clients on the primary interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// `textmsg`.
    Text(String),
    /// `popup`.
    Popup(String),
    /// A program started or ended.
    Key {
        /// Such as "PROGRAM_XXX_STARTED".
        title: String,
        /// Name of the program.
        text: String,
    },
    /// Printed as C153A0.
    Error {
        /// Code.
        code: i32,
        /// Argument.
        argument: i32,
        /// Explanation.
        text: String,
    },
    /// A program went wrong.
    RuntimeException {
        /// From 1.
        line: i32,
        /// From 1.
        column: i32,
        /// Explanation.
        text: String,
    },
}

/// The last messages, numbered without end.
#[derive(Debug, Default)]
pub struct Log {
    first: u64,
    lines: VecDeque<Message>,
}

impl Log {
    /// Appends; the oldest is forgotten when there are too many.
    pub fn push(&mut self, message: Message) {
        if self.lines.len() == LOG_LINES {
            self.lines.pop_front();
            self.first += 1;
        }
        self.lines.push_back(message);
    }

    /// Number that the next message gets.
    pub fn next(&self) -> u64 {
        self.first + self.lines.len() as u64
    }

    /// Messages from this number on that are still kept.
    pub fn since(&self, number: u64) -> impl Iterator<Item = &Message> {
        let skipped = usize::try_from(number.saturating_sub(self.first)).unwrap_or(usize::MAX);
        self.lines.iter().skip(skipped)
    }
}
