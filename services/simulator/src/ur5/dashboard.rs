//! The answers of the dashboard server: one line in, one line out.

use ur_link::{RuntimeState, SafetyMode};

use super::Controller;

impl Controller {
    /// Carries out one line as the dashboard server does and gives its answer.
    pub fn dashboard(&mut self, line: &str) -> String {
        let line = line.trim();
        let argument = |command: &str| line.strip_prefix(command).map(str::trim);
        match line {
            "power on" => done(self.robot.power.power_on(), "Powering on", line),
            "power off" => {
                self.end_program();
                self.robot.power_off();
                "Powering off".to_owned()
            }
            "brake release" => done(self.robot.power.release_brakes(), "Brake releasing", line),
            "unlock protective stop" => {
                if self.robot.power.unlock() {
                    "Protective stop releasing".to_owned()
                } else {
                    "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop \
                     before unlocking"
                        .to_owned()
                }
            }
            "close safety popup" => "closing safety popup".to_owned(),
            "close popup" => {
                self.robot.popup_open = false;
                "closing popup".to_owned()
            }
            "restart safety" => {
                self.end_program();
                self.robot.power_off();
                self.robot.power.safety = SafetyMode::Normal;
                "Restarting safety".to_owned()
            }
            "robotmode" => format!("Robotmode: {}", self.robot_mode()),
            "safetymode" => format!("Safetymode: {}", self.safety_mode()),
            "safetystatus" => format!("Safetystatus: {}", self.safety_mode()),
            "running" => format!(
                "Program running: {}",
                self.runtime_state() == RuntimeState::Playing
            ),
            "programState" => match self.runtime_state() {
                RuntimeState::Stopped => "STOPPED <unnamed>".to_owned(),
                state => format!("{state} {}", self.program_name().unwrap_or("<unnamed>")),
            },
            "stop" => {
                self.end_program();
                "Stopped".to_owned()
            }
            "pause" => {
                let playing = self.runtime_state() == RuntimeState::Playing;
                self.set_paused(true);
                done(playing, "Pausing program", line)
            }
            "play" => {
                let paused = self.runtime_state() == RuntimeState::Paused;
                self.set_paused(false);
                done(paused, "Starting program", line)
            }
            "get loaded program" => "No program loaded".to_owned(),
            "isProgramSaved" => "true <unnamed>".to_owned(),
            "PolyscopeVersion" => {
                format!("URSoftware {} (Jan 01 2024)", self.robot.config.version)
            }
            "get serial number" => self.robot.config.serial_number.clone(),
            "get robot model" => "UR5".to_owned(),
            "getUserRole" => "NONE".to_owned(),
            _ => {
                if let Some(program) = argument("load installation ") {
                    format!("Failed to load installation: {program}")
                } else if let Some(program) = argument("load ") {
                    // Programs come over the script interfaces; this controller has no disk.
                    format!("File not found: {program}")
                } else if argument("popup ").is_some() {
                    "showing popup".to_owned()
                } else if argument("addToLog ").is_some() {
                    "Added log message".to_owned()
                } else if let Some(role) = argument("setUserRole ") {
                    format!("Setting user role: {role}")
                } else {
                    format!("could not understand: '{line}'")
                }
            }
        }
    }
}

fn done(accepted: bool, answer: &str, command: &str) -> String {
    if accepted {
        answer.to_owned()
    } else {
        format!("Failed to execute: {command}")
    }
}
