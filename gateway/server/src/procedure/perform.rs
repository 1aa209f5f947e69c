//! What each step commands: a few commands to the arms and drives, each confirmed before the next.

mod performing;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use self::performing::Performing;
use crate::cases::Approved;
use crate::clients::motion::{Arm, ArmState, MoveProgress};
use crate::clients::{Acted, Clients, Failure};
use crate::config::Cell;
use crate::procedure::lease::Command;
use crate::procedure::poses::{BitePose, PoseError, Poses, ViewPose};
use crate::procedure::steps::{BiteOutcome, Kind, Planned};

/// Values of [`Halt::commanded`].
const NOTHING: u8 = 0;
const ARMS: u8 = 1;
const DRIVES: u8 = 2;

/// The arms and drives under the gateway's command, and where they shall go.
pub struct Performer {
    clients: Clients,
    command: Command,
    cell: Arc<Cell>,
    /// Unset when only a retreat is left.
    poses: Option<Poses>,
    retraction: Retraction,
    /// Whether faults are still to be acknowledged; the operator's decision serves one retraction.
    recovers_faults: AtomicBool,
    halt: Halt,
}

/// What a retraction from anywhere may do beside drawing back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retraction {
    /// Acknowledge latched faults: the operator's decision, never the gateway's own.
    pub recover_faults: bool,
    /// How near the measured shaft must pass a portal that is stated with the tool inside, mm.
    pub portal_tolerance_mm: f64,
}

/// Whether further commands may leave, and to whom the last one went.
#[derive(Debug, Default)]
struct Halt {
    halted: AtomicBool,
    commanded: AtomicU8,
}

/// Which devices have a command that may be under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Commanded {
    /// Neither.
    Nothing,
    /// The arms.
    Arms,
    /// The drives.
    Drives,
}

/// What a step did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Performed {
    /// For a person.
    pub detail: String,
    /// What the jaw did.
    pub outcome: Option<BiteOutcome>,
}

/// Why a step did not end as intended.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// A service refused, failed or is away.
    #[error(transparent)]
    Failure(#[from] Failure),
    /// The jaw cannot open along the bite.
    #[error(
        "no forceps rotation within {lowest_deg} .. {highest_deg} deg opens the jaw along bite {bite}"
    )]
    JawAngle {
        /// Which bite.
        bite: u32,
        /// The axis' travel.
        lowest_deg: f64,
        /// The axis' travel.
        highest_deg: f64,
    },
    /// The step needs the approved plan, which is not at hand.
    #[error("the step {0} needs the approved plan")]
    NoPlan(Kind),
    /// No further command leaves.
    #[error("the step was halted before its next command")]
    Halted,
    /// A tool stands beyond its calibrated portal and its shaft does not pass it.
    #[error(
        "the {arm}'s tip is {depth_mm:.1} mm beyond the calibrated portal and its shaft passes it at {off_portal_mm:.2} mm; limit {limit_mm} mm"
    )]
    OffPortal {
        /// Which arm.
        arm: Arm,
        /// Of the tip.
        depth_mm: f64,
        /// Of the shaft's line.
        off_portal_mm: f64,
        /// The configuration's.
        limit_mm: f64,
    },
}

impl StepError {
    /// The same error, met before the step's irreversible command left.
    fn before(self) -> Self {
        match self {
            Self::Failure(failure) => Self::Failure(failure.before_acting()),
            other => other,
        }
    }

    /// The stable word.
    pub fn reason(&self) -> &str {
        match self {
            Self::Failure(failure) => failure.reason(),
            Self::JawAngle { .. } => "JAW_ANGLE",
            Self::NoPlan(_) => "NO_PLAN",
            Self::Halted => "HALTED",
            Self::OffPortal { .. } => "SHAFT_OFF_PORTAL",
        }
    }

    /// Whether a halt ended the step, and not a fault of its own.
    pub fn was_halted(&self) -> bool {
        match self {
            Self::Failure(failure) => failure.was_stopped(),
            Self::Halted => true,
            Self::JawAngle { .. } | Self::NoPlan(_) | Self::OffPortal { .. } => false,
        }
    }

    /// Whether tissue may have been removed if this was a bite.
    pub fn acted(&self) -> Acted {
        match self {
            Self::Failure(failure) => failure.acted(),
            Self::JawAngle { .. } | Self::NoPlan(_) | Self::Halted | Self::OffPortal { .. } => {
                Acted::No
            }
        }
    }
}

impl Performer {
    /// For an approved plan.
    pub fn new(
        clients: Clients,
        command: Command,
        approved: &Approved,
        retraction: Retraction,
    ) -> Result<Self, PoseError> {
        let poses = Poses::of(&approved.plan, &approved.registration, &approved.cell)?;
        Ok(Self {
            poses: Some(poses),
            ..Self::for_retreat(clients, command, approved.cell.clone(), retraction)
        })
    }

    /// For a retreat, which needs no plan.
    pub fn for_retreat(
        clients: Clients,
        command: Command,
        cell: Arc<Cell>,
        retraction: Retraction,
    ) -> Self {
        Self {
            clients,
            command,
            cell,
            poses: None,
            retraction,
            recovers_faults: AtomicBool::new(retraction.recover_faults),
            halt: Halt::default(),
        }
    }

    /// Lets no further command of the step under way leave, and says where the last one went.
    pub fn halt(&self) -> Commanded {
        self.halt.halted.store(true, Ordering::SeqCst);
        match self.halt.commanded.load(Ordering::SeqCst) {
            ARMS => Commanded::Arms,
            DRIVES => Commanded::Drives,
            _ => Commanded::Nothing,
        }
    }

    /// Which bites are watched from another place than the one before; empty when only a retreat is left.
    pub fn view_moves(&self) -> Vec<bool> {
        self.poses
            .as_ref()
            .map(Poses::view_moves)
            .unwrap_or_default()
    }

    /// The leases under which everything is commanded.
    pub fn command(&self) -> &Command {
        &self.command
    }

    /// Gives the leases back.
    pub async fn release(self) {
        self.command.release().await;
    }

    /// Performs one step; `watch` hears of every move under way.
    pub async fn perform(
        &self,
        planned: Planned,
        operation_id: &str,
        watch: &mut (dyn FnMut(Arm, MoveProgress) + Send),
    ) -> Result<Performed, StepError> {
        self.halt.halted.store(false, Ordering::SeqCst);
        self.halt.commanded.store(NOTHING, Ordering::SeqCst);
        Performing::new(self, operation_id, watch)
            .perform(planned)
            .await
    }

    async fn measured(&self, arm: Arm) -> Result<ArmState, StepError> {
        Ok(self.clients.motion.arms().await?.get(arm).clone())
    }

    fn poses(&self, kind: Kind) -> Result<&Poses, StepError> {
        self.poses.as_ref().ok_or(StepError::NoPlan(kind))
    }

    fn view_pose(&self, planned: Planned) -> Result<(u32, ViewPose), StepError> {
        let missing = || StepError::NoPlan(planned.kind);
        let bite = planned.bite.ok_or_else(missing)?;
        let poses = self.poses(planned.kind)?;
        let view = poses.views.get(bite as usize).ok_or_else(missing)?;
        Ok((bite, *view))
    }

    fn bite_pose(&self, planned: Planned) -> Result<(u32, BitePose), StepError> {
        let missing = || StepError::NoPlan(planned.kind);
        let bite = planned.bite.ok_or_else(missing)?;
        let poses = self.poses(planned.kind)?;
        let pose = poses.bites.get(bite as usize).ok_or_else(missing)?;
        Ok((bite, *pose))
    }
}
