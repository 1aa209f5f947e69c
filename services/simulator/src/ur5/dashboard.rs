//! The answers of the dashboard server: one line in, one line out.
//!
//! Changes of power and safety only begin with an answer; clients watch `robotmode` and `safetymode` for their end. There
//! is no disk: programs come over the script interfaces, so nothing can be loaded.

use ur_link::RuntimeState;

use super::{Controller, Series, Since, Teller, pendant::OperationalMode, pendant::Pendant};

const ALWAYS: Since = Since::ALWAYS;

/// Commands with the versions that know them, and whether a controller in local control obeys them. A command that takes
/// an argument ends with a blank.
const COMMANDS: &[(&str, Since, Local)] = &[
    (
        "load installation ",
        Since::new([3, 2, 0], [5, 0, 0]),
        Local::Refused,
    ),
    ("load ", ALWAYS, Local::Refused),
    ("play", ALWAYS, Local::Refused),
    ("stop", ALWAYS, Local::Refused),
    ("pause", ALWAYS, Local::Refused),
    ("power on", ALWAYS, Local::Refused),
    ("power off", ALWAYS, Local::Refused),
    ("brake release", ALWAYS, Local::Refused),
    (
        "unlock protective stop",
        Since::new([3, 1, 0], [5, 0, 0]),
        Local::Refused,
    ),
    (
        "restart safety",
        Since::new([3, 7, 0], [5, 1, 0]),
        Local::Refused,
    ),
    (
        "close safety popup",
        Since::new([3, 1, 0], [5, 0, 0]),
        Local::Obeyed,
    ),
    ("close popup", ALWAYS, Local::Obeyed),
    ("popup ", ALWAYS, Local::Obeyed),
    ("addToLog", ALWAYS, Local::Obeyed),
    ("running", ALWAYS, Local::Obeyed),
    ("robotmode", ALWAYS, Local::Obeyed),
    ("safetymode", ALWAYS, Local::Obeyed),
    (
        "safetystatus",
        Since::new([3, 10, 0], [5, 4, 0]),
        Local::Obeyed,
    ),
    ("programState", ALWAYS, Local::Obeyed),
    ("get loaded program", ALWAYS, Local::Obeyed),
    ("isProgramSaved", ALWAYS, Local::Obeyed),
    ("PolyscopeVersion", ALWAYS, Local::Obeyed),
    ("version", Since::e_only([5, 0, 0]), Local::Obeyed),
    (
        "get serial number",
        Since::new([3, 12, 0], [5, 6, 0]),
        Local::Obeyed,
    ),
    (
        "get robot model",
        Since::new([3, 12, 0], [5, 6, 0]),
        Local::Obeyed,
    ),
    ("setUserRole ", Since::cb3_only([3, 1, 0]), Local::Obeyed),
    ("getUserRole", Since::cb3_only([3, 1, 0]), Local::Obeyed),
    (
        "is in remote control",
        Since::e_only([5, 6, 0]),
        Local::Obeyed,
    ),
    (
        "set operational mode ",
        Since::e_only([5, 0, 0]),
        Local::Obeyed,
    ),
    (
        "get operational mode",
        Since::e_only([5, 6, 0]),
        Local::Obeyed,
    ),
    (
        "clear operational mode",
        Since::e_only([5, 0, 0]),
        Local::Obeyed,
    ),
    (
        "generate flight report ",
        Since::new([3, 13, 0], [5, 8, 0]),
        Local::Obeyed,
    ),
    (
        "generate support file ",
        Since::new([3, 13, 0], [5, 8, 0]),
        Local::Obeyed,
    ),
    ("saveLog", Since::new([3, 13, 0], [5, 8, 0]), Local::Obeyed),
];

/// What local control means to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Local {
    Obeyed,
    Refused,
}

/// Answer of a controller in local control.
const LOCAL_CONTROL: &str = "Command is not allowed due to safety reasons";
const TOO_EARLY: &str = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop \
                         before unlocking";

impl Controller {
    /// Carries out one line as the dashboard server does and gives its answer.
    pub fn dashboard(&mut self, line: &str) -> String {
        let line = line.trim();
        let version = self.robot.config.software();
        let known = COMMANDS.iter().find_map(|(command, since, local)| {
            let argument = if command.ends_with(' ') {
                line.strip_prefix(command)?
            } else if *command == "addToLog" {
                line.strip_prefix(command)?
            } else {
                (line == *command).then_some("")?
            };
            version
                .has(*since)
                .then_some((command.trim_end(), argument.trim(), *local))
        });
        match known {
            None => format!("could not understand: '{line}'"),
            Some((_, _, Local::Refused)) if !self.takes_commands() => LOCAL_CONTROL.to_owned(),
            Some((command, argument, _)) => self
                .command(command, argument)
                .or_else(|| self.question(command))
                .unwrap_or_else(|| format!("Failed to execute: {line}")),
        }
    }

