//! A simulated controller of a UR5 (CB3) or UR5e (e-Series): joints that follow commands with lag and limits, a URScript
//! interpreter, and the network services of the real one.
//!
//! [`Controller`] is pure and synchronous: [`Controller::tick`] advances it by one cycle ([`Controller::step_s`]), whatever
//! the wall clock says. [`servers::serve`] puts it on the network.

mod config;
mod dashboard;
mod joints;
pub mod kinematics;
pub mod link_fault;
mod measurements;
mod messages;
mod motion;
mod outputs;
mod pendant;
mod power;
mod primary;
mod profile;
mod realtime;
mod registers;
mod robot;
mod series;
pub mod servers;
mod urscript;
mod watchdog;

use nalgebra::Isometry3;
use ur_link::{RobotMode, RuntimeState, SafetyMode, rtde::wire::Value};

pub use config::{Calibration, Config, OutOfRange, ScriptNetwork};
pub use messages::{Level, Message};
pub use outputs::Output;
pub use pendant::{Control, OperationalMode};
pub use power::{Breakdown, Button, Safeguard};
pub use registers::Input;
pub use series::{NotAVersion, Series, Since, Version};
pub use servers::{Ports, ServerOptions, Servers, Shared, serve};
pub use urscript::Error as ScriptError;

use kinematics::Joints;
use pendant::Pendant;
use power::Permission;
use robot::{Robot, WatchdogAction};
use urscript::{Ending, Machine};

/// From a program's arrival to its first line. Real controllers take longer; without any, a program would still see the
/// registers of before, because what its sender wrote to them last comes through another socket.
const START_S: f64 = 0.024;
/// Secondary programs that may run at once.
const MAX_SECONDARIES: usize = 8;

/// What is wrong with an arm, as somebody made it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Condition {
    /// The emergency stop of the robot.
    pub robot_button_pressed: bool,
    /// One of the cell around it.
    pub system_button_pressed: bool,
    /// The safeguard input.
    pub safeguard: Safeguard,
    /// Joints that do not respond.
    pub failed_joints: [bool; 6],
    /// Lag on top of what the joints are made with, s.
    pub extra_lag_s: Joints,
    /// What the encoders tell too much, rad.
    pub encoder_offset_rad: Joints,
    /// 0..1
    pub speed_slider: f64,
}

/// Services that tell the version of the software.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Teller {
    /// Answers of the RTDE server.
    Rtde,
    /// Answers of the dashboard server.
    Dashboard,
    /// The message that follows a connection to a primary or secondary interface.
    Primary,
}

/// One arm with its controller.
#[derive(Debug)]
pub struct Controller {
    robot: Robot,
    program: Option<Machine>,
    secondaries: Vec<Machine>,
    pendant: Pendant,
    /// What clients are told instead of the true version.
    claims: [Option<Version>; 3],
    paused: bool,
    /// The program was held and speeds up again.
    resuming: bool,
}

impl Controller {
    /// At rest, no program.
    pub fn new(config: Config) -> Self {
        Self {
            pendant: Pendant::new(config.control),
            robot: Robot::new(config),
            program: None,
            secondaries: Vec::new(),
            claims: [None; 3],
            paused: false,
            resuming: false,
        }
    }

    /// One cycle: programs run, then the arm moves.
    pub fn tick(&mut self) {
        if self.robot.power.permission() == Permission::End {
            self.end_program();
        }
        match self.robot.watchdog_bite() {
            Some(WatchdogAction::Pause) => self.set_paused(true),
            Some(WatchdogAction::Stop) => self.end_program(),
            Some(WatchdogAction::Ignore) | None => {}
        }
        let held = self.is_held();
        self.robot.set_paused(held);
        if !held
            && let Some(ending) = self
                .program
                .as_mut()
                .and_then(|program| program.step(&mut self.robot))
        {
            self.report(&ending);
            self.end_program();
        }
        let endings: Vec<_> = self
            .secondaries
            .iter_mut()
            .map(|secondary| secondary.step(&mut self.robot))
            .collect();
        endings
            .iter()
            .flatten()
            .for_each(|ending| self.report(ending));
        let mut endings = endings.iter();
        self.secondaries
            .retain(|_| endings.next().is_some_and(Option::is_none));
        self.robot.advance();
        self.resuming &= !self.robot.is_at_speed();
    }

