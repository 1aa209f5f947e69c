//! Why a registration, a deprojection or a calibration does not answer, and what the caller is told.

use std::fmt;

use arthro_bootstrap::status;
use tonic::Status;

use crate::calibration::gate::Refusal;

/// The domain's errors.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input cannot be worked with; every violation found.
    #[error("{}", Listed(.0))]
    Invalid(Vec<Violation>),
    /// No pose can be formed from these clouds.
    #[error("no pose of the model fits any part of the view")]
    NothingFound,
    /// A calibration that did not pass its gates; every gate missed, at least one.
    #[error("{}", Joined(.0))]
    Refused(Vec<Refusal>),
    /// The owner asked to stop.
    #[error("the computation was cancelled")]
    Cancelled,
}

/// One thing that is wrong with the input: which field, and its value against the limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The field, as the API names it.
    pub field: String,
    /// Value and limit.
    pub description: String,
}

impl Violation {
    /// `field` is wrong as `description` says.
    pub fn new(field: impl Into<String>, description: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            description: description.into(),
        }
    }
}

/// Most violations that one answer tells: a status travels in headers, of which a client takes 16 KiB.
const MAX_TOLD: usize = 24;

impl From<Error> for Status {
    fn from(error: Error) -> Self {
        match error {
            Error::Invalid(violations) => {
                let untold = violations.len().saturating_sub(MAX_TOLD);
                let mut told: Vec<(String, String)> = violations
                    .into_iter()
                    .take(MAX_TOLD)
                    .map(|violation| (violation.field, violation.description))
                    .collect();
                if untold > 0 {
                    told.push((
                        "request".to_owned(),
                        format!("violates {untold} more limits"),
                    ));
                }
                status::invalid_all(told)
            }
            error @ Error::NothingFound => status::refused("NOTHING_FOUND", error.to_string(), &[]),
            Error::Refused(refusals) => refused(&refusals),
            Error::Cancelled => Status::cancelled("the computation was cancelled"),
        }
    }
}

/// The first gate's word as the reason; all of them in the message and in `reasons`.
fn refused(refusals: &[Refusal]) -> Status {
    let words: Vec<&str> = refusals
        .iter()
        .map(|refusal| refusal.reason.as_str())
        .collect();
    let mut metadata = vec![("reasons", words.join(","))];
    if let Some(first) = refusals.first() {
        metadata.push(("value", first.value.to_string()));
        metadata.push(("limit", first.limit.to_string()));
    }
    status::refused(
        words.first().copied().unwrap_or_default(),
        Joined(refusals).to_string(),
        &metadata,
    )
}

struct Joined<'a>(&'a [Refusal]);

impl fmt::Display for Joined<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let said: Vec<String> = self.0.iter().map(Refusal::to_string).collect();
        formatter.write_str(&said.join("; "))
    }
}

struct Listed<'a>(&'a [Violation]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, violation) in self.0.iter().enumerate() {
            let separator = if index == 0 { "" } else { "; " };
            write!(
                formatter,
                "{separator}{}: {}",
                violation.field, violation.description
            )?;
        }
        Ok(())
    }
}
