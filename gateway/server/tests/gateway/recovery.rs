//! What an operator is told after an interruption, and what each decision needs.

use arthro_geometry::Vector3;
use arthro_proto::gateway::v1::{self as proto, ProcedureState, RecoveryAction, StepState};
use arthro_proto::instrument::v1::JawState;

use super::bench::{Bench, decision, reason};

/// Stopped in the middle of the first command of this name.
async fn stopped_in(bench: &mut Bench, command: &str) -> String {
    bench.world.hold(command);
    let procedure_id = bench.started().await;
    bench.world.arrived(command, 1).await;
    let stop = proto::StopProcedureRequest::default();
    bench.procedures.stop_procedure(stop).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    bench.world.let_go();
    procedure_id
}

fn choice(recovery: &proto::GetRecoveryResponse, action: RecoveryAction) -> proto::RecoveryChoice {
    let mut choices = recovery.choices.iter();
    choices
        .find(|choice| choice.action() == action)
        .unwrap()
        .clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_operator_is_told_pose_depth_jaw_and_what_is_in_doubt() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "BITE").await;
    let recovery = bench.recovery(&procedure_id).await;
    assert!(recovery.in_doubt);
    assert!(recovery.unanswered.is_empty(), "{:?}", recovery.unanswered);
    let drives = recovery.drives.clone().unwrap();
    assert_eq!(drives.jaw, "UNKNOWN");
    let forceps = bench.world.arms.lock().unwrap()[0];
    let told = &recovery.arms[0];
    assert!((told.depth_mm - forceps.depth_mm().unwrap()).abs() < 1e-6);
    assert!(told.depth_mm > 1.0 && told.off_portal_mm < 1e-6 && told.has_portal);
    let tip = told.base_from_tool.unwrap().translation.unwrap();
    assert!((tip.x_mm - forceps.tip.x).abs() < 1e-9);
    for action in [
        RecoveryAction::Withdraw,
        RecoveryAction::RepeatBite,
        RecoveryAction::MarkDone,
    ] {
        let choice = choice(&recovery, action);
        assert!(choice.allowed, "{choice:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn no_decision_is_taken_without_somebody_who_has_looked() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "BITE").await;
    let before = bench.world.commands();
    for action in [
        RecoveryAction::Withdraw,
        RecoveryAction::RepeatBite,
        RecoveryAction::MarkDone,
    ] {
        let decided = bench.decide(decision(&procedure_id, action)).await;
        assert_eq!(reason(decided), "ACKNOWLEDGEMENT_NEEDED");
    }
    assert_eq!(bench.world.commands(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn beyond_the_tolerance_only_a_withdrawal_is_open() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "INSERT FORCEPS").await;
    bench.recovery(&procedure_id).await;
    bench.world.arms.lock().unwrap()[1].tip += Vector3::new(0.0, 0.0, 2.0);
    let recovery = bench.recovery(&procedure_id).await;
    let repeat = choice(&recovery, RecoveryAction::RepeatBite);
    assert_eq!(
        (repeat.allowed, repeat.reason.as_str()),
        (false, "POSE_MOVED")
    );
    assert!(choice(&recovery, RecoveryAction::Withdraw).allowed);
    assert!((recovery.arms[1].moved_mm - 2.0).abs() < 1e-6);
    for action in [RecoveryAction::RepeatBite, RecoveryAction::MarkDone] {
        let decided = bench.recover(&procedure_id, action).await;
        assert_eq!(reason(decided), "POSE_MOVED");
    }
    bench.world.arms.lock().unwrap()[1].tip -= Vector3::new(0.0, 0.0, 2.0);
    bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
        .unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_gateway_that_takes_over_remembers_where_the_arms_stood() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "INSERT FORCEPS").await;
    let stood = bench.recovery(&procedure_id).await.arms[0].stood;
    bench.kill().await;
    bench.world.arms.lock().unwrap()[0].tip += Vector3::new(0.0, 5.0, 0.0);
    bench.restart(|_| {}).await;
    let recovery = bench.recovery(&procedure_id).await;
    assert_eq!(recovery.arms[0].stood, stood);
    assert!((recovery.arms[0].moved_mm - 5.0).abs() < 1e-6);
    let decided = bench.recover(&procedure_id, RecoveryAction::MarkDone).await;
    assert_eq!(reason(decided), "POSE_MOVED");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_latched_fault_is_acknowledged_by_the_operators_word_alone() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "INSERT FORCEPS").await;
    bench.world.arms.lock().unwrap()[0].faulty = true;
    *bench.world.drives_faulty.lock().unwrap() = true;
    let recovery = bench.recovery(&procedure_id).await;
    assert_eq!(recovery.arms[0].fault_reason, "PROTECTIVE_STOP");
    assert_eq!(recovery.drives.clone().unwrap().faults.len(), 1);
    assert!(choice(&recovery, RecoveryAction::RepeatBite).needs_recover_faults);

    let decided = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert_eq!(reason(decided), "FAULT_LATCHED");
    assert_eq!(bench.world.count("RECOVER_FAULT FORCEPS"), 0);

    let decided = proto::RecoverProcedureRequest {
        acknowledge: true,
        recover_faults: true,
        ..decision(&procedure_id, RecoveryAction::RepeatBite)
    };
    bench.decide(decided).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("RECOVER_FAULT FORCEPS"), 1);
    assert_eq!(bench.world.count("RECOVER_FAULT ARTHROSCOPE"), 0);
    assert_eq!(bench.world.count("RECOVER_FAULT DRIVES"), 1);
    assert_eq!(bench.world.count("BITE"), 3);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_motion_service_that_forgot_its_portals_is_told_them_before_anything_moves() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "BITE").await;
    for arm in &mut *bench.world.arms.lock().unwrap() {
        arm.portal = None;
    }
    let recovery = bench.recovery(&procedure_id).await;
    let forceps = &recovery.arms[0];
    assert!(!forceps.has_portal && forceps.depth_mm > 1.0);
    let before = bench.world.commands().len();
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
    assert_eq!(
        bench.world.commands()[before..before + 4],
        [
            "SET_PORTAL FORCEPS",
            "SET_PORTAL ARTHROSCOPE",
            "RETRACT FORCEPS",
            "RETRACT ARTHROSCOPE"
        ]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_shaft_that_does_not_pass_the_calibrated_portal_is_not_drawn_back_through_it() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "BITE").await;
    {
        let mut arms = bench.world.arms.lock().unwrap();
        let across = arms[0].rotation * Vector3::y() * 8.0;
        arms[0].tip += across;
        arms[0].portal = None;
    }
    let before = bench.world.commands();
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "SHAFT_OFF_PORTAL");
    assert!(
        procedure
            .detail
            .contains("passes it at 8.00 mm; limit 5 mm"),
        "{}",
        procedure.detail
    );
    assert_eq!(bench.world.commands(), before);
}

