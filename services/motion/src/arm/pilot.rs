//! What decides for the owner of an arm: one command for each state, without input or output.

mod requests;

use std::sync::Arc;

use arthro_authority::{Operation, Outcome};
use tokio::sync::watch;
use ur_link::{Command, RuntimeState, State};

use super::motion::{Motion, Step, stands};
use super::owner::chain;
use super::{ArmOptions, ArmState, DoneReply, Fault, MoveReply};
use crate::command::{Commander, Progress};
use crate::error::{Error, link_reason};
use crate::rcm::Portal;
use crate::supervisor::{Measured, Observation, Regime, Supervisor};

/// Joints farther than this from where they were commanded are not at rest, rad.
const APART_RAD: f64 = 0.02;
/// Controller time that the program may be missing before a new link starts it again, s.
const PROGRAM_MISSING_S: f64 = 1.0;
/// States that may be missing, in periods of the controller, before it is worth a warning.
const LATE_PERIODS: f64 = 3.0;
/// A speed slider below this is at zero.
const SLIDER_MIN: f64 = 1e-3;

/// Decides for one arm.
pub struct Pilot {
    pub options: Arc<ArmOptions>,
    pub commander: Commander,
    supervisor: Supervisor,
    pub portal: Option<Portal>,
    activity: Activity,
    pub fault: Option<Fault>,
    /// Reason of a fault inside that was acknowledged: until the tip is out it may only be drawn back.
    retract_only: Option<&'static str>,
    warning: Option<Fault>,
    /// The last state of this link.
    pub latest: Option<(State, Observation)>,
    program_missing_since_s: Option<f64>,
    /// Of the controller of this link, s.
    period_s: f64,
    states_missed: u64,
    states_late: bool,
    /// Why there is no link, when there is none.
    no_link: (&'static str, String),
    /// Given once the state that they speak of is published.
    pub answers: Vec<Answer>,
}

/// What somebody waits for.
pub enum Answer {
    Move(MoveReply, Result<watch::Receiver<Progress>, Error>),
    Done(DoneReply, Result<(), Error>),
    Ended(Box<Motion>, Operation),
}

enum Activity {
    Standing,
    Moving(Motion),
    Stopping {
        /// The move that was under way, and how it ends once the arm stands.
        ends: Option<(Motion, Outcome)>,
        /// Whether the order has gone out: only then the controller can have carried it out.
        ordered: bool,
    },
}

impl Pilot {
    pub fn new(options: Arc<ArmOptions>, commander: Commander) -> Self {
        Self {
            supervisor: Supervisor::new(options.arm, options.limits.clone(), options.berth.clone()),
            portal: options.portal,
            period_s: options.period_s,
            options,
            commander,
            activity: Activity::Standing,
            fault: None,
            retract_only: None,
            warning: None,
            latest: None,
            program_missing_since_s: None,
            states_missed: 0,
            states_late: false,
            no_link: ("NOT_CONNECTED", "no attempt has ended yet".to_owned()),
            answers: Vec::new(),
        }
    }

    /// A new link is up. It moves nothing.
    pub fn begin_link(&mut self, period_s: f64) {
        self.supervisor.forget_time();
        self.program_missing_since_s = None;
        self.period_s = period_s;
        self.states_missed = 0;
        self.states_late = false;
    }

    /// An attempt to connect failed. True if it failed otherwise than the one before.
    pub fn note_no_link(&mut self, error: &ur_link::Error) -> bool {
        let no_link = (link_reason(error), chain(error));
        let news = no_link != self.no_link;
        self.no_link = no_link;
        news
    }

    /// Judges a state: what it breaks is latched, and a move without its lease is stopped.
    pub fn observe(&mut self, state: &State) {
        let measured = measured(state);
        let (portal, axis) = match &self.portal {
            Some(portal) => (Some(portal.point), portal.axis),
            None => (None, None),
        };
        let seen = self
            .supervisor
            .observe(&measured, portal.as_ref(), axis.as_ref());
        self.latest = Some((*state, seen));
        self.count_missed(seen.gap_s);
        self.warn(&seen);
        self.retract_only = self.retract_only.filter(|_| seen.inside);
        let regime = match &self.activity {
            Activity::Moving(motion) => motion.regime(),
            Activity::Standing | Activity::Stopping { .. } => Regime::Standing,
        };
        if let Err(breach) = self.supervisor.check(regime, &measured, &seen) {
            self.latch(breach.reason, breach.detail);
        }
        let Activity::Moving(motion) = &self.activity else {
            return;
        };
        if let Some(fault) = state.program.fault {
            let detail = format!("the program on the controller stopped the arm: {fault:?}");
            self.latch("CONTROLLER_FAULT", detail);
        } else if !state.program.ready {
            let detail = match state.runtime_state {
                RuntimeState::Playing => "another program replaced ours during a move".to_owned(),
                other => format!("our program ended during a move; the controller is {other}"),
            };
            self.latch("PROGRAM_ENDED", detail);
        } else if let Err(refusal) = self.commander.check(motion.by.fencing_token) {
            tracing::warn!(arm = self.options.name, %refusal, "lease lost during a move");
            self.stop(refusal.reason(), &refusal.to_string());
        }
    }

