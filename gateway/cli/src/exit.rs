//! How a command ends: the exit codes, and the failures behind them.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 2 | wrong command line |
//! | 3 | refused: the input or the state of a case or device forbids it |
//! | 4 | a service cannot be reached |
//! | 5 | the procedure was aborted or interrupted |
//! | 6 | the demo or the calibration of a cell missed one of its limits |
//! | 1 | anything else |

use std::error::Error;
use std::process::ExitCode;

use arthro_bootstrap::status;
use tonic::{Code, Status};

/// Why a command did not do what was asked.
#[derive(Debug)]
pub struct Failure {
    /// The kind, which decides the exit code.
    pub kind: Kind,
    /// A stable SCREAMING_SNAKE word.
    pub reason: String,
    /// For a person.
    pub message: String,
    /// Field violations, as (field, description).
    pub violations: Vec<(String, String)>,
}

/// The kinds of failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Anything without a kind of its own.
    Failed,
    /// The input or a state forbids it.
    Refused,
    /// A service cannot be reached.
    Unreachable,
    /// The procedure was aborted or interrupted.
    Interrupted,
    /// The demo or a calibration missed a limit.
    LimitMissed,
}

// === impl Failure ===

impl Failure {
    /// A failure of this kind.
    pub fn new(kind: Kind, reason: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            kind,
            reason: reason.into(),
            message: message.into(),
            violations: Vec::new(),
        }
    }

    /// A failure without a kind of its own, with the whole chain of causes.
    pub fn failed(reason: &str, error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::new(Kind::Failed, reason, chain(error.into().as_ref()))
    }

    /// Refused input.
    pub fn refused(reason: &str, message: impl Into<String>) -> Self {
        Self::new(Kind::Refused, reason, message)
    }

    /// Refused input, with the whole chain of causes.
    pub fn refused_because(reason: &str, error: &(dyn Error + 'static)) -> Self {
        Self::refused(reason, chain(error))
    }

    /// The exit code of the table above.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self.kind {
            Kind::Failed => 1,
            Kind::Refused => 3,
            Kind::Unreachable => 4,
            Kind::Interrupted => 5,
            Kind::LimitMissed => 6,
        })
    }
}

impl From<Status> for Failure {
    fn from(status: Status) -> Self {
        let kind = match status.code() {
            Code::InvalidArgument
            | Code::FailedPrecondition
            | Code::NotFound
            | Code::AlreadyExists
            | Code::OutOfRange
            | Code::ResourceExhausted
            | Code::PermissionDenied => Kind::Refused,
            Code::Unavailable => Kind::Unreachable,
            _ => Kind::Failed,
        };
        Self {
            kind,
            reason: status::reason(&status).unwrap_or_else(|| word(status.code())),
            message: match status.message() {
                "" => chain(&status),
                message => message.to_owned(),
            },
            violations: status::violations(&status),
        }
    }
}

/// The code as the protocol spells it: INVALID_ARGUMENT for `InvalidArgument`.
fn word(code: Code) -> String {
    let mut word = String::new();
    for letter in format!("{code:?}").chars() {
        if letter.is_uppercase() && !word.is_empty() {
            word.push('_');
        }
        word.push(letter.to_ascii_uppercase());
    }
    word
}

impl From<tonic::transport::Error> for Failure {
    fn from(error: tonic::transport::Error) -> Self {
        Self::new(Kind::Unreachable, "SERVICE_UNREACHABLE", chain(&error))
    }
}

impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        Self::failed("INPUT_OUTPUT", error)
    }
}

fn chain(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        text.push_str(": ");
        text.push_str(&inner.to_string());
        cause = inner.source();
    }
    text
}
