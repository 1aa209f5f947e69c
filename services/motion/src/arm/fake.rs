//! An ideal robot in memory behind [`RobotLink`]: it follows every servo target at once, and its clock
//! advances by one period with each state.

use std::sync::{Arc, Mutex, MutexGuard};

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Rigid, Rotation, Vector3};
use ur_link::{
    Command, Error, ProgramState, RobotLink, RobotMode, RuntimeState, SafetyMode, State,
};

use crate::arm::Connect;
use crate::kinematics::{Joints, ToolArm};
use crate::rcm::shaft;

pub const PERIOD_S: f64 = 0.008;

/// The robot, shared by the links to it and the test.
#[derive(Clone)]
pub struct FakeRobot(Arc<Mutex<Robot>>);

pub struct Robot {
    arm: ToolArm,
    pub time_s: f64,
    /// Added to the clock once.
    pub gap_s: f64,
    pub joints: Joints,
    /// What the encoders show beside the truth.
    pub encoder_error: Joints,
    /// What they show of the speeds beside the truth.
    pub speed_error: Joints,
    /// How much farther along the shaft the tool seems to be than it is, mm.
    pub forward_mm: f64,
    pub robot_mode: RobotMode,
    speeds: Joints,
    pub scaling: f64,
    pub safety_mode: SafetyMode,
    pub program: ProgramState,
    /// Every command received.
    pub commands: Vec<Command>,
    /// No state comes.
    pub silent: bool,
    /// Links fail and none can be made.
    pub unreachable: bool,
    pub links_made: usize,
}

impl FakeRobot {
    pub fn new(arm: ToolArm, joints: Joints) -> Self {
        Self(Arc::new(Mutex::new(Robot {
            arm,
            time_s: 100.0,
            gap_s: 0.0,
            joints,
            encoder_error: [0.0; 6],
            speed_error: [0.0; 6],
            forward_mm: 0.0,
            robot_mode: RobotMode::Running,
            speeds: [0.0; 6],
            scaling: 1.0,
            safety_mode: SafetyMode::Normal,
            program: ProgramState {
                ready: true,
                ..ProgramState::default()
            },
            commands: Vec::new(),
            silent: false,
            unreachable: false,
            links_made: 0,
        })))
    }

    pub fn lock(&self) -> MutexGuard<'_, Robot> {
        self.0.lock().unwrap()
    }
}

impl Connect for FakeRobot {
    type Link = FakeRobot;

    async fn connect(&mut self) -> Result<Self, Error> {
        tokio::task::yield_now().await;
        let mut robot = self.lock();
        if robot.unreachable {
            return Err(Error::Closed { service: "rtde" });
        }
        robot.links_made += 1;
        robot.program = ProgramState {
            ready: true,
            ..ProgramState::default()
        };
        Ok(self.clone())
    }
}

impl RobotLink for FakeRobot {
    async fn next_state(&mut self) -> Result<State, Error> {
        tokio::task::yield_now().await;
        while self.lock().silent {
            tokio::task::yield_now().await;
        }
        let mut robot = self.lock();
        if robot.unreachable {
            return Err(Error::Closed { service: "rtde" });
        }
        robot.advance();
        Ok(robot.state())
    }

    async fn send(&mut self, command: &Command) -> Result<(), Error> {
        let mut robot = self.lock();
        let continues = match (robot.commands.last(), command) {
            (Some(Command::Servo { .. }), Command::Servo { .. }) => true,
            (before, command) => before == Some(command),
        };
        if !continues {
            robot.program.sequence_sent += 1;
            robot.program.sequence_running = robot.program.sequence_sent;
        }
        robot.commands.push(*command);
        Ok(())
    }
}

impl Robot {
    fn advance(&mut self) {
        self.time_s += PERIOD_S + std::mem::take(&mut self.gap_s);
        let (next, finished) = match self.commands.last() {
            None | Some(Command::Hold | Command::Stop) => (self.joints, true),
            Some(Command::Servo { joints_rad }) => (*joints_rad, false),
            Some(Command::MoveJ {
                joints_rad,
                speed_rad_s,
                ..
            }) => {
                let step = speed_rad_s * PERIOD_S;
                let next = std::array::from_fn(|i| {
                    self.joints[i] + (joints_rad[i] - self.joints[i]).clamp(-step, step)
                });
                (next, next == *joints_rad)
            }
            Some(Command::MoveL {
                base_from_tool,
                speed_m_s,
                ..
            }) => self.along_line(base_from_tool, speed_m_s * 1e3 * PERIOD_S),
        };
        self.speeds = std::array::from_fn(|i| (next[i] - self.joints[i]) / PERIOD_S);
        self.joints = next;
        if finished {
            self.program.sequence_done = self.program.sequence_running;
        }
    }

    fn along_line(&self, pose: &[f64; 6], step_mm: f64) -> (Joints, bool) {
        let end: Rigid<Base, Tool> = Rigid::new(
            Rotation::from_scaled_axis(Vector3::new(pose[3], pose[4], pose[5])),
            Vector3::new(pose[0], pose[1], pose[2]) * 1e3,
        );
        let here = self.arm.base_from_tool(&self.joints);
        let left_mm = (end.origin() - here.origin()).norm();
        let share = (step_mm / left_mm.max(1e-9)).min(1.0);
        let next = Rigid::new(
            here.rotation().slerp(&end.rotation(), share),
            here.translation_mm().lerp(&end.translation_mm(), share),
        );
        (self.arm.joints(&next, &self.joints).unwrap(), share >= 1.0)
    }

    fn measured(&self) -> Joints {
        if self.forward_mm == 0.0 {
            return std::array::from_fn(|i| self.joints[i] + self.encoder_error[i]);
        }
        let pose = self.arm.base_from_tool(&self.joints);
        let ahead = pose.translation_mm() + shaft(&pose) * self.forward_mm;
        let ahead = self
            .arm
            .joints(&Rigid::new(pose.rotation(), ahead), &self.joints)
            .unwrap();
        std::array::from_fn(|i| ahead[i] + self.encoder_error[i])
    }

    fn state(&self) -> State {
        State {
            timestamp_s: self.time_s,
            actual_q: self.measured(),
            target_q: self.joints,
            actual_qd: std::array::from_fn(|i| self.speeds[i] + self.speed_error[i]),
            actual_tcp_pose: [0.0; 6],
            robot_mode: self.robot_mode,
            safety_mode: self.safety_mode,
            runtime_state: RuntimeState::Playing,
            speed_scaling: self.scaling,
            target_speed_fraction: self.scaling,
            program: self.program,
        }
    }
}
