//! Every command of the dashboard as a method: what it answers when accepted, and anything else as a refusal.

use std::str::FromStr;

use super::{Dashboard, OperationalMode, Player, UserRole};
use crate::{Error, RobotMode, SafetyMode};

/// Programs.
impl Dashboard {
    /// Loads a program from the controller's disk, such as "test.urp".
    ///
    /// # Errors
    /// Refused (no such file), or connection failures.
    pub async fn load(&mut self, program: &str) -> Result<(), Error> {
        self.expect(&format!("load {program}"), "Loading program: ")
            .await
    }

    /// Loads an installation from the controller's disk.
    ///
    /// # Errors
    /// Refused (no such file), or connection failures.
    pub async fn load_installation(&mut self, installation: &str) -> Result<(), Error> {
        self.expect(
            &format!("load installation {installation}"),
            "Loading installation: ",
        )
        .await
    }

    /// Starts the loaded program, or lets a paused one go on: **the arm may move**.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn play(&mut self) -> Result<(), Error> {
        self.expect("play", "Starting program").await
    }

    /// Pauses the running program.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn pause(&mut self) -> Result<(), Error> {
        self.expect("pause", "Pausing program").await
    }

    /// Stops the running program.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn stop(&mut self) -> Result<(), Error> {
        self.expect("stop", "Stopped").await
    }

    /// A program runs.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn running(&mut self) -> Result<bool, Error> {
        let command = "running";
        let answer = self.ask(command).await?;
        // Software before 3.0 says robot.
        match answer
            .strip_prefix("Program running: ")
            .or(answer.strip_prefix("Robot running: "))
            .and_then(truth)
        {
            Some(running) => Ok(running),
            None => Err(refused(command, answer)),
        }
    }

    /// What the program does, and its name.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn program_state(&mut self) -> Result<(Player, String), Error> {
        let command = "programState";
        let answer = self.ask(command).await?;
        let (word, name) = answer.split_once(' ').unwrap_or((&answer, ""));
        match word.parse() {
            Ok(player) => Ok((player, name.to_owned())),
            Err(()) => Err(refused(command, answer)),
        }
    }

    /// Path of the loaded program; `None` when there is none.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn loaded_program(&mut self) -> Result<Option<String>, Error> {
        let command = "get loaded program";
        let answer = self.ask(command).await?;
        match answer.strip_prefix("Loaded program: ") {
            Some(path) => Ok(Some(path.to_owned())),
            None if answer == "No program loaded" => Ok(None),
            None => Err(refused(command, answer)),
        }
    }

    /// The loaded program has no unsaved changes, and its name.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn is_program_saved(&mut self) -> Result<(bool, String), Error> {
        let command = "isProgramSaved";
        let answer = self.ask(command).await?;
        let (word, name) = answer.split_once(' ').unwrap_or((&answer, ""));
        match truth(word) {
            Some(saved) => Ok((saved, name.to_owned())),
            None => Err(refused(command, answer)),
        }
    }
}

/// The pendant and the log.
impl Dashboard {
    /// Shows a text on the pendant.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn popup(&mut self, text: &str) -> Result<(), Error> {
        self.expect(&format!("popup {text}"), "showing popup").await
    }

    /// Closes the popup.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn close_popup(&mut self) -> Result<(), Error> {
        self.expect("close popup", "closing popup").await
    }

    /// Adds a line to the controller's log.
    ///
    /// # Errors
    /// Refused (no text), or connection failures.
    pub async fn add_to_log(&mut self, text: &str) -> Result<(), Error> {
        self.expect(&format!("addToLog {text}"), "Added log message")
            .await
    }
}

/// Power, brakes and safety.
impl Dashboard {
    /// Powers the arm: to `IDLE`, brakes on.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn power_on(&mut self) -> Result<(), Error> {
        self.expect("power on", "Powering on").await
    }

    /// Takes the power off the arm.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn power_off(&mut self) -> Result<(), Error> {
        self.expect("power off", "Powering off").await
    }

    /// Releases the brakes: to `RUNNING`.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn brake_release(&mut self) -> Result<(), Error> {
        self.expect("brake release", "Brake releasing").await
    }

    /// Unlocks a protective stop, which the controller allows 5 s after it happened. The cause must have been inspected.
    /// No program goes on by itself.
    ///
    /// # Errors
    /// [`Error::UnlockTooEarly`] within those 5 s; refused for another reason, or connection failures.
    pub async fn unlock_protective_stop(&mut self) -> Result<(), Error> {
        let unlocked = self
            .expect("unlock protective stop", "Protective stop releasing")
            .await;
        match unlocked {
            Err(Error::Refused { answer, .. }) if answer.contains("until 5s after") => {
                Err(Error::UnlockTooEarly { answer })
            }
            other => other,
        }
    }

    /// Closes the popup of a safety event.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn close_safety_popup(&mut self) -> Result<(), Error> {
        self.expect("close safety popup", "closing safety popup")
            .await
    }

    /// Restarts the safety system after a fault or violation: the arm loses power. Since 3.7 and 5.1.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn restart_safety(&mut self) -> Result<(), Error> {
        self.expect("restart safety", "Restarting safety").await
    }

    /// Power and brakes.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn robot_mode(&mut self) -> Result<RobotMode, Error> {
        self.word("robotmode", "Robotmode: ").await
    }

    /// What the safety system allows.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn safety_mode(&mut self) -> Result<SafetyMode, Error> {
        self.word("safetymode", "Safetymode: ").await
    }

    /// What the safety system says, finer than [`Dashboard::safety_mode`]. Since 3.10 and 5.4.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn safety_status(&mut self) -> Result<SafetyMode, Error> {
        self.word("safetystatus", "Safetystatus: ").await
    }
}