    /// A few states that do not come are bridged by the window; it is worth knowing all the same.
    fn count_missed(&mut self, gap_s: f64) {
        let periods = gap_s / self.period_s;
        // The clock of a controller that was started again goes back.
        self.states_missed += (periods.round() - 1.0).max(0.0) as u64;
        let late = periods > LATE_PERIODS + 0.5;
        if late && !self.states_late {
            tracing::warn!(
                arm = self.options.name,
                gap_s,
                period_s = self.period_s,
                states_missed = self.states_missed,
                "states of the controller come late"
            );
        }
        self.states_late = late;
    }

    /// No state came for so long on the wall clock. What to send, if anything: a moving arm is stopped, in case that it
    /// still hears.
    pub fn fall_silent(&mut self) -> Option<Command> {
        if self.is_standing() {
            return None;
        }
        let limit_s = self.options.silence.as_secs_f64();
        self.latch(
            "STATE_STALE",
            format!("no state came for {limit_s:.3} s of the wall clock; limit {limit_s:.3} s"),
        );
        Some(Command::Stop)
    }

    /// What to send for this state.
    pub fn command(&mut self, state: &State) -> Command {
        match &mut self.activity {
            // A fault on the controller must not be acknowledged before ours is.
            Activity::Standing if self.fault.is_some() => Command::Stop,
            Activity::Standing => Command::Hold,
            Activity::Stopping { ordered, .. } => {
                let program = &state.program;
                let over = program.finished() || !program.ready || program.fault.is_some();
                if *ordered && over && stands(state) {
                    self.come_to_stand();
                }
                if let Activity::Stopping { ordered, .. } = &mut self.activity {
                    *ordered = true;
                }
                Command::Stop
            }
            Activity::Moving(motion) => {
                let Some((_, seen)) = &self.latest else {
                    return Command::Stop;
                };
                match motion.step(state, seen) {
                    Step::Go(command) => command,
                    Step::Arrived => {
                        let detail = motion.summary();
                        self.halt(Outcome::Done { detail });
                        self.come_to_stand();
                        Command::Hold
                    }
                    Step::Failed(reason, detail) => {
                        self.latch(reason, detail);
                        Command::Stop
                    }
                }
            }
        }
    }

    /// A shaft on its way off the portal is told of once an episode.
    fn warn(&mut self, seen: &Observation) {
        let warned = self.warning.is_some();
        self.warning = seen.warning_mm.map(|deviation_mm| Fault {
            reason: "RCM_DEVIATION",
            detail: format!(
                "distance of the shaft to the portal is {deviation_mm:.3} mm; warning from {:.3} mm, stop beyond {:.3} mm",
                self.options.limits.rcm_warn_mm, self.options.limits.rcm_stop_mm
            ),
        });
        if let Some(warning) = self.warning.as_ref().filter(|_| !warned) {
            let Fault { reason, detail } = warning;
            tracing::warn!(
                arm = self.options.name,
                reason,
                detail,
                "the shaft leaves the portal"
            );
        }
    }

    /// The first fault stands until it is recovered; whatever moves is stopped.
    fn latch(&mut self, reason: &'static str, detail: String) {
        if self.fault.is_none() {
            tracing::error!(arm = self.options.name, reason, detail, "fault latched");
            self.fault = Some(Fault {
                reason,
                detail: detail.clone(),
            });
            let reason = reason.to_owned();
            self.halt(Outcome::Failed { reason, detail });
        }
    }

    pub fn stop(&mut self, reason: &str, detail: &str) {
        self.halt(Outcome::Stopped {
            reason: reason.to_owned(),
            detail: detail.to_owned(),
        });
    }

    /// Orders a stop; a move under way will end with `outcome`.
    fn halt(&mut self, outcome: Outcome) {
        self.activity = match std::mem::replace(&mut self.activity, Activity::Standing) {
            Activity::Moving(motion) => Activity::Stopping {
                ends: Some((motion, outcome)),
                ordered: false,
            },
            Activity::Standing => Activity::Stopping {
                ends: None,
                ordered: false,
            },
            stopping @ Activity::Stopping { .. } => stopping,
        };
    }

