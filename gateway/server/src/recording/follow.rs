//! Follows one procedure after the other and puts on the tape what there is to see.

use std::sync::Arc;
use std::time::Duration;

use arthro_proto::gateway::v1 as proto;
use tokio::sync::{mpsc, watch};

use super::feeds::{Feeds, Seen};
use super::scene;
use super::tape::{About, Tape};
use super::topics::Topic;
use crate::clients::Clients;
use crate::config::Cell;
use crate::journal::Journal;
use crate::procedure::steps::{Kind, Step, StepState};
use crate::procedure::{Procedure, State};
use crate::server::procedure::{outcome_message, procedure_message, step_message};
use crate::wall_clock::now_ns;

/// The devices are watched for this long after a procedure came to rest.
const TAIL: Duration = Duration::from_secs(1);

/// The recorder's task.
pub(super) struct Follower {
    tape: Tape,
    clients: Clients,
    journal: Arc<dyn Journal>,
    cell: Option<Cell>,
    state: Option<State>,
    /// The last step on the tape.
    step: Option<(u32, StepState)>,
    /// Bites on the tape.
    bites: usize,
}

type Published = watch::Receiver<Procedure>;

impl Follower {
    pub fn new(
        tape: Tape,
        clients: Clients,
        journal: Arc<dyn Journal>,
        cell: Option<Cell>,
    ) -> Self {
        Self {
            tape,
            clients,
            journal,
            cell,
            state: None,
            step: None,
            bites: 0,
        }
    }

    /// Records until it is told to close, or everybody who could start a procedure is gone.
    pub async fn run(
        mut self,
        mut opened: mpsc::Receiver<Published>,
        mut closing: watch::Receiver<bool>,
    ) {
        let mut next = None;
        loop {
            let published = match next.take() {
                Some(published) => published,
                None => tokio::select! {
                    published = opened.recv() => match published {
                        Some(published) => published,
                        None => return,
                    },
                    () = closed(&mut closing) => return,
                },
            };
            next = self.record(published, &mut opened, &mut closing).await;
            self.tape.end();
        }
    }

    /// Records one procedure; answers the next one if that begins meanwhile.
    async fn record(
        &mut self,
        mut published: Published,
        opened: &mut mpsc::Receiver<Published>,
        closing: &mut watch::Receiver<bool>,
    ) -> Option<Published> {
        let procedure = published.borrow_and_update().clone();
        self.begin(&procedure).await;
        let mut feeds = Feeds::open(&self.clients);
        let mut tail = std::pin::pin!(tokio::time::sleep(Duration::MAX / 4));
        let mut resting = !procedure.state.is_under_way();
        if resting {
            tail.as_mut().reset(tokio::time::Instant::now() + TAIL);
        }
        loop {
            tokio::select! {
                changed = published.changed(), if !resting => {
                    let procedure = published.borrow_and_update().clone();
                    self.procedure(&procedure).await;
                    if changed.is_err() || !procedure.state.is_under_way() {
                        resting = true;
                        tail.as_mut().reset(tokio::time::Instant::now() + TAIL);
                    }
                }
                seen = feeds.next() => self.seen(seen),
                next = opened.recv() => return next,
                () = &mut tail => return None,
                () = closed(closing) => {
                    let procedure = published.borrow_and_update().clone();
                    self.procedure(&procedure).await;
                    return None;
                }
            }
        }
    }

    /// The head of a file, and what happened before it.
    async fn begin(&mut self, procedure: &Procedure) {
        self.tape.begin(About {
            procedure_id: procedure.id.clone(),
            case_id: procedure.case_id.clone(),
            plan_digest: procedure.plan_digest.to_string(),
        });
        (self.state, self.step, self.bites) = (None, None, 0);
        let at_ns = now_ns();
        if let Some(cell) = &self.cell {
            let standing = scene::standing(cell, at_ns);
            self.tape.write(Topic::Transforms, at_ns, &standing);
            self.tape
                .write(Topic::Scene, at_ns, &scene::portals(cell, at_ns));
        }
        self.tape.write(Topic::Scene, at_ns, &scene::shafts(at_ns));
        self.steps_after(&procedure.id, 0).await;
        self.bites(&procedure.id).await;
        self.procedure(procedure).await;
    }

