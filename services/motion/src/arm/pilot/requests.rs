//! What is asked of an arm: each request is refused by name or carried out at once, before the next state.

use arthro_authority::Outcome;
use tokio::sync::watch;
use ur_link::{RuntimeState, State};

use super::{APART_RAD, Activity, Answer, Pilot, SLIDER_MIN, measured};
use crate::arm::motion::{Motion, stands};
use crate::arm::{ArmOptions, Request};
use crate::command::{Authorization, Progress};
use crate::error::Error;
use crate::kinematics::{Joints, largest_difference};
use crate::plan::{Move, Situation};
use crate::rcm::Portal;
use crate::supervisor::{Observation, Regime};
use crate::sweep::Walker;
use crate::way::Way;

impl Pilot {
    pub fn serve(&mut self, request: Request) {
        match request {
            Request::Move { by, wanted, reply } => {
                let began = self
                    .begin(&by, &wanted)
                    .map_err(|error| self.commander.refuse(&by.operation_id, error));
                self.answers.push(Answer::Move(reply, began));
            }
            Request::SetPortal { by, portal, reply } => {
                let outcome = self.set_portal(portal);
                self.answers
                    .push(Answer::Done(reply, self.record(&by, outcome)));
            }
            Request::RecoverFault { by, reply } => {
                let outcome = self.recover();
                self.answers
                    .push(Answer::Done(reply, self.record(&by, outcome)));
            }
        }
    }

    fn begin(
        &mut self,
        by: &Authorization,
        wanted: &Move,
    ) -> Result<watch::Receiver<Progress>, Error> {
        let (state, seen) = self.ready()?;
        let situation = Situation {
            arm: &self.options.arm,
            limits: &self.options.limits,
            period_s: self.period_s,
            portal: self.portal,
            joints_rad: &state.target_q,
            seen: &seen,
        };
        self.may_begin(wanted, &seen)?;
        let plan = situation.plan(wanted)?;
        self.take_way(wanted, &plan.way, &state.target_q, &seen)?;
        let (motion, progress) = Motion::new(by.clone(), plan, state.target_q, self.period_s)?;
        self.commander.follow(&by.operation_id, progress.clone());
        self.activity = Activity::Moving(motion);
        tracing::info!(
            arm = self.options.name,
            operation = by.operation_id,
            "move begins"
        );
        Ok(progress)
    }

    /// After a fault inside the way on is out.
    fn may_begin(&self, wanted: &Move, seen: &Observation) -> Result<(), Error> {
        match (self.retract_only, seen.placement) {
            (Some(fault), Some(placement)) if !matches!(wanted, Move::Retract { .. }) => {
                Err(Error::RetractOnly {
                    fault,
                    depth_mm: placement.depth_mm,
                })
            }
            _ => Ok(()),
        }
    }

    /// The way must keep clear of planes and of the other arm. Drawing back from inside is open whatever is near: the
    /// supervisor alone watches it.
    fn take_way(
        &self,
        wanted: &Move,
        way: &Way,
        start: &Joints,
        seen: &Observation,
    ) -> Result<(), Error> {
        let ArmOptions {
            arm, limits, berth, ..
        } = &*self.options;
        let way_out = seen.inside && matches!(wanted, Move::Retract { .. });
        let walker = Walker {
            arm,
            limits,
            berth,
            plane_room_mm: if way_out {
                f64::NEG_INFINITY
            } else {
                self.supervisor.plane_room_mm()
            },
        };
        let sweep = walker.sweep(way, start)?;
        if way_out {
            berth.take_way_out(sweep);
            return Ok(());
        }
        berth.take(sweep, &self.supervisor.keep())
    }

    /// The latest state, if a move may begin from it.
    fn ready(&self) -> Result<(State, Observation), Error> {
        let (state, seen) = self.latest.ok_or_else(|| self.not_connected())?;
        if let Some(fault) = &self.fault {
            return Err(Error::Faulted {
                reason: fault.reason.to_owned(),
                detail: fault.detail.clone(),
            });
        }
        if !self.is_standing() || !stands(&state) {
            return Err(Error::Moving);
        }
        let not_ready = |detail: String| Err(Error::NotReady { detail });
        if let Some(fault) = state.program.fault {
            return not_ready(format!("its program has yet to clear the fault {fault:?}"));
        }
        if !state.program.ready {
            return not_ready(match state.runtime_state {
                RuntimeState::Playing => "another program runs on it".to_owned(),
                other => format!("our program does not run on it: it is {other}"),
            });
        }
        // A NaN is in no range.
        if !(SLIDER_MIN..).contains(&state.target_speed_fraction) {
            return Err(Error::SpeedSlider {
                fraction: state.target_speed_fraction,
            });
        }
        let (joint, apart_rad) = largest_difference(&state.target_q, &state.actual_q);
        if apart_rad > APART_RAD {
            let joint = joint + 1;
            return not_ready(format!(
                "joint {joint} is {apart_rad:.4} rad from where it was commanded; limit {APART_RAD} rad"
            ));
        }
        Ok((state, seen))
    }

    fn set_portal(&mut self, portal: Portal) -> Result<(), Error> {
        let (_, seen) = self.latest.ok_or_else(|| self.not_connected())?;
        if !self.is_standing() {
            return Err(Error::Moving);
        }
        if let Some(placement) = seen.placement.filter(|_| seen.inside) {
            return Err(Error::ToolInside {
                depth_mm: placement.depth_mm,
            });
        }
        self.portal = Some(portal);
        if let Some((_, seen)) = &mut self.latest {
            self.supervisor
                .place(seen, &portal.point, portal.axis.as_ref());
        }
        Ok(())
    }

    fn recover(&mut self) -> Result<(), Error> {
        let (state, seen) = self.latest.ok_or_else(|| self.not_connected())?;
        if !self.is_standing() {
            return Err(Error::Moving);
        }
        // Also without a fault: an arm that stands too near to something may then move away from it.
        self.supervisor.acknowledge(&seen);
        let Some(fault) = &self.fault else {
            return Ok(());
        };
        let measured = measured(&state);
        self.supervisor
            .check(Regime::Standing, &measured, &seen)
            .map_err(|breach| Error::FaultLasts {
                reason: breach.reason,
                detail: breach.detail,
            })?;
        tracing::info!(
            arm = self.options.name,
            reason = fault.reason,
            "fault recovered"
        );
        self.retract_only = Some(fault.reason).filter(|_| seen.inside);
        self.fault = None;
        Ok(())
    }

    /// Remembers how a command that is done at once came out.
    fn record(&self, by: &Authorization, outcome: Result<(), Error>) -> Result<(), Error> {
        match outcome {
            Ok(()) => {
                let detail = String::new();
                self.commander
                    .finish(&by.operation_id, Outcome::Done { detail });
                Ok(())
            }
            Err(error) => Err(self.commander.refuse(&by.operation_id, error)),
        }
    }
}