    fn come_to_stand(&mut self) {
        self.options.berth.clear();
        let activity = std::mem::replace(&mut self.activity, Activity::Standing);
        if let Activity::Stopping {
            ends: Some((motion, outcome)),
            ..
        } = activity
        {
            self.finish(motion, outcome);
        }
    }

    fn finish(&mut self, motion: Motion, outcome: Outcome) {
        let operation = self.commander.finish(&motion.by.operation_id, outcome);
        tracing::info!(
            arm = self.options.name,
            operation = operation.id,
            state = ?operation.state,
            reason = operation.reason,
            detail = operation.detail,
            "move ended"
        );
        self.answers
            .push(Answer::Ended(Box::new(motion), operation));
    }

    /// A link that is lost in a move is a fault. The controller stops by itself when it hears nothing, but nobody has seen
    /// where: the move ends in doubt.
    pub fn lose_link(&mut self, error: &ur_link::Error) {
        self.note_no_link(error);
        let activity = std::mem::replace(&mut self.activity, Activity::Standing);
        let (motion, doing) = match activity {
            Activity::Standing => (None, None),
            Activity::Moving(motion) => (Some(motion), Some("during a move")),
            Activity::Stopping { ends, .. } => (
                ends.map(|(motion, _)| motion),
                Some("while the arm was being stopped"),
            ),
        };
        if let Some(doing) = doing {
            let detail = format!("the link was lost {doing}: {}", chain(error));
            self.latch("LINK_LOST", detail.clone());
            // Nothing can be ordered without a link.
            self.activity = Activity::Standing;
            if let Some(motion) = motion {
                let detail = format!("{detail}; it is not known where the arm stopped");
                let reason = "LINK_LOST".to_owned();
                self.finish(motion, Outcome::InDoubt { reason, detail });
            }
        }
        self.options.berth.lose();
        self.latest = None;
    }

    /// Whether our program has been away so long that only a new link brings it back. While somebody else's runs it is
    /// left alone: ours would end it.
    pub fn program_is_missing(&mut self, state: &State) -> bool {
        let another_runs = state.runtime_state != RuntimeState::Stopped;
        let waits = another_runs || self.fault.is_some() || !self.is_standing();
        if state.program.ready || waits {
            self.program_missing_since_s = None;
            return false;
        }
        let since_s = *self
            .program_missing_since_s
            .get_or_insert(state.timestamp_s);
        state.timestamp_s - since_s > PROGRAM_MISSING_S
    }

    pub fn is_standing(&self) -> bool {
        matches!(self.activity, Activity::Standing)
    }

    pub fn not_connected(&self) -> Error {
        Error::NotConnected {
            arm: self.options.name,
            address: self.options.address.clone(),
            reason: self.no_link.0,
            why: self.no_link.1.clone(),
        }
    }

    pub fn state(&self) -> Option<ArmState> {
        let (state, seen) = self.latest.as_ref()?;
        let motion = match &self.activity {
            Activity::Moving(motion) => Some(motion),
            Activity::Stopping { ends, .. } => ends.as_ref().map(|(motion, _)| motion),
            Activity::Standing => None,
        };
        Some(ArmState {
            time_s: state.timestamp_s,
            joints_rad: state.actual_q,
            base_from_tool: seen.base_from_tool,
            robot_mode: state.robot_mode,
            safety_mode: state.safety_mode,
            moving: !self.is_standing(),
            inside: seen.inside,
            placement: seen.placement,
            fault: self.fault.clone(),
            warning: self.warning.clone(),
            speed_scaling: state.speed_scaling,
            operation_id: motion.map(|motion| motion.by.operation_id.clone()),
            connected: true,
            states_missed: self.states_missed,
        })
    }
}

impl Answer {
    /// A caller that has gone needs none: what it asked for stands all the same.
    pub fn give(self) {
        match self {
            Self::Move(reply, outcome) => drop(reply.send(outcome)),
            Self::Done(reply, outcome) => drop(reply.send(outcome)),
            Self::Ended(motion, operation) => motion.end(operation),
        }
    }
}

fn measured(state: &State) -> Measured {
    Measured {
        time_s: state.timestamp_s,
        joints_rad: state.actual_q,
        joint_speeds_rad_s: state.actual_qd,
        robot_mode: state.robot_mode,
        safety_mode: state.safety_mode,
    }
}
