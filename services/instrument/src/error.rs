//! Everything that goes wrong, and the one table that says what a client sees of it.

use arthro_bootstrap::status;
use epos4_link::canopen::emcy;
use epos4_link::canopen::object::Address;
use epos4_link::cia402::{State, Statusword};
use epos4_link::network;
use thiserror::Error;
use tonic::Status;

use crate::axis::{Axis, TargetError};
use crate::bite::{BiteEnd, BiteError};
use crate::homing::HomingError;
use crate::positioning::MoveError;
use crate::supervisor::{Fault, drive_reason};
use crate::switches::commissioning::SwitchError;
use crate::switches::{Function, SwitchSpec};

/// Why a command is refused. Nothing has moved.
#[derive(Clone, PartialEq, Debug, Error)]
pub enum Refusal {
    /// The lease or the operation id.
    #[error(transparent)]
    Authority(#[from] arthro_authority::Refusal),
    /// A field of the request.
    #[error("{problem}")]
    Invalid {
        /// Its name.
        field: &'static str,
        /// Value and limit.
        problem: String,
    },
    /// The axis has no reference.
    #[error("{axis} has no reference; home it first")]
    NotHomed {
        /// Which axis.
        axis: Axis,
    },
    /// The axis moves.
    #[error("{axis} moves under operation {operation_id:?}")]
    AxisMoving {
        /// Which axis.
        axis: Axis,
        /// What moves it.
        operation_id: String,
    },
    /// The axis has a latched fault.
    #[error("{axis} has the fault {}: {fault}; recover it first", .fault.reason)]
    AxisFaulted {
        /// Which axis.
        axis: Axis,
        /// Its fault.
        fault: Fault,
    },
    /// The drive is not there or not set up.
    #[error("the drive of {axis} is not ready: {why}")]
    AxisNotReady {
        /// Which axis.
        axis: Axis,
        /// What is missing.
        why: String,
    },
    /// The axis has no switch to commission.
    #[error("{axis} has no switches in the configuration (instrument.axes.{axis}.switches)")]
    NoSwitches {
        /// Which axis.
        axis: Axis,
    },
    /// A quick stop is under way.
    #[error("the drives are being stopped")]
    Stopping,
    /// The service commands this object itself.
    #[error("object {0} moves the drive or guards it and is written by the service alone")]
    ObjectReserved(Address),
    /// The drive refused an object.
    #[error(transparent)]
    Object(#[from] network::Error),
    /// Drives did not confirm a quick stop.
    #[error("quick stop is not confirmed: {0}")]
    StopNotConfirmed(String),
    /// A command other than a motion did not succeed.
    #[error("{detail}")]
    Failed {
        /// Stable word.
        reason: String,
        /// What happened.
        detail: String,
    },
    /// The service goes down.
    #[error("the service is shutting down")]
    ShuttingDown,
}

/// Why a motion that had begun did not end as commanded.
#[derive(Clone, PartialEq, Debug, Error)]
pub enum Failure {
    /// The drive did not answer, or refused an object.
    #[error(transparent)]
    Object(#[from] network::Error),
    /// A move.
    #[error(transparent)]
    Move(#[from] MoveError),
    /// A homing.
    #[error(transparent)]
    Homing(#[from] HomingError),
    /// A bite.
    #[error(transparent)]
    Bite(#[from] BiteError),
    /// No state of CiA 402.
    #[error("statusword {0} is none of the standard's")]
    UnknownStatusword(Statusword),
    /// The drive is in fault.
    #[error("the drive reports 0x{code:04X}, {}", emcy::text(*.code))]
    DriveFault {
        /// Object 0x603F.
        code: u16,
    },
    /// The drive did not follow an order of the state machine.
    #[error("the drive is in {state} and did not reach {wanted} within {limit_s} s")]
    NoTransition {
        /// Where it is.
        state: State,
        /// Where it should be.
        wanted: &'static str,
        /// The time it had.
        limit_s: f64,
    },
    /// The search would run into the axis' end.
    #[error(
        "homing method {method} needs a {function}, input function {}, which no input of the drive has (object 0x3142)",
        .function.code()
    )]
    SwitchNotMapped {
        /// The method.
        method: i8,
        /// The function.
        function: Function,
    },
    /// The drive was asked and has no reference, whatever was seen before.
    #[error("{axis} has no reference, statusword {statusword}; home it first")]
    NotHomed {
        /// Which axis.
        axis: Axis,
        /// What it reports.
        statusword: Statusword,
    },
    /// The drive took the position limits and holds others.
    #[error(
        "the drive's position limits (object 0x607D) read {} to {} qc, written were {} to {} qc",
        .found[0], .found[1], .expected[0], .expected[1]
    )]
    LimitsNotKept {
        /// Lower and upper.
        found: [i32; 2],
        /// As written.
        expected: [i32; 2],
    },
    /// A switch is not wired as configured.
    #[error("{switch} {error}")]
    Switch {
        /// Which.
        switch: SwitchSpec,
        /// What is wrong with it.
        error: SwitchError,
    },
    /// Somebody else switched the drive on while its switches were pressed by hand.
    #[error("the drive got power while its switches were commissioned: it is in {state}")]
    PowerCameOn {
        /// Where it is.
        state: State,
    },
    /// The drive changed, and its process data did not come.
    #[error(
        "the drive has statusword {statusword}, position {position_qc} qc, current {current_ma} mA and did not send them within {limit_s} s"
    )]
    StaleProcessData {
        /// Asked for.
        statusword: Statusword,
        /// Asked for.
        position_qc: i32,
        /// Asked for.
        current_ma: i32,
        /// The time it had, of the bus.
        limit_s: f64,
    },
    /// Another drive answers than before.
    #[error("another drive answers: {0}")]
    WrongNode(String),
    /// The drive did not become ready again.
    #[error("the drive is not ready: {0}")]
    NotReady(String),
    /// A fault came, of this axis or another.
    #[error("{axis}: {fault}")]
    Fault {
        /// Which axis.
        axis: Axis,
        /// The fault.
        fault: Fault,
    },
}

