//! What each step commands: a few commands to the arms and drives, each confirmed before the next.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1::Authorization;

use crate::cases::Approved;
use crate::clients::motion::{Arm, ArmState, Move, MoveProgress};
use crate::clients::{Acted, Clients, Failure, Peer};
use crate::config::Cell;
use crate::procedure::lease::Command;
use crate::procedure::poses::{
    self, BitePose, OUTSIDE_DEPTH_MM, PoseError, Poses, VIEW_DEPTH_MIN_MM, ViewPose,
};
use crate::procedure::safety::Placement;
use crate::procedure::steps::{BiteOutcome, Kind, Planned};

/// A tip that moves no farther goes to its next view inside, mm; planning keeps most of them so near.
const NEAR_VIEW_MM: f64 = 10.0;
/// Depths nearer than this are one, mm.
const SAME_DEPTH_MM: f64 = 0.1;
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

/// Counts the commands of one step: each needs an id of its own, derived from the step's.
struct Ids<'a> {
    step: &'a str,
    used: u32,
}

impl Ids<'_> {
    /// The step's own id first, so that a step of one command has one id.
    fn next(&mut self) -> String {
        let id = match self.used {
            0 => self.step.to_owned(),
            used => format!("{}.{used}", self.step),
        };
        self.used += 1;
        id
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
        let mut step = Performing {
            performer: self,
            ids: Ids {
                step: operation_id,
                used: 0,
            },
            watch,
        };
        match planned.kind {
            Kind::Prepare => step.prepare().await,
            Kind::View => step.view(planned).await,
            Kind::Approach => step.approach().await,
            Kind::Pivot => step.pivot(planned).await,
            Kind::Insert => step.insert(planned).await,
            Kind::Bite => step.bite(planned).await,
            Kind::Retract if planned.bite.is_none() => step.retract_both().await,
            Kind::Retract => step.retract(Arm::Forceps).await,
            Kind::PivotBack => step.pivot_back().await,
            Kind::ToTray => step.carry_to_tray().await,
            Kind::Release => step.release().await,
            Kind::Withdraw => step.withdraw().await,
        }
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

/// One step under way.
struct Performing<'a> {
    performer: &'a Performer,
    ids: Ids<'a>,
    watch: &'a mut (dyn FnMut(Arm, MoveProgress) + Send),
}

