//! An ideal robot in memory behind [`RobotLink`]: it follows every sample of a stream at once, consumes them as the
//! program on a controller does, and its clock advances by one period with each state.

use std::sync::{Arc, Mutex, MutexGuard};

use arthro_geometry::Rigid;
use ur_link::{
    Command, Error, Fault, ProgramState, RobotLink, RobotMode, RuntimeState, SafetyMode, State,
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
    /// Share of the next sample's time that has passed.
    sample_share: f64,
    pub scaling: f64,
    pub safety_mode: SafetyMode,
    pub program: ProgramState,
    /// Every command received.
    pub commands: Vec<Command>,
    /// Every sample of a stream that the joints followed.
    pub followed: Vec<Joints>,
    /// Packages that get lost on their way.
    pub packages_to_lose: usize,
    /// No states come.
    pub silent: bool,
    pub runtime_state: RuntimeState,
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
            sample_share: 0.0,
            scaling: 1.0,
            safety_mode: SafetyMode::Normal,
            program: ProgramState {
                ready: true,
                ..ProgramState::default()
            },
            commands: Vec::new(),
            followed: Vec::new(),
            packages_to_lose: 0,
            silent: false,
            runtime_state: RuntimeState::Playing,
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
        robot.runtime_state = RuntimeState::Playing;
        robot.program = ProgramState {
            ready: true,
            ..ProgramState::default()
        };
        Ok(self.clone())
    }
}

impl RobotLink for FakeRobot {
    fn period_s(&self) -> f64 {
        PERIOD_S
    }

    async fn next_state(&mut self) -> Result<State, Error> {
        tokio::task::yield_now().await;
        while self.lock().silent {
            tokio::time::sleep(std::time::Duration::from_millis(1)).await;
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
        if robot.packages_to_lose > 0 {
            robot.packages_to_lose -= 1;
            return Ok(());
        }
        let continues = match (robot.commands.last(), command) {
            (Some(Command::Stream(before)), Command::Stream(next)) => next.first >= before.first,
            (before, command) => before == Some(command),
        };
        if !continues {
            robot.program.sequence_sent += 1;
            robot.program.sequence_running = robot.program.sequence_sent;
            robot.program.sample_consumed = 0;
            if *command == Command::Hold {
                robot.program.fault = None;
            }
        }
        robot.commands.push(*command);
        Ok(())
    }
}

impl Robot {
    fn advance(&mut self) {
        self.time_s += PERIOD_S + std::mem::take(&mut self.gap_s);
        let before = self.joints;
        if let Some(Command::Stream(window)) = self.commands.last().copied()
            && self.program.fault.is_none()
            && self.program.ready
        {
            self.sample_share += self.scaling;
            if self.sample_share >= 1.0 - 1e-9 {
                self.sample_share = 0.0;
                let number = self.program.sample_consumed + 1;
                if let Some((_, joints)) = window.samples().find(|(n, _)| *n == number) {
                    self.joints = *joints;
                    self.program.sample_consumed = number;
                    self.followed.push(*joints);
                } else if window.last.is_none_or(|last| number <= last) {
                    self.program.fault = Some(Fault::Starved);
                } else {
                    self.program.sequence_done = self.program.sequence_running;
                }
            }
        } else {
            self.program.sequence_done = self.program.sequence_running;
        }
        self.speeds = std::array::from_fn(|i| (self.joints[i] - before[i]) / PERIOD_S);
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
            runtime_state: self.runtime_state,
            speed_scaling: self.scaling,
            target_speed_fraction: self.scaling,
            program: self.program,
        }
    }
}
