//! Watches procedures for the record: that one began, held, went on, was interrupted and why, and how it ended.

use tokio::sync::watch;

use super::entry::{Entry, Kind, Who};
use super::keeper::Audit;
use crate::procedure::{Procedure, State};
use crate::wall_clock::now_ms;

/// Records a procedure's states until it is over.
pub async fn follow(audit: Audit, mut published: watch::Receiver<Procedure>) {
    let mut told = None;
    loop {
        let (now, entry) = {
            let procedure = published.borrow_and_update();
            (
                (procedure.state, procedure.reason.clone()),
                entry(&procedure),
            )
        };
        if told.as_ref() != Some(&now) {
            audit.note(entry);
            told = Some(now.clone());
        }
        if now.0.is_over() || published.changed().await.is_err() {
            return;
        }
    }
}

fn entry(procedure: &Procedure) -> Entry {
    let kind = match procedure.state {
        State::Interrupted => Kind::Alarm,
        _ => Kind::Procedure,
    };
    let step = procedure.step.as_ref().map_or_else(String::new, |step| {
        let bite = step
            .planned
            .bite
            .map_or_else(String::new, |bite| format!(" of bite {bite}"));
        format!(
            "; step {} {}{bite} is {}",
            step.sequence, step.planned.kind, step.state
        )
    });
    let bites = format!(
        "{} of {} bites done",
        procedure.bites_done, procedure.bites_planned
    );
    let detail = match procedure.detail.as_str() {
        "" => format!("{bites}{step}"),
        detail => format!("{detail}; {bites}{step}"),
    };
    Entry {
        stated: procedure.operator.clone(),
        case_id: procedure.case_id.clone(),
        procedure_id: procedure.id.clone(),
        plan: Some(procedure.plan_digest),
        code: procedure.state.as_str().to_owned(),
        reason: procedure.reason.clone(),
        detail,
        ..Entry::new(now_ms(), kind, Who::gateway())
    }
}