    async fn procedure(&mut self, procedure: &Procedure) {
        if let Some(step) = &procedure.step {
            self.step(&procedure.id, step).await;
        }
        let at_ns = now_ns();
        if self.state != Some(procedure.state) {
            self.state = Some(procedure.state);
            self.tape.write(Topic::Event, at_ns, &decision(procedure));
        }
        let message = procedure_message(procedure);
        self.tape.write(Topic::Procedure, at_ns, &message);
    }

    /// A step's new state. States that came and went between two looks are read from the journal.
    async fn step(&mut self, procedure_id: &str, step: &Step) {
        let now = (step.sequence, step.state);
        if self.step == Some(now) {
            return;
        }
        let missed = match self.step {
            Some((before, state)) => {
                step.sequence > before + 1
                    || (step.sequence > before && state == StepState::Intended)
            }
            None => false,
        };
        if missed {
            let from = self.step.map_or(0, |(sequence, _)| sequence);
            self.steps_between(procedure_id, from, step.sequence).await;
        }
        self.step = Some(now);
        self.tape.write(Topic::Step, now_ns(), &step_message(step));
        if missed || (step.planned.kind == Kind::Bite && step.state != StepState::Intended) {
            self.bites(procedure_id).await;
        }
    }

    async fn steps_after(&mut self, procedure_id: &str, from: u32) {
        self.steps_between(procedure_id, from, u32::MAX).await;
    }

    async fn steps_between(&mut self, procedure_id: &str, from: u32, until: u32) {
        match self.journal.steps(procedure_id).await {
            Ok(steps) => {
                let between = |step: &&Step| (from..until).contains(&step.sequence);
                for step in steps.iter().filter(between) {
                    self.step = Some((step.sequence, step.state));
                    self.tape.write(Topic::Step, now_ns(), &step_message(step));
                }
            }
            Err(error) => tracing::warn!(%error, "steps are missing in the recording"),
        }
    }

    /// Bites that are not on the tape yet.
    async fn bites(&mut self, procedure_id: &str) {
        match self.journal.bite_outcomes(procedure_id).await {
            Ok(outcomes) => {
                let at_ns = now_ns();
                for outcome in outcomes.iter().skip(self.bites) {
                    let message = outcome_message(outcome);
                    self.tape.write(Topic::Bite, at_ns, &message);
                    if let Some(update) = scene::bite(&message, at_ns) {
                        self.tape.write(Topic::Scene, at_ns, &update);
                    }
                }
                self.bites = outcomes.len();
            }
            Err(error) => tracing::warn!(%error, "bites are missing in the recording"),
        }
    }

    fn seen(&mut self, seen: Seen) {
        let at_ns = now_ns();
        match seen {
            Seen::Cell(cell) => self.tape.write(Topic::Cell, at_ns, &cell),
            Seen::AxisList(axes) => self.tape.write(Topic::AxisList, at_ns, &axes),
            Seen::Axes(axes) => self.tape.write(Topic::Axes, at_ns, &axes),
            Seen::Arms(arms) => {
                let tools = scene::tools(&arms, at_ns);
                self.tape.write(Topic::Arms, at_ns, &arms);
                self.tape.write(Topic::Transforms, at_ns, &tools);
            }
            Seen::Lost(reason, detail) => {
                let event = proto::RecordedEvent {
                    kind: proto::RecordedEventKind::Alarm.into(),
                    reason: reason.to_owned(),
                    detail,
                    missing_messages: 0,
                };
                self.tape.write(Topic::Event, at_ns, &event);
            }
        }
    }
}

/// Resolves when nothing more shall be recorded.
async fn closed(closing: &mut watch::Receiver<bool>) {
    // Without anybody who could record, nothing shall be.
    closing.wait_for(|closing| *closing).await.ok();
}

/// A new state of the procedure as an event.
fn decision(procedure: &Procedure) -> proto::RecordedEvent {
    let interrupted = procedure.state == State::Interrupted;
    proto::RecordedEvent {
        kind: if interrupted {
            proto::RecordedEventKind::Alarm.into()
        } else {
            proto::RecordedEventKind::Decision.into()
        },
        reason: if interrupted && !procedure.reason.is_empty() {
            procedure.reason.clone()
        } else {
            procedure.state.to_string()
        },
        detail: procedure.detail.clone(),
        missing_messages: 0,
    }
}
