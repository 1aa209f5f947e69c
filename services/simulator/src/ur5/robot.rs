//! The arm without its programs: modes, motion, joints, registers. Programs act on it through these methods; it moves
//! by one cycle at a time.

mod inputs;
mod load;
mod safety;

use std::sync::Arc;

use nalgebra::Isometry3;
use ur_link::{RobotMode, SafetyMode};

use super::{
    Config,
    joints::{Drives, Limits},
    kinematics::{self, Dh, Joints},
    motion::{self, Blend, Chase, Motion, Progress, Target},
    power::{Breakdown, Power},
    registers::Bank,
    urscript::{Isolated, Network},
    watchdog::Watchdogs,
};

pub use super::messages::{Level, Log, Message};
pub use super::watchdog::WatchdogAction;
pub use load::GRAVITY_M_S2;

/// Deceleration when a program ends or loses its motion, rad/s².
const PROGRAM_STOP_RAD_S2: f64 = 4.0;
/// Largest change of the speed scaling, 1/s: full speed to pause in 80 ms.
const SCALING_PER_S: f64 = 12.5;

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
                self.power.mode,
                self.power.safety()
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
