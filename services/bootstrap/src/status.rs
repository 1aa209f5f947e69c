//! The few statuses of the house, each with the details that `grpcurl` prints decoded.
//!
//! A refused input is INVALID_ARGUMENT with a `google.rpc.BadRequest` that names field, value and
//! limit. A refusal by the state of a device or case is FAILED_PRECONDITION with a
//! `google.rpc.ErrorInfo` whose reason is a stable SCREAMING_SNAKE word.

use std::collections::HashMap;

use tonic::{Code, Status};
use tonic_types::{ErrorDetails, FieldViolation, StatusExt};

/// The `domain` of every `ErrorInfo`.
pub const DOMAIN: &str = "arthro";

/// INVALID_ARGUMENT with one field violation.
pub fn invalid(field: impl Into<String>, description: impl Into<String>) -> Status {
    invalid_all(vec![(field.into(), description.into())])
}

/// INVALID_ARGUMENT with all field violations, as (field, description).
pub fn invalid_all(violations: Vec<(String, String)>) -> Status {
    let message = violations
        .iter()
        .map(|(field, description)| format!("{field}: {description}"))
        .collect::<Vec<_>>()
        .join("; ");
    let violations: Vec<FieldViolation> = violations
        .into_iter()
        .map(|(field, description)| FieldViolation::new(field, description))
        .collect();
    Status::with_error_details(
        Code::InvalidArgument,
        message,
        ErrorDetails::with_bad_request(violations),
    )
}

/// FAILED_PRECONDITION: the state of a device or case forbids it.
pub fn refused(reason: &str, message: impl Into<String>, metadata: &[(&str, String)]) -> Status {
    with_reason(Code::FailedPrecondition, reason, message, metadata)
}

/// UNAVAILABLE: a device or service cannot be reached; trying again may help.
pub fn unavailable(
    reason: &str,
    message: impl Into<String>,
    metadata: &[(&str, String)],
) -> Status {
    with_reason(Code::Unavailable, reason, message, metadata)
}

/// RESOURCE_EXHAUSTED: a limit of the server was reached.
pub fn exhausted(reason: &str, message: impl Into<String>, metadata: &[(&str, String)]) -> Status {
    with_reason(Code::ResourceExhausted, reason, message, metadata)
}

/// ABORTED: what was under way ended otherwise.
pub fn aborted(reason: &str, message: impl Into<String>, metadata: &[(&str, String)]) -> Status {
    with_reason(Code::Aborted, reason, message, metadata)
}

/// NOT_FOUND: the thing named does not exist.
pub fn not_found(reason: &str, message: impl Into<String>, metadata: &[(&str, String)]) -> Status {
    with_reason(Code::NotFound, reason, message, metadata)
}

/// A status of any code with an `ErrorInfo`.
pub fn with_reason(
    code: Code,
    reason: &str,
    message: impl Into<String>,
    metadata: &[(&str, String)],
) -> Status {
    let metadata: HashMap<String, String> = metadata
        .iter()
        .map(|(key, value)| ((*key).to_owned(), value.clone()))
        .collect();
    Status::with_error_details(
        code,
        message,
        ErrorDetails::with_error_info(reason, DOMAIN, metadata),
    )
}

/// The reason word of a status, if it carries one.
pub fn reason(status: &Status) -> Option<String> {
    status.get_details_error_info().map(|info| info.reason)
}

/// The field violations of a status as (field, description).
pub fn violations(status: &Status) -> Vec<(String, String)> {
    status
        .get_details_bad_request()
        .map(|details| {
            details
                .field_violations
                .into_iter()
                .map(|violation| (violation.field, violation.description))
                .collect()
        })
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_violation_survives_the_wire_form() {
        let status = invalid("jaw.width_mm", "is 0 mm; must be within 0.5 .. 10 mm");
        assert_eq!(status.code(), Code::InvalidArgument);
        assert_eq!(
            violations(&status),
            [(
                "jaw.width_mm".to_owned(),
                "is 0 mm; must be within 0.5 .. 10 mm".to_owned()
            )]
        );
    }

    #[test]
    fn a_reason_survives_the_wire_form() {
        let status = refused(
            "TOOL_INSIDE",
            "the tip is inside",
            &[("depth_mm", "12".into())],
        );
        assert_eq!(reason(&status).as_deref(), Some("TOOL_INSIDE"));
    }
}