#[tokio::test(flavor = "multi_thread")]
async fn drives_without_a_reference_find_it_over_the_tray_and_not_inside() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "BITE").await;
    *bench.world.homed.lock().unwrap() = false;
    let before = bench.world.commands().len();
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
    assert_eq!(
        bench.world.commands()[before..],
        [
            "RETRACT FORCEPS",
            "RETRACT ARTHROSCOPE",
            "FREE FORCEPS",
            "HOME",
            "OPEN_JAW",
            "FREE ARTHROSCOPE"
        ]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bite_that_was_over_before_the_stop_came_is_done_and_not_in_doubt() {
    let mut bench = Bench::new().await;
    let procedure_id = stopped_in(&mut bench, "RETRACT FORCEPS").await;
    let report = bench.report(&procedure_id).await;
    let bites: Vec<_> = report
        .steps
        .iter()
        .filter(|step| step.kind() == proto::StepKind::Bite)
        .map(proto::Step::state)
        .collect();
    assert_eq!(bites, [StepState::Done]);
    assert_eq!(report.bites.len(), 1);
    assert_eq!(*bench.world.jaw.lock().unwrap(), JawState::Unknown);
    let recovery = bench.recovery(&procedure_id).await;
    assert!(!recovery.in_doubt);
    bench
        .recover(&procedure_id, RecoveryAction::MarkDone)
        .await
        .unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(bench.world.count("BITE"), 3);
}