impl Failure {
    /// The stable word of an operation's outcome.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::Object(error) => object_reason(error),
            Self::Move(MoveError::LeftOperation { .. })
            | Self::Bite(BiteError::LeftOperation { .. }) => "DRIVE_LEFT_OPERATION",
            Self::Move(MoveError::ReferenceLost { .. })
            | Self::Bite(BiteError::ReferenceLost { .. }) => "REFERENCE_LOST",
            Self::Move(MoveError::NotReached { .. }) => "TARGET_NOT_REACHED",
            Self::Homing(HomingError::TimeLimit(_)) => "HOMING_TIMED_OUT",
            Self::Homing(HomingError::Interrupted(_)) => "HOMING_INTERRUPTED",
            Self::Homing(HomingError::Reported(_) | HomingError::NotReferenced(_)) => {
                "HOMING_FAILED"
            }
            Self::Bite(BiteError::NotOpen { .. }) => "JAW_NOT_OPEN",
            Self::Bite(BiteError::NotClosed { .. }) => "JAW_NOT_CLOSED",
            Self::Bite(BiteError::NeverMoved { .. }) => "JAW_NEVER_MOVED",
            Self::Bite(BiteError::BladesNotFelt { .. }) => "JAW_CLOSURE_DOUBTFUL",
            Self::Bite(BiteError::Stalled { .. } | BiteError::TooSlow { .. }) => "JAW_STALLED",
            Self::NotHomed { .. } => "NOT_HOMED",
            Self::LimitsNotKept { .. } => "POSITION_LIMITS_NOT_KEPT",
            Self::Switch { error, .. } => error.reason(),
            Self::PowerCameOn { .. } => "DRIVE_HAS_POWER",
            Self::UnknownStatusword(_) => "UNKNOWN_STATUSWORD",
            Self::DriveFault { code } => drive_reason(*code),
            Self::NoTransition { .. } => "DRIVE_NO_TRANSITION",
            Self::SwitchNotMapped { .. } => "HOMING_SWITCH_NOT_MAPPED",
            Self::StaleProcessData { .. } => "STALE_PROCESS_DATA",
            Self::WrongNode(_) => "WRONG_NODE",
            Self::NotReady(_) => "AXIS_NOT_READY",
            Self::Fault { fault, .. } => fault.reason,
        }
    }

    /// What a bite that did not close the jaw came to.
    pub fn bite_end(&self) -> Option<BiteEnd> {
        match self {
            Self::Bite(error) => error.end(),
            _ => None,
        }
    }

    /// The fault that this failure is for the axis: none where the drive is known to stand and to obey.
    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::DriveFault { code } => Some(Fault::of_drive(*code)),
            Self::SwitchNotMapped { .. }
            | Self::NotHomed { .. }
            | Self::NotReady(_)
            | Self::Switch { .. }
            | Self::Bite(BiteError::NotOpen { .. } | BiteError::NotClosed { .. })
            | Self::Fault { .. } => None,
            Self::Object(error) if error.abort_code().is_some() => None,
            failure => Some(Fault::new(failure.reason(), failure.to_string())),
        }
    }
}

