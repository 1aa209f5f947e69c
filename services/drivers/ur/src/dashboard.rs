//! The dashboard server (port 29999): one line in, one line out. [`Dashboard`] has a method for every command of CB3 and
//! e-Series; what an older controller does not know is [`Error::Refused`] with its answer.

mod commands;
mod words;

use std::time::Duration;

use tokio::{
    io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader},
    net::TcpStream,
    time::timeout,
};

pub use words::{OperationalMode, Player, UserRole};

use crate::Error;

const SERVICE: &str = "dashboard";
/// Longest line taken from the controller.
const MAX_LINE_BYTES: u64 = 4096;

/// A connection to the dashboard. Mode changes are asynchronous: an accepted request has begun, not ended; whether it
/// came about is seen in [`Dashboard::robot_mode`] or RTDE.
///
/// Nothing tells which answer belongs to which command but their order. So once an answer was not waited for (timeout, a
/// dropped future) the connection refuses all further commands; a new one begins anew.
pub struct Dashboard {
    stream: BufReader<TcpStream>,
    reply_timeout: Duration,
    answers: Answers,
}

/// Whether the next line is the answer to the next command.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Answers {
    InStep,
    Owed,
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
            answers: Answers::InStep,
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
        if self.answers == Answers::Owed {
            return Err(Error::Refused {
                request: command.to_owned(),
                answer: "an earlier command was not waited for; connect anew".into(),
            });
        }
        self.answers = Answers::Owed;
        let line = format!("{command}\n");
        let limit = self.reply_timeout;
        timeout(limit, self.stream.get_mut().write_all(line.as_bytes()))
            .await
            .map_err(|_| Error::Timeout {
                what: "space to send to the dashboard",
                limit,
            })?
            .map_err(io_error)?;
        let answer = self.line().await?;
        self.answers = Answers::InStep;
        Ok(answer)
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
            if bytes.len() as u64 == MAX_LINE_BYTES {
                return Err(Error::Refused {
                    request: "dashboard answer".into(),
                    answer: format!("a line of more than {MAX_LINE_BYTES} bytes"),
                });
            }
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
