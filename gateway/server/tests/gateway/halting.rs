//! Pause, resume and abort at any moment of a procedure.

use arthro_gateway::config::PauseMode;
use arthro_geometry::Vector3;
use arthro_proto::gateway::v1::{self as proto, ProcedureState, StepKind, StepState};
use arthro_proto::instrument::v1::JawState;

use super::bench::{Bench, reason};

/// A procedure whose step stands in `command`, the first of this name.
async fn standing_in(bench: &mut Bench, command: &str) -> String {
    bench.world.hold(command);
    let procedure_id = bench.started().await;
    bench.world.arrived(command, 1).await;
    procedure_id
}

/// Paused in the middle of the first insertion.
async fn paused_inside(bench: &mut Bench) -> String {
    let procedure_id = standing_in(bench, "INSERT FORCEPS").await;
    bench.pause(&procedure_id).await.unwrap();
    bench.reaches(&procedure_id, ProcedureState::Paused).await;
    bench.world.let_go();
    procedure_id
}

fn latest(procedure: &proto::Procedure) -> (StepKind, StepState, String) {
    let step = procedure.step.clone().unwrap();
    (step.kind(), step.state(), step.detail)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pause_halts_the_step_under_way_and_a_resume_does_it_again() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    let paused = bench.reaches(&procedure_id, ProcedureState::Paused).await;
    let (kind, state, detail) = latest(&paused);
    assert_eq!((kind, state), (StepKind::Insert, StepState::Failed));
    assert!(detail.starts_with("PAUSED: "), "{detail}");
    assert_eq!(bench.world.commands().last().unwrap(), "INSERT FORCEPS");
    assert_eq!(
        *bench.world.jaw.lock().unwrap(),
        JawState::Open,
        "the drives were left alone"
    );

    bench.resume(&procedure_id).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("INSERT FORCEPS"), 4);
    assert_eq!(bench.world.count("BITE"), 3);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
    let inserts: Vec<_> = bench.report(&procedure_id).await.steps;
    let ids: std::collections::HashSet<_> = inserts.iter().map(|step| &step.operation_id).collect();
    assert_eq!(ids.len(), inserts.len(), "every step has an id of its own");
}