/// What the controller is, and who commands it.
impl Dashboard {
    /// Such as "3.15.8.106339".
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn polyscope_version(&mut self) -> Result<String, Error> {
        let text = self.value("PolyscopeVersion", "URSoftware ").await?;
        Ok(text
            .split_whitespace()
            .next()
            .unwrap_or_default()
            .to_owned())
    }

    /// Such as "20195500001". Since 3.12 and 5.6.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn serial_number(&mut self) -> Result<String, Error> {
        let command = "get serial number";
        let answer = self.ask(command).await?;
        if !answer.is_empty() && answer.bytes().all(|byte| byte.is_ascii_digit()) {
            Ok(answer)
        } else {
            Err(refused(command, answer))
        }
    }

    /// Such as "UR5", which e-Series says of a UR5e too. Since 3.12 and 5.6.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn robot_model(&mut self) -> Result<String, Error> {
        let command = "get robot model";
        let answer = self.ask(command).await?;
        if answer.starts_with("UR") {
            Ok(answer)
        } else {
            Err(refused(command, answer))
        }
    }

    /// The controller takes programs and commands of others than its pendant. Since 5.6; CB3 does not know the question.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn is_in_remote_control(&mut self) -> Result<bool, Error> {
        let command = "is in remote control";
        let answer = self.ask(command).await?;
        truth(&answer).ok_or_else(|| refused(command, answer))
    }

    /// Sets who operates the pendant. CB3.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn set_user_role(&mut self, role: UserRole) -> Result<(), Error> {
        let word = role.to_string().to_ascii_lowercase();
        self.expect(&format!("setUserRole {word}"), "Setting user role: ")
            .await
    }

    /// Who operates the pendant. CB3.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn user_role(&mut self) -> Result<UserRole, Error> {
        self.word("getUserRole", "").await
    }

    /// Takes the operational mode from the pendant and sets it. Since 5.0.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn set_operational_mode(&mut self, mode: OperationalMode) -> Result<(), Error> {
        let word = mode.to_string().to_ascii_lowercase();
        self.expect(&format!("set operational mode {word}"), "Operational mode ")
            .await
    }

    /// The operational mode; `None` when the pendant has no password for it. Since 5.6.
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn operational_mode(&mut self) -> Result<Option<OperationalMode>, Error> {
        let command = "get operational mode";
        let answer = self.ask(command).await?;
        match answer.parse() {
            Ok(mode) => Ok(Some(mode)),
            Err(()) if answer.eq_ignore_ascii_case("none") => Ok(None),
            Err(()) => Err(refused(command, answer)),
        }
    }

    /// Gives the operational mode back to the pendant. Since 5.0.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn clear_operational_mode(&mut self) -> Result<(), Error> {
        self.expect(
            "clear operational mode",
            "No longer controlling the operational mode",
        )
        .await
    }

    /// Ends the connection in good order.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn quit(mut self) -> Result<(), Error> {
        self.expect("quit", "Disconnected").await
    }

    /// Switches the controller off.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn shutdown(mut self) -> Result<(), Error> {
        self.expect("shutdown", "Shutting down").await
    }

    async fn word<T: FromStr>(&mut self, command: &str, prefix: &str) -> Result<T, Error> {
        let answer = self.value(command, prefix).await?;
        answer.parse().map_err(|_| refused(command, answer))
    }
}

fn truth(word: &str) -> Option<bool> {
    match word {
        "true" | "True" => Some(true),
        "false" | "False" => Some(false),
        _ => None,
    }
}

fn refused(command: &str, answer: String) -> Error {
    Error::Refused {
        request: command.to_owned(),
        answer,
    }
}
