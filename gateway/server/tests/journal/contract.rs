//! What the gateway relies on, whichever database it is.

use std::sync::Arc;

use arthro_gateway::calibrations::record::{Kind, Revocation};
use arthro_gateway::journal::{Blob, Duty, Journal, JournalError};
use arthro_gateway::procedure::steps::Kind as StepKind;
use arthro_gateway::procedure::{Procedure, State};
use bytes::Bytes;

use crate::store::{Store, on_both};
use crate::values::{calibration, case, done, filled, outcome, page, procedure, step};

on_both! {
    what_was_written_is_read_after_it_was_opened_anew,
    a_case_is_replaced_with_the_blobs_that_came_with_it,
    cases_come_newest_first,
    cases_come_page_by_page,
    procedures_come_page_by_page,
    a_second_open_procedure_is_refused,
    a_step_is_written_before_and_after,
    an_end_of_a_step_is_written_whole_or_not_at_all,
    an_operation_id_is_used_once,
    whoever_opens_it_is_in_command_with_an_epoch_that_grows,
    whoever_gave_command_up_cannot_write,
    a_procedure_of_no_case_is_refused,
    a_calibration_is_kept_put_in_force_and_revoked,
}

async fn a_calibration_is_kept_put_in_force_and_revoked(store: Store) {
    let journal = store.open().await;
    let (mut old, new) = (calibration("old", 1), calibration("new", 2));
    for saved in [&old, &new] {
        journal.create_calibration(saved).await.unwrap();
    }
    let in_force = async || journal.calibrations_in_force().await.unwrap();
    assert!(in_force().await.is_empty());
    for id in ["new", "old"] {
        let kind = Kind::ToolTip;
        journal
            .put_in_force(kind, Some(id), "engineer", 3)
            .await
            .unwrap();
    }
    let revocation = Revocation {
        by: "engineer".to_owned(),
        at_ms: 4,
        because: "bent".to_owned(),
    };
    journal
        .revoke_calibration("old", &revocation)
        .await
        .unwrap();
    old.revoked = Some(revocation);
    assert_eq!(in_force().await, std::slice::from_ref(&old));
    assert_eq!(journal.calibrations().await.unwrap(), [new.clone(), old]);
    assert_eq!(journal.calibration("new").await.unwrap(), Some(new));
    assert_eq!(journal.calibration("other").await.unwrap(), None);
    let unknown = journal.put_in_force(Kind::ToolTip, Some("other"), "engineer", 5);
    assert!(unknown.await.is_err());
    journal
        .put_in_force(Kind::ToolTip, None, "engineer", 6)
        .await
        .unwrap();
    assert!(in_force().await.is_empty());
}

async fn what_was_written_is_read_after_it_was_opened_anew(store: Store) {
    let journal = store.open().await;
    let written = filled("c");
    journal.create_case(&written).await.unwrap();
    let scene = Bytes::from(vec![0xA5; 3_000_000]);
    journal
        .save_case(&written, &[(Blob::Scene, scene.clone())])
        .await
        .unwrap();
    let journal = store.reopen(journal).await;
    assert_eq!(journal.case("c").await.unwrap(), Some(written));
    assert_eq!(journal.blob("c", Blob::Scene).await.unwrap(), scene);
    assert!(journal.blob("c", Blob::Lesion).await.unwrap().is_empty());
    assert_eq!(journal.case("other").await.unwrap(), None);
}

async fn a_case_is_replaced_with_the_blobs_that_came_with_it(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    // A value that was absent comes after it was written as absent.
    journal.save_case(&case("c"), &[]).await.unwrap();
    for content in [&b"first"[..], b"second"] {
        let blob = (Blob::Vertices, Bytes::from_static(content));
        journal.save_case(&filled("c"), &[blob]).await.unwrap();
        assert_eq!(journal.case("c").await.unwrap(), Some(filled("c")));
    }
    journal.save_case(&case("c"), &[]).await.unwrap();
    assert_eq!(journal.case("c").await.unwrap(), Some(case("c")));
    assert_eq!(
        journal.blob("c", Blob::Vertices).await.unwrap(),
        &b"second"[..]
    );
}

async fn cases_come_newest_first(store: Store) {
    let journal = store.open().await;
    for (id, created_at_ms) in [("old", 1), ("new", 3), ("middle", 2)] {
        let mut case = case(id);
        case.created_at_ms = created_at_ms;
        journal.create_case(&case).await.unwrap();
    }
    assert_eq!(case_ids(&journal, None, 9).await, ["new", "middle", "old"]);
}

async fn cases_come_page_by_page(store: Store) {
    let journal = store.open().await;
    // Two of the same millisecond.
    for (id, created_at_ms) in [("a", 1), ("b", 2), ("c", 2), ("d", 3)] {
        let mut case = case(id);
        case.created_at_ms = created_at_ms;
        journal.create_case(&case).await.unwrap();
    }
    assert_eq!(case_ids(&journal, None, 2).await, ["d", "c"]);
    assert_eq!(case_ids(&journal, Some("c"), 2).await, ["b", "a"]);
    assert!(case_ids(&journal, Some("a"), 2).await.is_empty());
    assert!(case_ids(&journal, Some("none"), 2).await.is_empty());
}

