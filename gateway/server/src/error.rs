//! Everything the gateway refuses or fails with, and the one table that maps it to a status.

use arthro_bootstrap::status;
use tonic::{Code, Status};

use crate::approval::Digest;
use crate::audit::AuditFailed;
use crate::audit::layer::AUDIT_FAILED;
use crate::calendar::utc;
use crate::calibrations::record::Unusable;
use crate::clients::Failure;
use crate::clients::motion::Arm;
use crate::journal::JournalError;
use crate::procedure::State;
use crate::procedure::poses::PoseError;

/// The gateway's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// One field of a request that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The field's path in the request.
    pub field: String,
    /// Value and limit.
    pub description: String,
}

impl Violation {
    /// States which field, and its value and limit.
    pub fn new(field: impl Into<String>, description: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            description: description.into(),
        }
    }
}

/// What the gateway refuses or fails with.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The request itself cannot be used.
    #[error("{}", describe(.0))]
    Invalid(Vec<Violation>),
    /// No such case.
    #[error("no case has the id {0:?}")]
    UnknownCase(String),
    /// No such procedure.
    #[error("no procedure has the id {0:?}")]
    UnknownProcedure(String),
    /// As many uploads as the gateway takes are under way.
    #[error("{limit} uploads are under way, which is the limit; try again")]
    TooManyUploads {
        /// Uploads at the same time.
        limit: usize,
    },
    /// An upload came to a halt, or would never end.
    #[error(
        "the upload is too slow: nothing came for {silence_s} s, or it lasted {whole_s} s; nothing was kept"
    )]
    UploadTooSlow {
        /// Longest time between two messages.
        silence_s: u64,
        /// Longest time of all.
        whole_s: u64,
    },
    /// Model or scene is missing.
    #[error("the case has no {missing} yet")]
    CaseIncomplete {
        /// What is missing.
        missing: &'static str,
    },
    /// The case was changed while the result was computed.
    #[error("the case was changed meanwhile; the result was not kept")]
    CaseChanged,
    /// There is no registration.
    #[error("the case is not registered")]
    NotRegistered,
    /// The registration's verdict is REJECT.
    #[error("the registration's verdict is REJECT: {}", reasons.join(", "))]
    RegistrationRejected {
        /// Why, in the registration service's words.
        reasons: Vec<String>,
    },
    /// The registration's verdict is REVIEW, and no surgeon accepts it.
    #[error("the registration's verdict is REVIEW, which a surgeon has to accept: {}", reasons.join(", "))]
    SurgeonNeeded {
        /// Why, in the registration service's words.
        reasons: Vec<String>,
    },
    /// Landmarks were found farther off than the limit.
    #[error(
        "the touched landmarks are {rms_mm:.2} mm off, root mean square; must be at most {limit_mm} mm"
    )]
    VerificationFailed {
        /// Measured.
        rms_mm: f64,
        /// Allowed.
        limit_mm: f64,
    },
    /// A verification is required and did not pass.
    #[error("the registration is not verified: {}", missing.join("; "))]
    NotVerified {
        /// What is missing, with value and limit.
        missing: Vec<String>,
    },
    /// No landmark of this name was touched.
    #[error("no landmark {0:?} was touched for the registration in force")]
    UnknownLandmark(String),
    /// The arm moved while its tip was being read.
    #[error("the forceps arm moved {moved_mm:.2} mm while its tip was read; it must stand still")]
    ArmMoving {
        /// Between two readings, mm.
        moved_mm: f64,
    },
    /// The arm's controller is away, so that nothing of it is measured now.
    #[error("the forceps arm is not connected; its tip cannot be read")]
    ArmNotConnected,
    /// No such calibration.
    #[error("no calibration has the id {0:?}")]
    UnknownCalibration(String),
    /// A calibration is expired or revoked.
    #[error(transparent)]
    CalibrationExpired(#[from] Unusable),
    /// The motion service moves another tip than the calibrated one.
    #[error(
        "the motion service's tip is {apart_mm:.2} mm from the calibrated one; must be within {limit_mm} mm"
    )]
    ToolNotInUse {
        /// Between the tips, mm.
        apart_mm: f64,
        /// Allowed, mm.
        limit_mm: f64,
    },
    /// Nobody accepted the registration.
    #[error("the registration was not accepted by a person")]
    NotAccepted,
    /// There is no plan.
    #[error("the case has no plan")]
    NotPlanned,
    /// The configuration holds no calibration.
    #[error("the cell is not calibrated: section gateway.calibration is missing")]
    NotCalibrated,
    /// The plan in force is not the one that was seen.
    #[error("the plan in force has the digest {current}, not {seen}")]
    DigestMismatch {
        /// What the surgeon saw.
        seen: Digest,
        /// What is in force.
        current: Digest,
    },
    /// Nobody approved the plan.
    #[error("the plan {digest} is not approved")]
    NotApproved {
        /// The plan in force.
        digest: Digest,
    },
    /// Another person must approve too.
    #[error(
        "the plan {digest} is approved by {approved_by} alone; another person must put their name to it"
    )]
    SecondApprovalNeeded {
        /// The plan in force.
        digest: Digest,
        /// Who approved it.
        approved_by: String,
    },
    /// The second person is the first one.
    #[error("{name} approved this plan already; the second person must be another one")]
    SamePerson {
        /// Who.
        name: String,
    },
    /// One person is enough.
    #[error("no second person is needed: gateway.approval.persons is 1")]
    NoSecondApproval,
    /// Whoever signs has not the role for it.
    #[error("{name} has the role {role}; a surgeon is needed")]
    SurgeonMustSign {
        /// Who.
        name: String,
        /// The role held.
        role: String,
    },
    /// The plan, registration, calibration or model changed since the approval.
    #[error("the approval of {approved} is void: {current} is in force")]
    ApprovalVoid {
        /// What shall be executed.
        approved: Digest,
        /// What is in force; "none" when there is none.
        current: String,
    },
    /// One procedure at a time.
    #[error("procedure {procedure_id} is {state}")]
    ProcedureActive {
        /// The one that is active.
        procedure_id: String,
        /// Where it stands.
        state: State,
    },
    /// The request does not fit the procedure's state.
    #[error("procedure {procedure_id} is {state}; it must be {needed}")]
    WrongState {
        /// Which one.
        procedure_id: String,
        /// Where it stands.
        state: State,
        /// Where it would have to stand.
        needed: String,
    },
    /// Arms are let move by a person who has looked, or not at all.
    #[error("arms move only after somebody has looked at the cell: set acknowledge")]
    AcknowledgementNeeded,
    /// An arm is not where it stood when the procedure was halted.
    #[error(
        "the {arm} is {moved_mm:.2} mm and {moved_deg:.2} deg from where it stood; limits {limit_mm} mm and {limit_deg} deg"
    )]
    PoseMoved {
        /// Which arm.
        arm: Arm,
        /// Of its tip.
        moved_mm: f64,
        /// Of its tool.
        moved_deg: f64,
        /// The configuration's.
        limit_mm: f64,
        /// The configuration's.
        limit_deg: f64,
    },
    /// Nobody saw where the arms stand.
    #[error("where the arms stood when the procedure was halted is not recorded yet: {problem}")]
    PoseUnknown {
        /// Why not.
        problem: String,
    },
    /// A fault waits for an acknowledgement that was not given.
    #[error("faults are latched: {}; set recover_faults once their causes are gone", faults.join("; "))]
    FaultsLatched {
        /// Each with its device.
        faults: Vec<String>,
    },
    /// There is no bite to hold as done.
    #[error("procedure {procedure_id} was not interrupted in a bite; choose another action")]
    NoBiteInterrupted {
        /// Which one.
        procedure_id: String,
    },
    /// A bite cannot be reached through the portal.
    #[error("bite {bite} of the plan cannot be reached: {detail}")]
    UnreachableBite {
        /// Index in the plan, from 0.
        bite: usize,
        /// The motion service's word.
        check: String,
        /// With value and limit.
        detail: String,
    },
    /// The arthroscope cannot reach its view.
    #[error("the arthroscope cannot reach its view of bite {bite}: {detail}")]
    UnreachableView {
        /// Which bite, from 0.
        bite: usize,
        /// The motion service's word.
        check: String,
        /// With value and limit.
        detail: String,
    },
    /// The plan cannot be carried into the cell.
    #[error("the plan cannot be executed")]
    Poses(#[from] PoseError),
    /// A service that the gateway calls refused, failed or is away.
    #[error(transparent)]
    Downstream(#[from] Failure),
    /// The audit cannot be written: nothing is done that would not be recorded.
    #[error(transparent)]
    Audit(#[from] AuditFailed),
    /// An entry of the audit cannot be read.
    #[error("entry {sequence} of the audit is damaged: {problem}")]
    AuditDamaged {
        /// Which one.
        sequence: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The journal cannot be read or written.
    #[error("the journal failed")]
    Journal(#[from] JournalError),
}

impl Error {
    /// A single violation.
    pub fn invalid(field: impl Into<String>, description: impl Into<String>) -> Self {
        Self::Invalid(vec![Violation::new(field, description)])
    }

    /// A list cannot go on after `token`.
    pub fn page_token(token: &str) -> Self {
        let description =
            format!("is \"{token}\"; must be the next_page_token of an answer, or empty");
        Self::invalid("page_token", description)
    }

    /// The stable word of a refusal.
    pub fn reason(&self) -> &str {
        match self {
            Self::Invalid(_) => "INVALID_ARGUMENT",
            Self::UnknownCase(_) => "UNKNOWN_CASE",
            Self::UnknownProcedure(_) => "UNKNOWN_PROCEDURE",
            Self::TooManyUploads { .. } => "TOO_MANY_UPLOADS",
            Self::UploadTooSlow { .. } => "UPLOAD_TOO_SLOW",
            Self::CaseIncomplete { .. } => "CASE_INCOMPLETE",
            Self::CaseChanged => "CASE_CHANGED",
            Self::NotRegistered => "NOT_REGISTERED",
            Self::RegistrationRejected { .. } => "REGISTRATION_REJECTED",
            Self::NotAccepted => "REGISTRATION_NOT_ACCEPTED",
            Self::SurgeonNeeded { .. } => "SURGEON_NEEDED",
            Self::VerificationFailed { .. } => "VERIFICATION_FAILED",
            Self::NotVerified { .. } => "NOT_VERIFIED",
            Self::UnknownLandmark(_) => "UNKNOWN_LANDMARK",
            Self::ArmMoving { .. } => "ARM_MOVING",
            Self::ArmNotConnected => "NOT_CONNECTED",
            Self::UnknownCalibration(_) => "UNKNOWN_CALIBRATION",
            Self::CalibrationExpired(_) => "CALIBRATION_EXPIRED",
            Self::ToolNotInUse { .. } => "TOOL_NOT_IN_USE",
            Self::NotPlanned => "NOT_PLANNED",
            Self::NotCalibrated => "NOT_CALIBRATED",
            Self::DigestMismatch { .. } => "DIGEST_MISMATCH",
            Self::NotApproved { .. } => "NOT_APPROVED",
            Self::SecondApprovalNeeded { .. } => "SECOND_APPROVAL_NEEDED",
            Self::SamePerson { .. } => "SAME_PERSON",
            Self::NoSecondApproval => "NO_SECOND_APPROVAL",
            Self::SurgeonMustSign { .. } => "SURGEON_NEEDED",
            Self::ApprovalVoid { .. } => "APPROVAL_VOID",
            Self::ProcedureActive { .. } => "PROCEDURE_ACTIVE",
            Self::WrongState { .. } => "PROCEDURE_STATE",
            Self::NoBiteInterrupted { .. } => "NO_BITE_INTERRUPTED",
            Self::AcknowledgementNeeded => "ACKNOWLEDGEMENT_NEEDED",
            Self::PoseMoved { .. } => "POSE_MOVED",
            Self::PoseUnknown { .. } => "POSE_UNKNOWN",
            Self::FaultsLatched { .. } => "FAULT_LATCHED",
            Self::UnreachableBite { .. } => "UNREACHABLE_BITE",
            Self::UnreachableView { .. } => "UNREACHABLE_VIEW",
            Self::Poses(_) => "PLAN_NOT_EXECUTABLE",
            Self::Downstream(failure) => failure.reason(),
            Self::Audit(_) => AUDIT_FAILED,
            Self::AuditDamaged { .. } => "AUDIT_DAMAGED",
            Self::Journal(JournalError::NotInCommand { .. }) => "NOT_IN_COMMAND",
            Self::Journal(JournalError::Fenced { .. }) => "FENCED",
            Self::Journal(_) => "JOURNAL_FAILED",
        }
    }

    /// What the reason's metadata says beside the message.
    fn metadata(&self) -> Vec<(&'static str, String)> {
        match self {
            Self::UnknownCase(id) => vec![("case_id", id.clone())],
            Self::UnknownProcedure(id) => vec![("procedure_id", id.clone())],
            Self::TooManyUploads { limit } => vec![("limit", limit.to_string())],
            Self::UploadTooSlow { silence_s, whole_s } => vec![
                ("silence_s", silence_s.to_string()),
                ("whole_s", whole_s.to_string()),
            ],
            Self::CaseIncomplete { missing } => vec![("missing", (*missing).to_owned())],
            Self::RegistrationRejected { reasons } | Self::SurgeonNeeded { reasons } => {
                vec![("reasons", reasons.join(","))]
            }
            Self::VerificationFailed { rms_mm, limit_mm } => vec![
                ("tre_rms_mm", format!("{rms_mm:.3}")),
                ("limit_mm", limit_mm.to_string()),
            ],
            Self::NotVerified { missing } => vec![("missing", missing.join("; "))],
            Self::UnknownLandmark(landmark) => vec![("landmark", landmark.clone())],
            Self::ArmMoving { moved_mm } => vec![("moved_mm", format!("{moved_mm:.3}"))],
            Self::UnknownCalibration(id) => vec![("calibration_id", id.clone())],
            Self::CalibrationExpired(unusable) => vec![
                ("kind", unusable.kind.to_string()),
                ("calibration_id", unusable.id.clone()),
                ("how", unusable.how.to_string()),
                ("since", utc(unusable.since_ms)),
            ],
            Self::ToolNotInUse { apart_mm, limit_mm } => vec![
                ("apart_mm", format!("{apart_mm:.3}")),
                ("limit_mm", limit_mm.to_string()),
            ],
            Self::DigestMismatch { seen, current } => {
                vec![("seen", seen.to_string()), ("current", current.to_string())]
            }
            Self::NotApproved { digest } => vec![("plan_digest", digest.to_string())],
            Self::SecondApprovalNeeded {
                digest,
                approved_by,
            } => vec![
                ("plan_digest", digest.to_string()),
                ("approved_by", approved_by.clone()),
            ],
            Self::SamePerson { name } => vec![("name", name.clone())],
            Self::SurgeonMustSign { name, role } => {
                vec![("name", name.clone()), ("role", role.clone())]
            }
            Self::ApprovalVoid { approved, current } => vec![
                ("approved", approved.to_string()),
                ("current", current.clone()),
            ],
            Self::ProcedureActive {
                procedure_id,
                state,
            } => vec![
                ("procedure_id", procedure_id.clone()),
                ("state", state.to_string()),
            ],
            Self::WrongState {
                procedure_id,
                state,
                needed,
            } => vec![
                ("procedure_id", procedure_id.clone()),
                ("state", state.to_string()),
                ("needed", needed.clone()),
            ],
            Self::PoseMoved {
                arm,
                moved_mm,
                moved_deg,
                limit_mm,
                limit_deg,
            } => vec![
                ("arm", arm.to_string()),
                ("moved_mm", moved_mm.to_string()),
                ("moved_deg", moved_deg.to_string()),
                ("limit_mm", limit_mm.to_string()),
                ("limit_deg", limit_deg.to_string()),
            ],
            Self::FaultsLatched { faults } => vec![("faults", faults.join("; "))],
            Self::NoBiteInterrupted { procedure_id } => {
                vec![("procedure_id", procedure_id.clone())]
            }
            Self::Journal(
                JournalError::NotInCommand { holder } | JournalError::Fenced { holder, .. },
            ) => vec![("in_command", holder.clone())],
            Self::UnreachableBite {
                bite,
                check,
                detail,
            } => vec![
                ("bite", bite.to_string()),
                ("check", check.clone()),
                ("detail", detail.clone()),
            ],
            Self::UnreachableView {
                bite,
                check,
                detail,
            } => vec![
                ("bite", bite.to_string()),
                ("check", check.clone()),
                ("detail", detail.clone()),
            ],
            Self::AuditDamaged { sequence, .. } => vec![("sequence", sequence.to_string())],
            _ => Vec::new(),
        }
    }
}

/// The table: which error is which status.
impl From<Error> for Status {
    fn from(error: Error) -> Self {
        let message = chain(&error);
        let metadata = error.metadata();
        match error {
            Error::Invalid(violations) => status::invalid_all(
                violations
                    .into_iter()
                    .map(|violation| (violation.field, violation.description))
                    .collect(),
            ),
            Error::UnknownCase(_)
            | Error::UnknownProcedure(_)
            | Error::UnknownLandmark(_)
            | Error::UnknownCalibration(_) => status::not_found(error.reason(), message, &metadata),
            Error::TooManyUploads { .. } => status::exhausted(error.reason(), message, &metadata),
            Error::CaseChanged | Error::UploadTooSlow { .. } => {
                status::aborted(error.reason(), message, &metadata)
            }
            Error::SurgeonMustSign { .. } => {
                status::with_reason(Code::PermissionDenied, error.reason(), message, &metadata)
            }
            Error::Journal(JournalError::NotInCommand { .. } | JournalError::Fenced { .. }) => {
                status::refused(error.reason(), message, &metadata)
            }
            Error::Journal(_) | Error::Audit(_) => {
                status::unavailable(error.reason(), message, &metadata)
            }
            Error::Downstream(failure) => failure.into_status(),
            _ => status::refused(error.reason(), message, &metadata),
        }
    }
}

/// The error and its causes in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text = format!("{text}: {cause}");
        source = cause.source();
    }
    text
}

fn describe(violations: &[Violation]) -> String {
    violations
        .iter()
        .map(|violation| format!("{}: {}", violation.field, violation.description))
        .collect::<Vec<_>>()
        .join("; ")
}
