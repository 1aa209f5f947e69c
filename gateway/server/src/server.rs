//! gRPC in and out: the services of the gateway and what they share.

mod audit;
mod calibration;
mod case;
mod paging;
pub(crate) mod procedure;
mod recording;
mod standby;

use std::pin::Pin;

use arthro_bootstrap::Caller;
use arthro_proto::gateway::v1::audit_service_server::AuditServiceServer;
use arthro_proto::gateway::v1::calibration_service_server::CalibrationServiceServer;
use arthro_proto::gateway::v1::case_service_server::CaseServiceServer;
use arthro_proto::gateway::v1::recording_service_server::RecordingServiceServer;
use tokio_stream::Stream;
use tonic::service::Routes;
use tonic::{Code, Status};
use tower::Layer as _;

use crate::audit::{Audit, AuditLayer};
use crate::cases::Cases;
use crate::clients::Clients;
use crate::config::{ErrorBudget, Jaw};
use crate::error::{Error, Result, Violation};
use crate::procedure::control::Procedures;
use crate::recording::Recorder;

/// A stream of answers.
type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// The services, each behind the audit, and those that command behind the gateway's duty.
pub fn routes(
    cases: Cases,
    procedures: Procedures,
    clients: Clients,
    jaw: Jaw,
    error_budget: ErrorBudget,
    recorder: Option<Recorder>,
    audit: Audit,
) -> Routes {
    let audited = AuditLayer::new(audit.clone());
    let on_duty = standby::OnDuty(procedures.duty());
    let calibrations = CalibrationServiceServer::new(calibration::CalibrationApi::new(
        cases.calibrations().clone(),
        clients.motion.clone(),
    ));
    let cases = CaseServiceServer::new(case::CaseApi::new(cases, clients, jaw, error_budget));
    let procedures = procedure::watch::Watched::new(procedures);
    let recordings = RecordingServiceServer::new(recording::RecordingApi::new(recorder));
    Routes::new(audited.layer(on_duty.layer(cases)))
        .add_service(audited.layer(on_duty.layer(calibrations)))
        .add_service(audited.layer(on_duty.layer(procedures)))
        .add_service(audited.layer(recordings))
        .add_service(audited.layer(AuditServiceServer::new(audit::AuditApi::new(audit))))
}

/// Who acts: the person whom a field of the request names, who must be the one of the certificate where there is one.
fn person(caller: &Caller, field: &str, stated: String) -> Result<String, Violation> {
    let acting = caller
        .acting(stated)
        .map_err(|other| Violation::new(field, other.to_string()))?;
    text(field, acting, 100)
}

/// A text for people: not blank, no control characters, at most `longest` characters.
fn text(field: &str, value: String, longest: usize) -> Result<String, Violation> {
    let length = value.chars().count();
    if value.trim().is_empty() {
        return Err(Violation::new(
            field,
            format!("is empty; must have 1 to {longest} characters"),
        ));
    }
    if length > longest {
        return Err(Violation::new(
            field,
            format!("has {length} characters; must have 1 to {longest}"),
        ));
    }
    if value.chars().any(char::is_control) {
        return Err(Violation::new(field, "holds control characters"));
    }
    Ok(value)
}

/// An id that names something.
fn id(field: &str, value: String) -> Result<String, Violation> {
    text(field, value, 100)
}

/// Gathers all violations of a request.
#[derive(Default)]
struct Violations(Vec<Violation>);

impl Violations {
    /// Keeps the violation, if there is one.
    fn check<T>(&mut self, checked: Result<T, Violation>) -> Option<T> {
        checked.map_err(|violation| self.0.push(violation)).ok()
    }

    /// Fails if there was any.
    fn finish(self) -> Result<()> {
        if self.0.is_empty() {
            return Ok(());
        }
        Err(Error::Invalid(self.0))
    }
}

impl From<Violation> for Error {
    fn from(violation: Violation) -> Self {
        Self::Invalid(vec![violation])
    }
}

/// Logs what the gateway itself failed at, and makes it a status.
fn refuse(error: impl Into<Error>) -> Status {
    let status = Status::from(error.into());
    if matches!(status.code(), Code::Internal | Code::Unavailable) {
        tracing::error!(code = ?status.code(), message = status.message(), "call failed");
    }
    status
}