    /// What changes something; `None` for questions and for what cannot be done now.
    fn command(&mut self, command: &str, argument: &str) -> Option<String> {
        let done = |accepted: bool, answer: &str| accepted.then(|| answer.to_owned());
        match command {
            "power on" => done(self.robot.power.power_on(), "Powering on"),
            "power off" => {
                self.power_off();
                done(true, "Powering off")
            }
            "brake release" => done(self.robot.power.release_brakes(), "Brake releasing"),
            "unlock protective stop" => {
                let unlocks = self.robot.power.unlock();
                Some(
                    if unlocks {
                        "Protective stop releasing"
                    } else {
                        TOO_EARLY
                    }
                    .to_owned(),
                )
            }
            "restart safety" => {
                self.end_program();
                self.robot.power.restart_safety();
                done(true, "Restarting safety")
            }
            "stop" => {
                self.end_program();
                done(true, "Stopped")
            }
            "pause" => {
                let runs = self.program.is_some();
                self.set_paused(true);
                done(runs, "Pausing program")
            }
            "play" => {
                let waits = self.paused;
                self.set_paused(false);
                done(waits, "Starting program")
            }
            "load" => Some(format!("File not found: {argument}")),
            "load installation" => Some(format!("File not found: {argument}")),
            "popup" => done(true, "showing popup"),
            "close popup" => done(true, "closing popup"),
            "close safety popup" => done(true, "closing safety popup"),
            "addToLog" if argument.is_empty() => done(true, "No log message to add"),
            "addToLog" => {
                tracing::info!(message_text = argument, "dashboard client says");
                done(true, "Added log message")
            }
            "setUserRole" => {
                let role = Pendant::ROLES
                    .into_iter()
                    .find(|role| role.eq_ignore_ascii_case(argument));
                Some(match role {
                    Some(role) => {
                        self.pendant.role = role;
                        format!("Setting user role: {role}")
                    }
                    None => format!("Failed setting user role: {argument}"),
                })
            }
            "set operational mode" => {
                let mode = OperationalMode::from_word(argument)?;
                self.pendant.operational = Some(mode);
                Some(format!("Operational mode {} is set", mode.word()))
            }
            "clear operational mode" => {
                self.pendant.operational = None;
                Some(
                    "No longer controlling the operational mode. Current operational mode: 'NONE'."
                        .to_owned(),
                )
            }
            "generate flight report" => {
                Some(format!("Failed to generate flight report: {argument}"))
            }
            "generate support file" => Some(format!("Failed to generate support file: {argument}")),
            "saveLog" => done(true, "Log saved to disk"),
            _ => None,
        }
    }

    fn question(&self, command: &str) -> Option<String> {
        let config = &self.robot.config;
        Some(match command {
            "robotmode" => format!("Robotmode: {}", self.robot_mode()),
            "safetymode" => format!("Safetymode: {}", self.safety_mode()),
            "safetystatus" => format!("Safetystatus: {}", self.safety_mode()),
            "running" => {
                let runs = matches!(
                    self.runtime_state(),
                    RuntimeState::Playing | RuntimeState::Resuming
                );
                format!("Program running: {runs}")
            }
            "programState" => {
                let name = self.program_name().unwrap_or("<unnamed>");
                match self.runtime_state() {
                    RuntimeState::Playing | RuntimeState::Resuming => format!("PLAYING {name}"),
                    RuntimeState::Pausing | RuntimeState::Paused => format!("PAUSED {name}"),
                    _ => "STOPPED <unnamed>".to_owned(),
                }
            }
            "get loaded program" => "No program loaded".to_owned(),
            "isProgramSaved" => "true <unnamed>".to_owned(),
            "PolyscopeVersion" => format!(
                "URSoftware {} (Jan 01 2024)",
                self.told_version(Teller::Dashboard)
            ),
            "version" => self.told_version(Teller::Dashboard).to_string(),
            "get serial number" => config.serial().to_owned(),
            "get robot model" => "UR5".to_owned(),
            "getUserRole" => self.pendant.role.to_owned(),
            "is in remote control" => {
                (config.series == Series::E && self.takes_commands()).to_string()
            }
            "get operational mode" => self
                .pendant
                .operational
                .map_or("NONE", OperationalMode::word)
                .to_owned(),
            _ => return None,
        })
    }
}