    /// One cycle, s.
    pub fn step_s(&self) -> f64 {
        self.robot.step_s()
    }

    /// s since the start.
    pub fn timestamp_s(&self) -> f64 {
        self.robot.now_s()
    }

    /// Where the joints truly are, rad.
    pub fn joints_rad(&self) -> Joints {
        self.robot.drives.true_q()
    }

    /// How fast they truly move, rad/s.
    pub fn speeds_rad_s(&self) -> Joints {
        self.robot.drives.qd
    }

    /// Base from flange where the arm truly is, m.
    pub fn flange(&self) -> Isometry3<f64> {
        self.robot.dh.flange(&self.joints_rad())
    }

    /// Power and brakes.
    pub fn robot_mode(&self) -> RobotMode {
        self.robot.power.mode
    }

    /// Safety system.
    pub fn safety_mode(&self) -> SafetyMode {
        self.robot.power.safety()
    }

    /// Whether a program runs. A held program is `Pausing` until the arm has come to rest on its path, and `Resuming` until
    /// it is back at speed; an ended one is `Stopping` while the arm still slows down.
    pub fn runtime_state(&self) -> RuntimeState {
        match (&self.program, self.is_held()) {
            (None, _) if self.robot.is_moving() => RuntimeState::Stopping,
            (None, _) => RuntimeState::Stopped,
            (Some(_), true) if self.robot.scaling() > 0.0 => RuntimeState::Pausing,
            (Some(_), true) => RuntimeState::Paused,
            (Some(_), false) if self.resuming => RuntimeState::Resuming,
            (Some(_), false) => RuntimeState::Playing,
        }
    }

    fn is_held(&self) -> bool {
        self.paused || self.robot.power.permission() == Permission::Wait
    }

    /// Name of the running program.
    pub fn program_name(&self) -> Option<&str> {
        self.program.as_ref().map(Machine::name)
    }

    /// Starts a program; the one that runs ends. A `sec` runs beside it.
    ///
    /// # Errors
    /// Text that is no program (also reported to the clients, as the real controller does), or an arm that may not move.
    pub fn load_program(&mut self, text: &str) -> Result<(), ScriptError> {
        let outcome = urscript::compile(text, self.robot.config.software()).and_then(|program| {
            let refused = |text: String| {
                Err(ScriptError {
                    line: 0,
                    column: 0,
                    text,
                })
            };
            if !self.takes_commands() {
                return refused("controller is in local control".to_owned());
            }
            if program.secondary {
                if self.secondaries.len() >= MAX_SECONDARIES {
                    return refused(format!("more than {MAX_SECONDARIES} secondary programs"));
                }
                self.secondaries
                    .push(Machine::new(program, &mut self.robot));
                return Ok(());
            }
            let power = &self.robot.power;
            if !power.may_move() {
                return refused(format!(
                    "no program in robot mode {}, safety mode {}",
                    power.mode,
                    power.safety()
                ));
            }
            self.end_program();
            self.log_key("STARTED", &program.name);
            let machine = Machine::new(program, &mut self.robot);
            self.program = Some(machine.starting_at(self.robot.now_s() + START_S));
            Ok(())
        });
        if let Err(error) = &outcome {
            self.robot.log.push(exception(error));
        }
        outcome
    }

    /// Ends the running program; the arm comes to rest.
    pub fn end_program(&mut self) {
        if let Some(program) = self.program.take() {
            self.log_key("STOPPED", program.name());
            self.robot.program_ended();
            self.paused = false;
            self.resuming = false;
        }
    }

    /// Stops the arm until it is unlocked, 5 s later at the earliest. What a collision does.
    pub fn protective_stop(&mut self, reason: &str) {
        self.robot.protective_stop(reason);
    }

    /// 0..1, as on the screen of the real controller.
    pub fn set_speed_slider(&mut self, fraction: f64) {
        if fraction.is_finite() {
            self.robot.speed_slider = fraction.clamp(0.0, 1.0);
        }
    }

    /// Writes one RTDE input; it takes effect in the next cycle.
    pub fn write_input(&mut self, input: Input, value: Value) {
        self.robot.write_input(input, value);
    }

    /// Presses an emergency stop: the program ends, the arm stops and loses its power.
    pub fn press_emergency_stop(&mut self, button: Button) {
        self.robot.press(button);
    }