#[tokio::test(flavor = "multi_thread")]
async fn every_reversible_step_can_be_paused_and_done_again() {
    for command in [
        "FREE FORCEPS",
        "FREE ARTHROSCOPE",
        "PIVOT ARTHROSCOPE",
        "INSERT ARTHROSCOPE",
        "PIVOT FORCEPS",
        "INSERT FORCEPS",
        "RETRACT FORCEPS",
    ] {
        let mut bench = Bench::new().await;
        let procedure_id = standing_in(&mut bench, command).await;
        bench.pause(&procedure_id).await.unwrap();
        bench.reaches(&procedure_id, ProcedureState::Paused).await;
        assert_eq!(bench.world.commands().last().unwrap(), command);
        bench.world.let_go();
        bench.resume(&procedure_id).await.unwrap();
        bench
            .reaches(&procedure_id, ProcedureState::Completed)
            .await;
        assert_eq!(bench.world.count("BITE"), 3, "paused in {command}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pause_in_mid_bite_leaves_it_in_doubt() {
    let mut bench = Bench::new().await;
    let procedure_id = standing_in(&mut bench, "BITE").await;
    bench.pause(&procedure_id).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "BITE_HALTED");
    let (kind, state, _) = latest(&procedure);
    assert_eq!((kind, state), (StepKind::Bite, StepState::InDoubt));
    assert_eq!(procedure.bites_done, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_in_mid_bite_leaves_it_in_doubt_and_retreats_only_on_decision() {
    let mut bench = Bench::new().await;
    let procedure_id = standing_in(&mut bench, "BITE").await;
    bench.abort(&procedure_id).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "BITE_HALTED");
    assert_eq!(latest(&procedure).1, StepState::InDoubt);
    assert_eq!(bench.world.commands().last().unwrap(), "BITE");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_resume_needs_somebody_who_has_looked() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    let before = bench.world.commands();
    let request = proto::ResumeProcedureRequest {
        procedure_id: procedure_id.clone(),
        ..proto::ResumeProcedureRequest::default()
    };
    let resumed = bench.procedures.resume_procedure(request).await;
    assert_eq!(reason(resumed), "ACKNOWLEDGEMENT_NEEDED");
    assert_eq!(bench.world.commands(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_arm_that_was_moved_in_the_pause_does_not_go_on_from_elsewhere() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    let before = bench.world.commands();
    let shift = |bench: &Bench, mm: f64| {
        bench.world.arms.lock().unwrap()[1].tip += Vector3::new(0.0, 0.0, mm);
    };
    shift(&bench, 1.2);
    let refusal = bench.resume(&procedure_id).await.unwrap_err();
    assert!(
        refusal.message().contains(
            "the ARTHROSCOPE is 1.20 mm and 0.00 deg from where it stood; limits 1 mm and 1 deg"
        ),
        "{refusal:?}"
    );
    assert_eq!(reason::<()>(Err(refusal)), "POSE_MOVED");
    assert_eq!(bench.world.commands(), before);

    shift(&bench, -1.2);
    bench.resume(&procedure_id).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_after_a_move_by_hand_does_not_make_the_new_place_the_old_one() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    bench.world.arms.lock().unwrap()[0].tip += Vector3::new(0.0, 3.0, 0.0);
    let stop = proto::StopProcedureRequest::default();
    bench.procedures.stop_procedure(stop).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    let repeated = bench
        .recover(&procedure_id, proto::RecoveryAction::RepeatBite)
        .await;
    assert_eq!(reason(repeated), "POSE_MOVED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_paused_procedure_does_not_resume_with_another_plan() {
    let mut bench = Bench::new().await;
    bench.world.hold("INSERT FORCEPS");
    let (case_id, digest) = bench.approved().await;
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench.world.arrived("INSERT FORCEPS", 1).await;
    bench.pause(&procedure_id).await.unwrap();
    bench.reaches(&procedure_id, ProcedureState::Paused).await;
    bench.world.let_go();
    bench.register(&case_id).await;
    let resumed = bench.resume(&procedure_id).await;
    assert_eq!(reason(resumed), "APPROVAL_VOID");

    bench.abort(&procedure_id).await.unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pause_that_retracts_leaves_both_arms_outside_and_the_bite_begins_anew() {
    let mut bench = Bench::with(|config| config.pause = PauseMode::Retract).await;
    let procedure_id = paused_inside(&mut bench).await;
    let paused = bench.reaches(&procedure_id, ProcedureState::Paused).await;
    let (kind, state, _) = latest(&paused);
    assert_eq!((kind, state), (StepKind::Retract, StepState::Done));
    let depths = bench
        .world
        .arms
        .lock()
        .unwrap()
        .map(|arm| arm.depth_mm().unwrap());
    assert!(depths.iter().all(|depth| *depth < 0.0), "{depths:?}");

    bench.resume(&procedure_id).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 3);
    let bitten_at = bench.world.bitten_at.lock().unwrap().clone();
    assert_eq!(bitten_at.len(), 3);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pause_that_retracts_does_not_repeat_a_bite_that_was_taken() {
    let mut bench = Bench::with(|config| config.pause = PauseMode::Retract).await;
    let procedure_id = standing_in(&mut bench, "RETRACT FORCEPS").await;
    bench.pause(&procedure_id).await.unwrap();
    bench.world.arrived("RETRACT FORCEPS", 2).await;
    bench.world.let_go();
    bench.reaches(&procedure_id, ProcedureState::Paused).await;
    bench.resume(&procedure_id).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 3);
    assert_eq!(bench.world.watched_from.lock().unwrap().len(), 3);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_halts_the_step_retreats_along_the_shaft_and_withdraws_both_arms() {
    let mut bench = Bench::new().await;
    let procedure_id = standing_in(&mut bench, "INSERT FORCEPS").await;
    bench.abort(&procedure_id).await.unwrap();
    let procedure = bench.reaches(&procedure_id, ProcedureState::Aborted).await;
    assert_eq!(procedure.bites_done, 0);
    let commands = bench.world.commands();
    let after = commands
        .iter()
        .position(|command| command == "INSERT FORCEPS")
        .unwrap()
        + 1;
    assert_eq!(
        commands[after..],
        [
            "RETRACT FORCEPS",
            "RETRACT ARTHROSCOPE",
            "FREE FORCEPS",
            "OPEN_JAW",
            "FREE ARTHROSCOPE"
        ]
    );
    let steps = bench.report(&procedure_id).await.steps;
    let halted = steps
        .iter()
        .find(|step| step.kind() == StepKind::Insert)
        .unwrap();
    assert_eq!(halted.state(), StepState::Failed);
    assert!(halted.detail.starts_with("ABORTED: "), "{}", halted.detail);
    let arms = bench.world.arms.lock().unwrap();
    assert!(arms.iter().all(|arm| arm.depth_mm().unwrap() < 0.0));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_of_a_pause_retreats() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    bench.abort(&procedure_id).await.unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
    assert_eq!(bench.world.count("BITE"), 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_with_a_jaw_that_nobody_knows_holds_and_says_why() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    *bench.world.jaw.lock().unwrap() = JawState::Unknown;
    let before = bench.world.commands();
    bench.abort(&procedure_id).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "ABORT_UNSAFE");
    assert!(
        procedure.detail.contains("its jaw is UNKNOWN"),
        "{}",
        procedure.detail
    );
    assert_eq!(bench.world.commands(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abort_with_a_latched_fault_holds_and_names_it() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    bench.world.arms.lock().unwrap()[1].faulty = true;
    bench.abort(&procedure_id).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "ABORT_UNSAFE");
    assert!(
        procedure.detail.contains("ARTHROSCOPE PROTECTIVE_STOP"),
        "{}",
        procedure.detail
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_overtakes_a_pause_and_nothing_undoes_it() {
    let mut bench = Bench::new().await;
    let procedure_id = paused_inside(&mut bench).await;
    let stop = proto::StopProcedureRequest::default();
    bench.procedures.stop_procedure(stop).await.unwrap();
    for refused in [
        bench.resume(&procedure_id).await,
        bench.abort(&procedure_id).await,
        bench.pause(&procedure_id).await,
    ] {
        assert_eq!(reason(refused), "PROCEDURE_STATE");
    }
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "STOPPED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wish_is_acknowledged_while_the_journal_is_stuck() {
    let mut bench = Bench::new().await;
    let procedure_id = standing_in(&mut bench, "INSERT FORCEPS").await;
    // Somebody else holds the write lock of the database: no step can be ended or intended.
    let stuck = bench.world.lock_journal().await;
    let all = async {
        bench.pause(&procedure_id).await.unwrap();
        bench.abort(&procedure_id).await.unwrap();
        let stop = proto::StopProcedureRequest::default();
        bench.procedures.stop_procedure(stop).await.unwrap();
    };
    tokio::time::timeout(std::time::Duration::from_secs(4), all)
        .await
        .expect("the wishes are answered before the journal gives up waiting");
    drop(stuck);
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "STOPPED");
}
