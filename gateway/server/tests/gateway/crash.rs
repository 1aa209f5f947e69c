//! The gateway killed in the middle, and started again on the same journal.

use arthro_bootstrap::{Drain, Service as _};
use arthro_gateway::Config;
use arthro_proto::gateway::v1::{CaseState, ProcedureState, RecoveryAction, StepKind, StepState};

use super::bench::{Bench, reason};

/// Killed while the jaw of the first bite closes, and started again.
async fn killed_in_mid_bite() -> (Bench, String) {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    bench.kill().await;
    bench.world.let_go();
    bench.restart(|_| {}).await;
    (bench, procedure_id)
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_kill_in_mid_bite_the_bite_is_in_doubt_and_nothing_moves() {
    let (mut bench, procedure_id) = killed_in_mid_bite().await;
    let before = bench.world.commands();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "GATEWAY_RESTARTED");
    let step = procedure.step.unwrap();
    assert_eq!(
        (step.kind(), step.state(), step.bite),
        (StepKind::Bite, StepState::InDoubt, 0)
    );
    assert_eq!(bench.world.commands(), before);
    assert_eq!(bench.world.commands().last().unwrap(), "BITE");
}

#[tokio::test(flavor = "multi_thread")]
async fn marking_the_bite_done_goes_on_with_the_next_after_a_retract() {
    let (mut bench, procedure_id) = killed_in_mid_bite().await;
    let before = bench.world.commands().len();
    bench
        .recover(&procedure_id, RecoveryAction::MarkDone)
        .await
        .unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(procedure.bites_done, 3);
    assert_eq!(bench.world.count("BITE"), 3);
    let commands = bench.world.commands();
    assert_eq!(
        commands[before..before + 2],
        ["RETRACT FORCEPS", "RETRACT ARTHROSCOPE"]
    );
    let report = bench.report(&procedure_id).await;
    let bite = report
        .steps
        .iter()
        .find(|step| step.kind() == StepKind::Bite)
        .unwrap();
    assert_eq!(bite.state(), StepState::Resolved);
    assert!(
        bite.detail.starts_with("MARK_DONE by operator"),
        "{}",
        bite.detail
    );
    assert_eq!(report.bites.len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn repeating_takes_the_bite_in_doubt_again() {
    let (mut bench, procedure_id) = killed_in_mid_bite().await;
    bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
        .unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 4);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn withdrawing_leaves_the_bite_in_doubt_on_record() {
    let (mut bench, procedure_id) = killed_in_mid_bite().await;
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    let procedure = bench.reaches(&procedure_id, ProcedureState::Aborted).await;
    assert_eq!(procedure.bites_done, 0);
    assert_eq!(bench.world.count("BITE"), 1);
    let report = bench.report(&procedure_id).await;
    assert!(
        report
            .steps
            .iter()
            .any(|step| step.state() == StepState::InDoubt)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_calibration_changed_over_a_restart_voids_the_approval() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    bench.kill().await;
    bench.world.let_go();
    bench
        .restart(|config| {
            config.calibration.as_mut().unwrap().forceps_portal_mm[2] += 0.001;
        })
        .await;
    let recovered = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert_eq!(reason(recovered), "APPROVAL_VOID");
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restart_loses_no_case() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let before = bench.get(&case_id).await;
    bench.kill().await;
    bench.restart(|_| {}).await;
    let after = bench.get(&case_id).await;
    assert_eq!(before, after);
    assert_eq!(after.case.unwrap().state(), CaseState::Approved);
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recovery_killed_in_turn_can_be_recovered() {
    let (mut bench, procedure_id) = killed_in_mid_bite().await;
    bench.world.hold("RETRACT ARTHROSCOPE");
    bench
        .recover(&procedure_id, RecoveryAction::MarkDone)
        .await
        .unwrap();
    bench.world.arrived("RETRACT ARTHROSCOPE", 1).await;
    bench.kill().await;
    bench.world.let_go();
    bench.restart(|_| {}).await;
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.bites_done, 1);
    // Bite 1 was not begun, so it cannot be held as done.
    let mark = bench.recover(&procedure_id, RecoveryAction::MarkDone).await;
    assert_eq!(reason(mark), "NO_BITE_INTERRUPTED");
    bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
        .unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 3);
}

async fn start_error(config: Config) -> String {
    let error = arthro_gateway::Server::build(config, Drain::never())
        .await
        .expect_err("the gateway does not start");
    arthro_gateway::error::chain(&*error)
}

fn journal_at(path: std::path::PathBuf) -> Config {
    Config {
        journal: path.into(),
        ..Config::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_in_use_keeps_a_second_gateway_from_starting() {
    let folder = tempfile::tempdir().unwrap();
    let config = journal_at(folder.path().join("gateway.sqlite"));
    let _first = arthro_gateway::Server::build(config.clone(), Drain::never())
        .await
        .unwrap();
    let error = start_error(config).await;
    assert!(error.ends_with("is in use by another gateway"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_corrupt_journal_is_named_at_the_start_and_left_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("gateway.sqlite");
    let garbage = vec![0xA5; 8192];
    std::fs::write(&path, &garbage).unwrap();
    let error = start_error(journal_at(path.clone())).await;
    assert!(error.contains("cannot be opened"), "{error}");
    assert!(error.contains("file is not a database"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), garbage);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_that_cannot_be_written_is_named_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("absent").join("gateway.sqlite");
    let error = start_error(journal_at(path)).await;
    assert!(error.contains("cannot be written"), "{error}");
}