    /// Pulls it out again. The arm stays without power until it is powered on.
    pub fn release_emergency_stop(&mut self, button: Button) {
        self.robot.power.release(button);
    }

    /// Opens, closes or resets the safeguard. `Open`: the program waits, the arm holds. `AwaitsReset`: closed, but the stop
    /// holds. `Clear`: closed if it was open, and reset, whereupon the program goes on from where it waited.
    pub fn set_safeguard(&mut self, safeguard: Safeguard) {
        let power = &mut self.robot.power;
        let held = power.permission() == Permission::Wait;
        match safeguard {
            Safeguard::Open => power.open_safeguard(),
            Safeguard::AwaitsReset => power.close_safeguard(),
            Safeguard::Clear => {
                power.close_safeguard();
                power.reset_safeguard();
                self.resuming |= held && !self.paused && self.program.is_some();
            }
        }
    }

    /// Power off until the safety system is restarted.
    pub fn break_down(&mut self, breakdown: Breakdown) {
        self.robot.power.break_down(breakdown);
    }

    /// A joint fails, or is whole again; after that the safety system needs a restart.
    pub fn set_joint_failed(&mut self, joint: usize, failed: bool) {
        self.robot.set_joint_failed(joint, failed);
    }

    /// Lets the joints lag more than they are made to, s, at least 0.
    pub fn set_extra_lag(&mut self, extra_lag_s: Joints) {
        if extra_lag_s.iter().all(|lag_s| (0.0..=10.0).contains(lag_s)) {
            self.robot.set_extra_lag(extra_lag_s);
        }
    }

    /// Lets the encoders tell so much more than what is true, rad.
    pub fn slip_encoders(&mut self, offset_rad: Joints) {
        if offset_rad.iter().all(|offset| offset.is_finite()) {
            self.robot.drives.slip_encoders(offset_rad);
        }
    }

    /// Who commands an e-Series; without effect on a CB3, which knows no difference.
    pub fn set_control(&mut self, control: Control) {
        self.pendant.control = control;
    }

    /// Takes the power away at once.
    pub fn power_off(&mut self) {
        self.end_program();
        self.robot.power_off();
    }

    /// What is wrong with the arm, as somebody made it.
    pub fn condition(&self) -> Condition {
        let (robot, power) = (&self.robot, &self.robot.power);
        Condition {
            robot_button_pressed: power.is_pressed(Button::Robot),
            system_button_pressed: power.is_pressed(Button::System),
            safeguard: power.safeguard(),
            failed_joints: *robot.failed_joints(),
            extra_lag_s: robot.extra_lag_s(),
            encoder_offset_rad: robot.drives.offset_rad(),
            speed_slider: robot.speed_slider,
        }
    }

    /// Generation of the controller.
    pub fn series(&self) -> Series {
        self.robot.config.series
    }

    /// Lets one of the services tell another version than the true one; everything else stays as it is.
    pub fn claim_version(&mut self, teller: Teller, version: Option<Version>) {
        self.claims[teller as usize] = version;
    }

    /// What clients are told of the software: the truth, or what somebody lets it claim.
    fn told_version(&self, teller: Teller) -> Version {
        self.claims[teller as usize].unwrap_or(self.robot.config.software())
    }

    /// Clients may send programs and commands.
    fn takes_commands(&self) -> bool {
        self.robot.config.series == Series::Cb3 || self.pendant.control == Control::Remote
    }

    fn set_paused(&mut self, paused: bool) {
        if self.program.is_some() {
            self.resuming = self.paused && !paused;
            self.paused = paused;
        }
    }

    fn report(&mut self, ending: &Ending) {
        if let Ending::Failed(error) = ending {
            tracing::warn!(line = error.line, text = %error.text, "urscript runtime exception");
            self.robot.log.push(exception(error));
        }
    }

    fn log_key(&mut self, what: &str, program: &str) {
        tracing::debug!(
            program,
            now_s = self.robot.now_s(),
            "program {}",
            what.to_lowercase()
        );
        self.robot.log.push(Message::Key {
            title: format!("PROGRAM_XXX_{what}"),
            text: program.to_owned(),
        });
    }
}

fn exception(error: &ScriptError) -> Message {
    Message::RuntimeException {
        line: error.line as i32,
        column: error.column as i32,
        text: error.text.clone(),
    }
}

#[cfg(test)]
mod tests;
