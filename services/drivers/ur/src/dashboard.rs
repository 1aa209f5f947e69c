//! The dashboard server (port 29999): one line in, one line out.

use std::time::Duration;

use tokio::{
    io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader},
    net::TcpStream,
    time::timeout,
};

use crate::Error;

const SERVICE: &str = "dashboard";
/// Longest line taken from the controller.
const MAX_LINE_BYTES: u64 = 4096;

/// A connection to the dashboard. Mode changes are asynchronous: an accepted request has begun, not ended.
pub struct Dashboard {
    stream: BufReader<TcpStream>,
    reply_timeout: Duration,
}

impl Dashboard {
    /// Connects and reads the greeting.
    ///
    /// # Errors
    /// No connection, or no greeting within `reply_timeout`.
    pub async fn connect(host: &str, port: u16, reply_timeout: Duration) -> Result<Self, Error> {
        let stream = crate::error::connect(SERVICE, host, port, reply_timeout).await?;
        let mut dashboard = Self {
            stream: BufReader::new(stream),
            reply_timeout,
        };
        let greeting = dashboard.line().await?;
        if !greeting.contains("Dashboard Server") {
            return Err(Error::Refused {
                request: "dashboard connection".into(),
                answer: greeting,
            });
        }
        Ok(dashboard)
    }

    /// Sends one command and returns the answer, whatever it is.
    ///
    /// # Errors
    /// A command of more than one line, connection failures, no answer in time.
    pub async fn ask(&mut self, command: &str) -> Result<String, Error> {
        if command.contains(['\n', '\r']) {
            return Err(Error::Refused {
                request: command.escape_debug().to_string(),
                answer: "more than one line".into(),
            });
        }
        let line = format!("{command}\n");
        self.stream
            .get_mut()
            .write_all(line.as_bytes())
            .await
            .map_err(io_error)?;
        self.line().await
    }

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
    ///
    /// # Errors
    /// Refused (too early), or connection failures.
    pub async fn unlock_protective_stop(&mut self) -> Result<(), Error> {
        self.expect("unlock protective stop", "Protective stop releasing")
            .await
    }

    /// Closes the popup of a safety event.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn close_safety_popup(&mut self) -> Result<(), Error> {
        self.expect("close safety popup", "closing safety popup")
            .await
    }

    /// Stops the running program.
    ///
    /// # Errors
    /// Refused, or connection failures.
    pub async fn stop(&mut self) -> Result<(), Error> {
        self.expect("stop", "Stopped").await
    }

    /// "RUNNING", "IDLE"...
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn robot_mode(&mut self) -> Result<String, Error> {
        self.value("robotmode", "Robotmode: ").await
    }

    /// "NORMAL", "PROTECTIVE_STOP"...
    ///
    /// # Errors
    /// Connection failures, or another answer.
    pub async fn safety_mode(&mut self) -> Result<String, Error> {
        self.value("safetymode", "Safetymode: ").await
    }

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

    async fn expect(&mut self, command: &str, accepted: &str) -> Result<(), Error> {
        self.value(command, accepted).await.map(|_| ())
    }

    async fn value(&mut self, command: &str, prefix: &str) -> Result<String, Error> {
        let answer = self.ask(command).await?;
        match answer.strip_prefix(prefix) {
            Some(value) => Ok(value.trim().to_owned()),
            None => Err(Error::Refused {
                request: command.to_owned(),
                answer,
            }),
        }
    }

    async fn line(&mut self) -> Result<String, Error> {
        let limit = self.reply_timeout;
        let mut bytes = Vec::new();
        let mut bounded = (&mut self.stream).take(MAX_LINE_BYTES);
        let read = timeout(limit, bounded.read_until(b'\n', &mut bytes));
        read.await
            .map_err(|_| Error::Timeout {
                what: "dashboard answer",
                limit,
            })?
            .map_err(io_error)?;
        if bytes.last() != Some(&b'\n') {
            return Err(Error::Closed { service: SERVICE });
        }
        Ok(String::from_utf8_lossy(&bytes).trim_end().to_owned())
    }
}

fn io_error(source: std::io::Error) -> Error {
    Error::Io {
        service: SERVICE,
        source,
    }
}