async fn procedures_come_page_by_page(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    for (id, started_at_ms) in [("p", 1), ("q", 2), ("r", 2)] {
        let mut procedure = procedure(id, "c");
        procedure.started_at_ms = started_at_ms;
        journal.create_procedure(&procedure).await.unwrap();
        procedure.state = State::Completed;
        journal.save_procedure(&procedure).await.unwrap();
    }
    let ids = async |after: Option<&str>| {
        let procedures = journal.procedures(&page(after, 2)).await.unwrap();
        let ids = procedures.into_iter().map(|procedure| procedure.id);
        ids.collect::<Vec<_>>()
    };
    assert_eq!(ids(None).await, ["r", "q"]);
    assert_eq!(ids(Some("q")).await, ["p"]);
    assert!(ids(Some("p")).await.is_empty());
}

async fn case_ids(journal: &Arc<dyn Journal>, after: Option<&str>, limit: u32) -> Vec<String> {
    let cases = journal.cases(&page(after, limit)).await.unwrap();
    cases.into_iter().map(|case| case.id).collect()
}

async fn a_second_open_procedure_is_refused(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    let mut first = procedure("p1", "c");
    journal.create_procedure(&first).await.unwrap();
    for state in [
        State::Running,
        State::Paused,
        State::Aborting,
        State::Interrupted,
    ] {
        first.state = state;
        journal.save_procedure(&first).await.unwrap();
        let second = journal.create_procedure(&procedure("p2", "c")).await;
        assert!(second.is_err(), "while the first is {state}");
    }
    for state in [State::Completed, State::Aborted] {
        first.state = state;
        journal.save_procedure(&first).await.unwrap();
        let second = Procedure {
            state,
            ..procedure(state.as_str(), "c")
        };
        journal.create_procedure(&second).await.unwrap();
    }
}

async fn a_step_is_written_before_and_after(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    let mut procedure = procedure("p", "c");
    journal.create_procedure(&procedure).await.unwrap();
    let bite = step(1, StepKind::Bite, Some(0));
    journal.intend("p", &bite).await.unwrap();
    assert_eq!(
        journal.steps("p").await.unwrap(),
        std::slice::from_ref(&bite)
    );

    procedure.bites_done = 1;
    procedure.robot_seconds = 0.1 + 0.2;
    procedure.step = Some(done(&bite));
    journal
        .end_step(&procedure, &done(&bite), Some(&outcome(0)))
        .await
        .unwrap();
    let retract = step(2, StepKind::Retract, None);
    journal.intend("p", &retract).await.unwrap();
    assert_eq!(
        journal.steps("p").await.unwrap(),
        [done(&bite), retract.clone()]
    );
    assert_eq!(journal.bite_outcomes("p").await.unwrap(), [outcome(0)]);
    procedure.step = Some(retract);
    assert_eq!(
        journal.procedure("p").await.unwrap().as_ref(),
        Some(&procedure)
    );
    assert_eq!(
        journal.procedures(&page(None, 9)).await.unwrap(),
        [procedure]
    );
}

async fn an_end_of_a_step_is_written_whole_or_not_at_all(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    let mut procedure = procedure("p", "c");
    journal.create_procedure(&procedure).await.unwrap();
    let bite = step(1, StepKind::Bite, Some(0));
    journal.intend("p", &bite).await.unwrap();
    journal
        .end_step(&procedure, &done(&bite), Some(&outcome(0)))
        .await
        .unwrap();
    // The outcome stands already, so that the second of the three writes is refused.
    let before = journal.procedure("p").await.unwrap();
    procedure.bites_done = 2;
    let mut other = done(&bite);
    other.detail = "another end".to_owned();
    let again = journal
        .end_step(&procedure, &other, Some(&outcome(0)))
        .await;
    assert!(matches!(again, Err(JournalError::Database(_))), "{again:?}");
    assert_eq!(journal.procedure("p").await.unwrap(), before);
    assert_eq!(journal.steps("p").await.unwrap(), [done(&bite)]);
}

async fn an_operation_id_is_used_once(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    journal
        .create_procedure(&procedure("p", "c"))
        .await
        .unwrap();
    journal
        .intend("p", &step(1, StepKind::Bite, Some(0)))
        .await
        .unwrap();
    let mut again = step(2, StepKind::Bite, Some(0));
    again.operation_id = step(1, StepKind::Bite, Some(0)).operation_id;
    assert!(journal.intend("p", &again).await.is_err());
    assert_eq!(journal.steps("p").await.unwrap().len(), 1);
}

async fn whoever_opens_it_is_in_command_with_an_epoch_that_grows(store: Store) {
    let mut journal = store.open().await;
    for epoch in 1..=3 {
        assert_eq!(*journal.duty().borrow(), Duty::InCommand { epoch });
        journal = store.reopen(journal).await;
    }
}

async fn whoever_gave_command_up_cannot_write(store: Store) {
    let journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    journal.leave().await.unwrap();
    let written = journal.create_case(&case("d")).await;
    assert!(
        matches!(&written, Err(JournalError::NotInCommand { holder }) if holder.is_empty()),
        "{written:?}"
    );
    assert_eq!(journal.cases(&page(None, 9)).await.unwrap(), [case("c")]);
}

async fn a_procedure_of_no_case_is_refused(store: Store) {
    let journal = store.open().await;
    assert!(
        journal
            .create_procedure(&procedure("p", "none"))
            .await
            .is_err()
    );
    assert!(journal.procedures(&page(None, 9)).await.unwrap().is_empty());
}
