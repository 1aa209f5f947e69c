//! A simulated controller of a UR5 (CB3) or UR5e (e-Series): joints that follow commands with lag and limits, a URScript
//! interpreter, and the network services of the real one.
//!
//! [`Controller`] is pure and synchronous: [`Controller::tick`] advances it by one cycle ([`Controller::step_s`]), whatever
//! the wall clock says. [`servers::serve`] puts it on the network.

mod config;
mod dashboard;
mod joints;
pub mod kinematics;
mod motion;
mod outputs;
mod power;
mod primary;
mod profile;
mod realtime;
mod registers;
mod robot;
mod series;
pub mod servers;
mod urscript;

use nalgebra::Isometry3;
use ur_link::{RobotMode, RuntimeState, SafetyMode, rtde::wire::Value};

pub use config::{Config, ScriptNetwork};
pub use outputs::Output;
pub use registers::Input;
pub use robot::Message;
pub use series::{NotAVersion, Series, Since, Version};
pub use servers::{Ports, ServerOptions, Servers, Shared, serve};
pub use urscript::Error as ScriptError;

use kinematics::Joints;
use robot::{Robot, WatchdogAction};
use urscript::{Ending, Machine};

/// Secondary programs that may run at once.
const MAX_SECONDARIES: usize = 8;

/// One arm with its controller.
#[derive(Debug)]
pub struct Controller {
    robot: Robot,
    program: Option<Machine>,
    secondaries: Vec<Machine>,
    paused: bool,
}

impl Controller {
    /// At rest, no program.
    pub fn new(config: Config) -> Self {
        Self {
            robot: Robot::new(config),
            program: None,
            secondaries: Vec::new(),
            paused: false,
        }
    }

    /// One cycle: programs run, then the arm moves.
    pub fn tick(&mut self) {
        if !self.robot.power.may_move() {
            self.end_program();
        }
        match self.robot.watchdog_bite() {
            Some(WatchdogAction::Pause) => self.set_paused(true),
            Some(WatchdogAction::Stop) => self.end_program(),
            Some(WatchdogAction::Ignore) | None => {}
        }
        if !self.paused
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
        self.robot.drives.q
    }

    /// How fast they truly move, rad/s.
    pub fn speeds_rad_s(&self) -> Joints {
        self.robot.drives.qd
    }

    /// Base from flange where the arm truly is, m.
    pub fn flange(&self) -> Isometry3<f64> {
        self.robot.dh.flange(&self.robot.drives.q)
    }

    /// Power and brakes.
    pub fn robot_mode(&self) -> RobotMode {
        self.robot.power.mode
    }

    /// Safety system.
    pub fn safety_mode(&self) -> SafetyMode {
        self.robot.power.safety
    }

    /// Whether a program runs.
    pub fn runtime_state(&self) -> RuntimeState {
        match (&self.program, self.paused) {
            (None, _) => RuntimeState::Stopped,
            (Some(_), false) => RuntimeState::Playing,
            (Some(_), true) => RuntimeState::Paused,
        }
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
        let outcome = urscript::compile(text, self.robot.config.version).and_then(|program| {
            let refused = |text: String| {
                Err(ScriptError {
                    line: 0,
                    column: 0,
                    text,
                })
            };
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
                    power.mode, power.safety
                ));
            }
            self.end_program();
            self.log_key("STARTED", &program.name);
            self.program = Some(Machine::new(program, &mut self.robot));
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

    fn set_paused(&mut self, paused: bool) {
        if self.program.is_some() {
            self.paused = paused;
            self.robot.set_paused(paused);
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