impl From<TargetError> for Refusal {
    fn from(error: TargetError) -> Self {
        Self::Invalid {
            field: "target",
            problem: error.to_string(),
        }
    }
}

impl From<Refusal> for Status {
    fn from(refusal: Refusal) -> Self {
        let message = refusal.to_string();
        let axis_of = |axis: Axis| ("axis", axis.to_string());
        match refusal {
            Refusal::Authority(refusal) => match refusal.field() {
                Some(field) => status::invalid(field, message),
                None => status::refused(refusal.reason(), message, &refusal.metadata()),
            },
            Refusal::Invalid { field, .. } => status::invalid(field, message),
            Refusal::NotHomed { axis } => status::refused("NOT_HOMED", message, &[axis_of(axis)]),
            Refusal::NoSwitches { axis } => {
                status::refused("SWITCHES_NOT_CONFIGURED", message, &[axis_of(axis)])
            }
            Refusal::AxisMoving { axis, operation_id } => status::refused(
                "AXIS_MOVING",
                message,
                &[axis_of(axis), ("operation_id", operation_id)],
            ),
            Refusal::AxisFaulted { axis, fault } => {
                let metadata = [
                    axis_of(axis),
                    ("fault", fault.reason.to_owned()),
                    ("detail", fault.detail),
                ];
                status::refused("AXIS_FAULTED", message, &metadata)
            }
            Refusal::AxisNotReady { axis, why } => {
                status::unavailable("AXIS_NOT_READY", message, &[axis_of(axis), ("why", why)])
            }
            Refusal::Stopping => status::refused("STOP_UNDER_WAY", message, &[]),
            Refusal::ObjectReserved(address) => status::refused(
                "OBJECT_RESERVED",
                message,
                &[("object", address.to_string())],
            ),
            Refusal::Object(error) => {
                let abort_code = error
                    .abort_code()
                    .map(|code| ("abort_code", format!("0x{:08X}", code.0)));
                let metadata: Vec<_> = abort_code.into_iter().collect();
                match error {
                    network::Error::Failed { .. }
                    | network::Error::Size { .. }
                    | network::Error::ReadBack { .. } => {
                        status::refused(object_reason(&error), message, &metadata)
                    }
                    _ => status::unavailable(object_reason(&error), message, &metadata),
                }
            }
            Refusal::StopNotConfirmed(_) => status::unavailable("STOP_NOT_CONFIRMED", message, &[]),
            Refusal::Failed { reason, .. } => status::refused(&reason, message, &[]),
            Refusal::ShuttingDown => status::unavailable("SHUTTING_DOWN", message, &[]),
        }
    }
}

/// The stable word for a request to a node that did not succeed.
pub(crate) fn object_reason(error: &network::Error) -> &'static str {
    match error {
        network::Error::NoAnswer { .. } => "SDO_NO_ANSWER",
        network::Error::Restarted { .. } => "UNEXPECTED_BOOT_UP",
        network::Error::Failed { .. } => "SDO_ABORTED",
        network::Error::Size { .. } => "SDO_WRONG_SIZE",
        network::Error::Busy { .. } => "SDO_BUSY",
        network::Error::ReadBack { .. } => "SDO_READ_BACK",
        network::Error::NotInState { .. } => "NMT_NO_TRANSITION",
        network::Error::Gone => "BUS_LOST",
    }
}
