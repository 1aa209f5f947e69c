//! Who may call what: one line for each method of each service of the house.
//!
//! The [`guard`] checks every call against it before anything else, `docs/roles.md` is made from it, and a test fails for a
//! method without a line. A method without a line is served to nobody who shows a certificate.
//!
//! Persons rank: an operator may all that a viewer may, a surgeon all that an operator may. A service is no person: it may call
//! what the gateway needs of the others, and decides nothing.

pub(crate) mod guard;
pub(crate) mod stops;

use std::collections::HashMap;
use std::sync::LazyLock;

use crate::identity::Role;
use crate::identity::Role::{Operator, Surgeon, Viewer};

use Effect::{Command, Decision, Halt, Read, Stop};
use Services::{May, MayNot};

/// What a method does to the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing changes; computing counts as reading.
    Read,
    /// A record, a setting or a device changes.
    Command,
    /// The same, on a person's judgement of a registration, a plan or the cell.
    Decision,
    /// A procedure ceases to go on as it went. It waits for no record.
    Halt,
    /// Something that moves is halted. Open to every role.
    Stop,
}

/// Whether the role service may call a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Services {
    /// It may.
    May,
    /// It may not.
    MayNot,
}

/// One line of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// `package.Service/Method`.
    pub method: &'static str,
    /// The least role of a person.
    pub least: Role,
    /// Whether another service may call it.
    pub services: Services,
    /// What it does.
    pub effect: Effect,
}

