//! One step under way: its commands, one after the other.

use std::sync::atomic::Ordering;

use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1::Authorization;

use super::{ARMS, DRIVES, Performed, Performer, StepError};
use crate::clients::motion::{Arm, Move, MoveProgress};
use crate::clients::{Clients, Peer};
use crate::procedure::poses::{self, BitePose, OUTSIDE_DEPTH_MM, VIEW_DEPTH_MIN_MM};
use crate::procedure::safety::Placement;
use crate::procedure::steps::{BiteOutcome, Kind, Planned};

/// A tip that moves no farther goes to its next view inside, mm; planning keeps most of them so near.
const NEAR_VIEW_MM: f64 = 10.0;
/// Depths nearer than this are one, mm.
const SAME_DEPTH_MM: f64 = 0.1;

/// One step under way.
pub(super) struct Performing<'a> {
    performer: &'a Performer,
    ids: Ids<'a>,
    watch: &'a mut (dyn FnMut(Arm, MoveProgress) + Send),
}

impl<'a> Performing<'a> {
    pub(super) fn new(
        performer: &'a Performer,
        operation_id: &'a str,
        watch: &'a mut (dyn FnMut(Arm, MoveProgress) + Send),
    ) -> Self {
        Self {
            performer,
            ids: Ids {
                step: operation_id,
                used: 0,
            },
            watch,
        }
    }

    pub(super) async fn perform(mut self, planned: Planned) -> Result<Performed, StepError> {
        match planned.kind {
            Kind::Prepare => self.prepare().await,
            Kind::View => self.view(planned).await,
            Kind::Approach => self.approach().await,
            Kind::Pivot => self.pivot(planned).await,
            Kind::Insert => self.insert(planned).await,
            Kind::Bite => self.bite(planned).await,
            Kind::Retract if planned.bite.is_none() => self.retract_both().await,
            Kind::Retract => self.retract(Arm::Forceps).await,
            Kind::PivotBack => self.pivot_back().await,
            Kind::ToTray => self.carry_to_tray().await,
            Kind::Release => self.release().await,
            Kind::Withdraw => self.withdraw().await,
        }
    }

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
        let current_deg = instrument.axes().await?.forceps_rotation_deg()?;
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
