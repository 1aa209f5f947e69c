//! What the drives can be told to do, and how one follows what becomes of it.

use std::time::Duration;

use arthro_authority::{Operation, OperationState};
use epos4_link::canopen::object::Address;
use tokio::sync::watch;

use crate::axis::Axis;
use crate::bite::BiteEnd;
use crate::switches::commissioning::Progress;

/// A command. Its values have been checked against the cell's limits.
#[derive(Clone, PartialEq, Debug)]
pub enum Command {
    /// Find the reference of these axes, one after the other.
    Home(Vec<Axis>),
    /// Move an axis to a position in its unit.
    Move {
        /// Which axis.
        axis: Axis,
        /// Where to.
        target: f64,
    },
    /// Close the jaw with at most this current.
    Bite {
        /// mA.
        current_limit_ma: f64,
    },
    /// Open the jaw.
    OpenJaw,
    /// Acknowledge the faults of these axes.
    Recover(Vec<Axis>),
    /// Have the switches of an axis pressed by hand, while its drive has no power.
    CommissionSwitches {
        /// Which axis.
        axis: Axis,
        /// How long each switch may take, on the clock of the bus.
        timeout: Duration,
    },
    /// Write an object of a drive.
    Write {
        /// Whose drive.
        axis: Axis,
        /// Which object.
        address: Address,
        /// Little-endian.
        data: Vec<u8>,
    },
}

impl Command {
    /// The axes that it needs for itself.
    pub fn axes(&self) -> &[Axis] {
        match self {
            Self::Home(axes) | Self::Recover(axes) => axes,
            Self::Move { axis, .. }
            | Self::CommissionSwitches { axis, .. }
            | Self::Write { axis, .. } => std::slice::from_ref(axis),
            Self::Bite { .. } | Self::OpenJaw => &[Axis::ForcepsFeed],
        }
    }

    /// Whether it moves its axes.
    pub fn moves(&self) -> bool {
        match self {
            Self::Home(_) | Self::Move { .. } | Self::Bite { .. } | Self::OpenJaw => true,
            Self::Recover(_) | Self::CommissionSwitches { .. } | Self::Write { .. } => false,
        }
    }

    /// Whether its axes must know where they are.
    pub fn needs_reference(&self) -> bool {
        matches!(self, Self::Move { .. } | Self::Bite { .. } | Self::OpenJaw)
    }
}

/// Who commands, and under which name.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Authorization {
    /// Of the lease.
    pub fencing_token: u64,
    /// Chosen by the caller.
    pub operation_id: String,
}

/// Where an operation stands.
#[derive(Clone, PartialEq, Debug)]
pub struct Report {
    /// The operation.
    pub operation: Operation,
    /// What a bite came to, whether or not the jaw closed.
    pub bite: Option<BiteEnd>,
    /// The switches that are being commissioned, or were.
    pub switches: Vec<Progress>,
}

impl Report {
    /// Of an operation that has nothing else to tell yet.
    pub(super) fn of(operation: Operation) -> Self {
        Self {
            operation,
            bite: None,
            switches: Vec::new(),
        }
    }
}

/// The way to follow an accepted command. Dropping it changes nothing.
#[derive(Clone, Debug)]
pub struct Ticket {
    /// The newest report, and the next ones.
    pub reports: watch::Receiver<Report>,
    /// The operation was known already; nothing acted again.
    pub repeated: bool,
}

impl Ticket {
    /// The last report, when the operation has ended; `None` when the owner is gone.
    pub async fn ended(&mut self) -> Option<Report> {
        let ended = |report: &Report| report.operation.state != OperationState::Running;
        self.reports
            .wait_for(ended)
            .await
            .ok()
            .map(|report| report.clone())
    }
}