/// The table.
#[rustfmt::skip]
pub const RULES: &[Rule] = &[
    rule("arthro.gateway.v1.CaseService/CreateCase", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/ListCases", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.CaseService/GetCase", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.CaseService/UploadModel", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/UploadScene", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/RegisterCase", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/AcceptRegistration", Operator, MayNot, Decision),
    rule("arthro.gateway.v1.CaseService/PlanCase", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/RevisePlan", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/VerifyTarget", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/RemoveTouch", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CaseService/ApprovePlan", Surgeon, MayNot, Decision),
    rule("arthro.gateway.v1.CaseService/CountersignPlan", Operator, MayNot, Decision),
    rule("arthro.gateway.v1.CalibrationService/SaveCalibration", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CalibrationService/ListCalibrations", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.CalibrationService/GetCalibration", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.CalibrationService/ActivateCalibration", Operator, MayNot, Command),
    rule("arthro.gateway.v1.CalibrationService/RevokeCalibration", Operator, MayNot, Command),
    rule("arthro.gateway.v1.AuditService/ListEntries", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.AuditService/VerifyChain", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.AuditService/ExportEntries", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.AuditService/GetHead", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.RecordingService/GetRecorder", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.ProcedureService/StartProcedure", Operator, MayNot, Decision),
    rule("arthro.gateway.v1.ProcedureService/PauseProcedure", Operator, MayNot, Halt),
    rule("arthro.gateway.v1.ProcedureService/ResumeProcedure", Operator, MayNot, Decision),
    rule("arthro.gateway.v1.ProcedureService/AbortProcedure", Operator, MayNot, Halt),
    rule("arthro.gateway.v1.ProcedureService/StopProcedure", Viewer, May, Stop),
    rule("arthro.gateway.v1.ProcedureService/RecoverProcedure", Operator, MayNot, Decision),
    rule("arthro.gateway.v1.ProcedureService/GetRecovery", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.ProcedureService/GetProcedure", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.ProcedureService/WatchProcedure", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.ProcedureService/ListProcedures", Viewer, MayNot, Read),
    rule("arthro.gateway.v1.ProcedureService/GetReport", Viewer, MayNot, Read),
    rule("arthro.registration.v1.RegistrationService/Register", Operator, May, Read),
    rule("arthro.registration.v1.RegistrationService/DeprojectDepth", Operator, May, Read),
    rule("arthro.registration.v1.RegistrationService/ReconstructSurface", Operator, May, Read),
    rule("arthro.registration.v1.RegistrationService/SolveHandEye", Operator, May, Read),
    rule("arthro.registration.v1.RegistrationService/SolveToolTip", Operator, May, Read),
    rule("arthro.planning.v1.PlanningService/FitContour", Operator, May, Read),
    rule("arthro.planning.v1.PlanningService/PlanResection", Operator, May, Read),
    rule("arthro.planning.v1.PlanningService/EvaluateResection", Operator, May, Read),
    rule("arthro.planning.v1.PlanningService/CheckReachability", Operator, May, Read),
    rule("arthro.motion.v1.MotionService/GetCell", Viewer, May, Read),
    rule("arthro.motion.v1.MotionService/WatchState", Viewer, May, Read),
    rule("arthro.motion.v1.MotionService/AcquireLease", Operator, May, Command),
    rule("arthro.motion.v1.MotionService/RenewLease", Operator, May, Command),
    rule("arthro.motion.v1.MotionService/ReleaseLease", Operator, May, Command),
    rule("arthro.motion.v1.MotionService/SetPortal", Operator, May, Command),
    rule("arthro.motion.v1.MotionService/CheckMotion", Operator, May, Read),
    rule("arthro.motion.v1.MotionService/Move", Operator, May, Command),
    rule("arthro.motion.v1.MotionService/Stop", Viewer, May, Stop),
    rule("arthro.motion.v1.MotionService/RecoverFault", Operator, May, Command),
    rule("arthro.motion.v1.TeachingService/SolvePortal", Operator, May, Read),
    rule("arthro.motion.v1.TeachingService/CalibrateShaft", Operator, May, Read),
    rule("arthro.instrument.v1.InstrumentService/ListAxes", Viewer, May, Read),
    rule("arthro.instrument.v1.InstrumentService/WatchState", Viewer, May, Read),
    rule("arthro.instrument.v1.InstrumentService/AcquireLease", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/RenewLease", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/ReleaseLease", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/Home", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/MoveAxis", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/Bite", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/OpenJaw", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/Stop", Viewer, May, Stop),
    rule("arthro.instrument.v1.InstrumentService/RecoverFault", Operator, May, Command),
    rule("arthro.instrument.v1.InstrumentService/CommissionSwitches", Operator, MayNot, Command),
    rule("arthro.instrument.v1.InstrumentService/ReadObject", Operator, MayNot, Read),
    rule("arthro.instrument.v1.InstrumentService/WriteObject", Operator, MayNot, Command),
    rule("arthro.simulator.v1.CameraService/Capture", Viewer, May, Read),
    rule("arthro.simulator.v1.CameraService/CaptureBoard", Viewer, May, Read),
    rule("arthro.simulator.v1.RefereeService/GetCell", Viewer, May, Read),
    rule("arthro.simulator.v1.RefereeService/GetAccount", Viewer, May, Read),
    rule("arthro.simulator.v1.RefereeService/ScoreRegistration", Viewer, May, Read),
    rule("arthro.simulator.v1.RefereeService/ScoreCalibration", Viewer, May, Read),
    rule("arthro.simulator.v1.BenchService/ReadDivot", Viewer, May, Read),
    rule("arthro.simulator.v1.DriveFaultService/InjectDriveFault", Operator, MayNot, Command),
    rule("arthro.simulator.v1.DriveFaultService/ListDriveFaults", Viewer, MayNot, Read),
    rule("arthro.simulator.v1.DriveFaultService/WaitForDriveFault", Viewer, MayNot, Read),
    rule("arthro.simulator.v1.DriveFaultService/ClearDriveFaults", Operator, MayNot, Command),
    rule("arthro.simulator.v1.DriveFaultService/GetDrives", Viewer, MayNot, Read),
    rule("arthro.simulator.v1.FaultService/InjectLinkFault", Operator, MayNot, Command),
    rule("arthro.simulator.v1.FaultService/InjectRobotFault", Operator, MayNot, Command),
    rule("arthro.simulator.v1.FaultService/ListFaults", Viewer, MayNot, Read),
    rule("arthro.simulator.v1.FaultService/WaitForLinkFault", Viewer, MayNot, Read),
    rule("arthro.simulator.v1.FaultService/ClearFaults", Operator, MayNot, Command),
    rule("grpc.health.v1.Health/Check", Viewer, May, Read),
    rule("grpc.health.v1.Health/Watch", Viewer, May, Read),
    rule("grpc.reflection.v1.ServerReflection/ServerReflectionInfo", Viewer, May, Read),
    rule("grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", Viewer, May, Read),
];

static BY_METHOD: LazyLock<HashMap<&'static str, &'static Rule>> =
    LazyLock::new(|| RULES.iter().map(|rule| (rule.method, rule)).collect());

const fn rule(method: &'static str, least: Role, services: Services, effect: Effect) -> Rule {
    Rule {
        method,
        least,
        services,
        effect,
    }
}

// === impl Rule ===

impl Rule {
    /// The line of a request's path, `/package.Service/Method`.
    pub fn of(path: &str) -> Option<&'static Self> {
        BY_METHOD.get(path.strip_prefix('/')?).copied()
    }

    /// Whether a role may call it.
    pub fn allows(&self, role: Role) -> bool {
        match role {
            Role::Service => self.services == Services::May,
            person => person >= self.least,
        }
    }

    /// Who may call it, in the words of a refusal.
    pub fn needed(&self) -> &'static str {
        match (self.least, self.services) {
            (Role::Viewer, Services::May) => "any role",
            (Role::Viewer, Services::MayNot) => "viewer, operator or surgeon",
            (Role::Operator, Services::May) => "operator, surgeon or service",
            (Role::Operator, Services::MayNot) => "operator or surgeon",
            (Role::Surgeon, Services::MayNot) => "surgeon",
            (Role::Surgeon, Services::May) => "surgeon or service",
            (Role::Service, _) => "service",
        }
    }
}

// === impl Effect ===

impl Effect {
    /// Whether the world is otherwise afterwards, but for what a stop halts.
    pub const fn changes(self) -> bool {
        match self {
            Self::Read | Self::Stop => false,
            Self::Command | Self::Decision | Self::Halt => true,
        }
    }

    /// The word in docs.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Command => "command",
            Self::Decision => "decision",
            Self::Halt => "halt",
            Self::Stop => "stop",
        }
    }
}

#[cfg(test)]
mod tests;