impl Performing<'_> {
    /// For the next command of the step, unless it is halted.
    fn authorize(&mut self, peer: Peer) -> Result<Authorization, StepError> {
        let Performer { command, halt, .. } = self.performer;
        // Noted before the question: whoever halts after it hears of this command.
        let commanded = match peer {
            Peer::Instrument => DRIVES,
            _ => ARMS,
        };
        halt.commanded.store(commanded, Ordering::SeqCst);
        if halt.halted.load(Ordering::SeqCst) {
            return Err(StepError::Halted);
        }
        let id = self.ids.next();
        Ok(match peer {
            Peer::Instrument => command.of_instrument(id),
            _ => command.of_motion(id),
        })
    }

    /// Drives referenced, portals stated, forceps over the tray with its jaw open, arthroscope in front of its portal.
    async fn prepare(&mut self) -> Result<Performed, StepError> {
        let performer = self.performer;
        let poses = performer.poses(Kind::Prepare)?;
        self.find_references().await?;
        self.set_portal(Arm::Forceps).await?;
        self.set_portal(Arm::Arthroscope).await?;

        self.carry_to_tray().await?;
        self.open_jaw().await?;

        let entry = poses.arthroscope;
        let at_portal = Move::Free {
            rotation: entry.neutral,
            tip: entry.outside_tip,
        };
        self.move_arm(Arm::Arthroscope, at_portal).await?;
        Ok(Performed::default())
    }

    /// From wherever the arthroscope stands on its portal: back first, then the turn, then in. A near view is turned to at
    /// the lesser of both depths; a far one from just inside the portal, where a turn moves the tip little.
    async fn view(&mut self, planned: Planned) -> Result<Performed, StepError> {
        let (bite, view) = self.performer.view_pose(planned)?;
        let portal = self.performer.cell.arthroscope_portal;
        let measured = self.performer.measured(Arm::Arthroscope).await?;
        let tip = measured.base_from_tool.origin();
        let depth_mm = (tip - portal).dot(&measured.base_from_tool.direction(&Vector3::x()));
        let turn_mm = if (view.tip(&portal) - tip).norm() > NEAR_VIEW_MM {
            VIEW_DEPTH_MIN_MM
        } else {
            view.depth_mm
        };
        let mut depth_mm = depth_mm;
        if depth_mm > turn_mm + SAME_DEPTH_MM {
            depth_mm = turn_mm;
            self.move_arm(Arm::Arthroscope, Move::Retract { depth_mm })
                .await?;
        }
        let aim = view.aim;
        self.move_arm(Arm::Arthroscope, Move::Pivot { aim }).await?;
        if view.depth_mm > depth_mm + SAME_DEPTH_MM {
            let depth_mm = view.depth_mm;
            self.move_arm(Arm::Arthroscope, Move::Insert { depth_mm })
                .await?;
        }
        Ok(told(format!(
            "arthroscope {:.1} mm inside, at its view of bite {bite}",
            view.depth_mm
        )))
    }

    async fn approach(&mut self) -> Result<Performed, StepError> {
        let entry = self.performer.poses(Kind::Approach)?.forceps;
        let outside = Move::Free {
            rotation: entry.neutral,
            tip: entry.outside_tip,
        };
        self.move_arm(Arm::Forceps, outside).await?;
        Ok(Performed::default())
    }

    /// Aims the shaft, then turns the jaw from where the shaft is measured to be.
    async fn pivot(&mut self, planned: Planned) -> Result<Performed, StepError> {
        let performer = self.performer;
        let (bite, pose) = performer.bite_pose(planned)?;
        let aim = pose.center;
        self.move_arm(Arm::Forceps, Move::Pivot { aim }).await?;

        let measured = performer.clients.motion.arms().await?.forceps;
        let instrument = &performer.clients.instrument;
        let current_deg = instrument.axes().await?.forceps_rotation_deg;
        let travel = instrument.forceps_rotation_travel_deg().await?;
        let angle_deg =
            poses::jaw_angle_deg(&measured.base_from_tool, &pose.opening, current_deg, travel)
                .ok_or(StepError::JawAngle {
                    bite,
                    lowest_deg: travel.0,
                    highest_deg: travel.1,
                })?;
        let authorization = self.authorize(Peer::Instrument)?;
        instrument.turn_forceps(authorization, angle_deg).await?;
        Ok(told(format!("jaw at {angle_deg:.1} deg")))
    }

    async fn insert(&mut self, planned: Planned) -> Result<Performed, StepError> {
        let (_, BitePose { depth_mm, .. }) = self.performer.bite_pose(planned)?;
        self.move_arm(Arm::Forceps, Move::Insert { depth_mm })
            .await?;
        Ok(told(format!("tip {depth_mm:.1} mm inside")))
    }

    async fn bite(&mut self, planned: Planned) -> Result<Performed, StepError> {
        let performer = self.performer;
        let (bite, _) = performer.bite_pose(planned)?;
        // The arm holds still while the jaw closes. Measured before, so that a confirmed bite cannot be lost to a
        // question that fails after it.
        let tip = self
            .performer
            .measured(Arm::Forceps)
            .await
            .map_err(StepError::before)?;
        let authorization = self.authorize(Peer::Instrument)?;
        let bitten = performer.clients.instrument.bite(authorization).await?;
        Ok(Performed {
            detail: format!("{} at {:.0} mA", bitten.jaw, bitten.peak_current_ma),
            outcome: Some(BiteOutcome {
                bite,
                tip: tip.base_from_tool.origin(),
                jaw: bitten.jaw,
                peak_current_ma: bitten.peak_current_ma,
            }),
        })
    }

    async fn retract(&mut self, arm: Arm) -> Result<Performed, StepError> {
        let depth_mm = OUTSIDE_DEPTH_MM;
        self.move_arm(arm, Move::Retract { depth_mm }).await?;
        Ok(Performed::default())
    }

    /// Draws back whatever is inside, along its shaft; faults are acknowledged only where the operator has said so.
    async fn retract_both(&mut self) -> Result<Performed, StepError> {
        let performer = self.performer;
        let motion = &performer.clients.motion;
        // A motion service that was restarted does not know what is inside before it knows the portal; and what it does
        // not know to be inside it would let go elsewhere than back once its fault is acknowledged.
        for arm in Arm::ALL {
            if !motion.has_portal(*arm).await? {
                self.restate_portal(*arm).await?;
            }
        }
        if performer.recovers_faults.swap(false, Ordering::SeqCst) {
            self.recover_faults().await?;
        }
        let arms = motion.arms().await?;
        let mut retracted = Vec::new();
        for arm in Arm::ALL {
            if arms.get(*arm).inside {
                self.retract(*arm).await?;
                retracted.push(arm.as_str());
            }
        }
        Ok(told(match retracted.as_slice() {
            [] => "nothing was inside".to_owned(),
            arms => format!("retracted {}", arms.join(" and ")),
        }))
    }

    async fn recover_faults(&mut self) -> Result<(), StepError> {
        let Clients {
            motion, instrument, ..
        } = &self.performer.clients;
        let arms = motion.arms().await?;
        for arm in Arm::ALL {
            if arms.get(*arm).fault.is_some() {
                let authorization = self.authorize(Peer::Motion)?;
                motion.recover_fault(authorization, *arm).await?;
            }
        }
        if !instrument.axes().await?.faults.is_empty() {
            let authorization = self.authorize(Peer::Instrument)?;
            instrument.recover_fault(authorization).await?;
        }
        Ok(())
    }

    /// The calibrated portal, held against the measured shaft first: told a wrong one, the motion service would draw a tool
    /// that is inside back along a line that the skin does not lie on.
    async fn restate_portal(&mut self, arm: Arm) -> Result<(), StepError> {
        let measured = self.performer.measured(arm).await?;
        let portal = self.performer.cell.portal(arm);
        let limit_mm = self.performer.retraction.portal_tolerance_mm;
        let placement = Placement::of(&measured.base_from_tool, portal);
        if !placement.may_have_portal(limit_mm) {
            return Err(StepError::OffPortal {
                arm,
                depth_mm: placement.depth_mm,
                off_portal_mm: placement.off_portal_mm,
                limit_mm,
            });
        }
        self.set_portal(arm).await
    }

    async fn find_references(&mut self) -> Result<(), StepError> {
        let instrument = &self.performer.clients.instrument;
        let axes = instrument.axes().await?;
        if !axes.referenced() {
            let authorization = self.authorize(Peer::Instrument)?;
            instrument.home(authorization, &axes).await?;
        }
        Ok(())
    }

    async fn pivot_back(&mut self) -> Result<Performed, StepError> {
        let aim = self.performer.poses(Kind::PivotBack)?.forceps.neutral_aim;
        self.move_arm(Arm::Forceps, Move::Pivot { aim }).await?;
        Ok(Performed::default())
    }

    async fn carry_to_tray(&mut self) -> Result<Performed, StepError> {
        let over_tray = self.performer.cell.forceps_base_from_tool_at_tray;
        let over_tray = Move::Free {
            rotation: over_tray.rotation(),
            tip: over_tray.origin(),
        };
        self.move_arm(Arm::Forceps, over_tray).await?;
        Ok(Performed::default())
    }

    /// Over the tray. Drives that lost their reference find it here, where nothing is in their way.
    async fn release(&mut self) -> Result<Performed, StepError> {
        self.find_references().await?;
        self.open_jaw().await?;
        Ok(Performed::default())
    }

    /// The forceps stays over the tray, where the last step left it.
    async fn withdraw(&mut self) -> Result<Performed, StepError> {
        let arthroscope = self.performer.measured(Arm::Arthroscope).await?;
        if arthroscope.inside {
            self.retract(Arm::Arthroscope).await?;
        }
        let tip = self.performer.cell.arthroscope_rest;
        self.shift(Arm::Arthroscope, tip).await?;
        Ok(Performed::default())
    }

    /// Moves the tip through free space without turning the tool, so that it needs no plan.
    async fn shift(&mut self, arm: Arm, tip: Point3) -> Result<(), StepError> {
        let rotation = self
            .performer
            .measured(arm)
            .await?
            .base_from_tool
            .rotation();
        self.move_arm(arm, Move::Free { rotation, tip }).await
    }

    async fn set_portal(&mut self, arm: Arm) -> Result<(), StepError> {
        let performer = self.performer;
        let portal = *performer.cell.portal(arm);
        let authorization = self.authorize(Peer::Motion)?;
        let motion = &performer.clients.motion;
        Ok(motion.set_portal(authorization, arm, &portal).await?)
    }

    async fn open_jaw(&mut self) -> Result<(), StepError> {
        let performer = self.performer;
        let authorization = self.authorize(Peer::Instrument)?;
        Ok(performer.clients.instrument.open_jaw(authorization).await?)
    }

    async fn move_arm(&mut self, arm: Arm, motion: Move) -> Result<(), StepError> {
        let performer = self.performer;
        let authorization = self.authorize(Peer::Motion)?;
        let watch = &mut *self.watch;
        let client = &performer.clients.motion;
        Ok(client
            .perform(authorization, arm, motion, |progress| watch(arm, progress))
            .await?)
    }
}

fn told(detail: String) -> Performed {
    Performed {
        detail,
        outcome: None,
    }
}
