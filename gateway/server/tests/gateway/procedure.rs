//! Procedures: in order, journalled first, held, ended, refused.

use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::{ProcedureState, RecoveryAction, StepKind, StepState};

use super::bench::{Bench, arthroscope_in_forceps_base, direction_in_base, in_base, reason};
use super::fakes::PATIENCE;
use super::fakes::computing::CENTERS;

const PREPARATION: [&str; 6] = [
    "HOME",
    "SET_PORTAL FORCEPS",
    "SET_PORTAL ARTHROSCOPE",
    "FREE FORCEPS",
    "OPEN_JAW",
    "FREE ARTHROSCOPE",
];
const FIRST_VIEW: [&str; 2] = ["PIVOT ARTHROSCOPE", "INSERT ARTHROSCOPE"];
const NEAR_VIEW: [&str; 2] = ["RETRACT ARTHROSCOPE", "PIVOT ARTHROSCOPE"];
const FAR_VIEW: [&str; 3] = [
    "RETRACT ARTHROSCOPE",
    "PIVOT ARTHROSCOPE",
    "INSERT ARTHROSCOPE",
];
const CYCLE: [&str; 9] = [
    "FREE FORCEPS",
    "PIVOT FORCEPS",
    "TURN",
    "INSERT FORCEPS",
    "BITE",
    "RETRACT FORCEPS",
    "PIVOT FORCEPS",
    "FREE FORCEPS",
    "OPEN_JAW",
];
const WITHDRAWAL: [&str; 2] = ["RETRACT ARTHROSCOPE", "FREE ARTHROSCOPE"];

#[tokio::test(flavor = "multi_thread")]
async fn a_procedure_takes_every_bite_in_order_and_journals_before_each_command() {
    let mut bench = Bench::new().await;
    let procedure_id = bench.started().await;
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;

    let mut expected = PREPARATION.to_vec();
    expected.extend(FIRST_VIEW);
    expected.extend(CYCLE);
    // The second is watched from nearby and a little less deep, the third from farther away.
    for view in [&NEAR_VIEW[..], &FAR_VIEW] {
        expected.extend(view);
        expected.extend(CYCLE);
    }
    expected.extend(WITHDRAWAL);
    assert_eq!(bench.world.commands(), expected);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
    assert_eq!((procedure.bites_done, procedure.bites_planned), (3, 3));
    assert_eq!(procedure.rcm_deviation_max_mm, 0.25);
    // The stand-in's clock counts commands; the first step began before any.
    assert_eq!(procedure.robot_seconds, expected.len() as f64);

    let report = bench.report(&procedure_id).await;
    assert_eq!(report.steps.len(), 1 + 3 * 9 + 1);
    for (sequence, step) in (1..).zip(&report.steps) {
        assert_eq!((step.sequence, step.state()), (sequence, StepState::Done));
        assert!(step.ended_controller_s >= step.started_controller_s);
    }
    assert_eq!(report.bites.len(), 3);
    assert_eq!(report.bites[2].jaw, "CLOSED_ON_TISSUE");
    assert_eq!(report.bites[2].peak_current_ma, 420.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_jaw_closes_at_each_bite_and_opens_along_it() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;

    let plan = bench.get(&case_id).await.plan.unwrap();
    let tips = bench.world.bitten_at.lock().unwrap().clone();
    let openings = bench.world.bitten_along.lock().unwrap().clone();
    for (bite, center) in CENTERS.iter().enumerate() {
        let off = (tips[bite] - in_base(*center)).norm();
        assert!(off < 1e-6, "bite {bite} is {off} mm off");
        let planned = direction_in_base(&plan.bites[bite].opening.unwrap());
        let along = openings[bite].dot(&planned).abs();
        assert!((along - 1.0).abs() < 1e-6, "bite {bite}: {along}");
    }
    let reported = bench.report(&procedure_id).await.bites[1].tip.unwrap();
    assert!((reported.x_mm - tips[1].x).abs() < 1e-9);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_arthroscope_watches_each_bite_from_its_approved_view() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    let views = bench.get(&case_id).await.plan.unwrap().views;
    let watched_from = bench.world.watched_from.lock().unwrap().clone();
    assert_eq!(watched_from.len(), views.len());
    for (bite, (view, tip)) in views.iter().zip(watched_from).enumerate() {
        let planned = view.tip.unwrap();
        let planned = in_base([planned.x_mm, planned.y_mm, planned.z_mm]);
        let off = (arthroscope_in_forceps_base(&tip) - planned).norm();
        assert!(off < 1e-6, "bite {bite} is watched from {off} mm aside");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bite_that_is_repeated_is_watched_from_its_view_again() {
    let mut bench = Bench::new().await;
    bench.world.hold("RETRACT ARTHROSCOPE");
    let procedure_id = bench.started().await;
    bench.world.arrived("RETRACT ARTHROSCOPE", 1).await;
    bench.procedures.stop_procedure(stop()).await.unwrap();
    let interrupted = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    let step = interrupted.step.unwrap();
    assert_eq!(
        (step.kind(), step.state(), step.bite),
        (StepKind::View, StepState::Failed, 1)
    );
    bench.world.let_go();
    bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await
        .unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    let watched_from = bench.world.watched_from.lock().unwrap().clone();
    assert_eq!(watched_from.len(), 3);
    assert!((watched_from[1] - watched_from[0]).norm() > 0.5);
    assert!(bench.world.unjournalled.lock().unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn without_approval_nothing_starts() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.planned().await;
    assert_eq!(reason(bench.start(&case_id, &digest).await), "NOT_APPROVED");
    assert!(bench.world.commands().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_edited_after_its_approval_does_not_start() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let mut bites = bench.get(&case_id).await.plan.unwrap().bites;
    bites.pop();
    let revised = bench
        .cases
        .revise_plan(proto::RevisePlanRequest {
            case_id: case_id.clone(),
            bites,
        })
        .await
        .unwrap()
        .into_inner();
    assert_eq!(revised.evaluation.unwrap().bites, 2);
    let case = revised.case.unwrap();
    assert_eq!(case.state(), proto::CaseState::Planned);
    assert!(case.approved_by.is_empty());
    assert_eq!(
        reason(bench.start(&case_id, &digest).await),
        "APPROVAL_VOID"
    );
    let edited = bench.start(&case_id, &case.plan_digest).await;
    assert_eq!(reason(edited), "NOT_APPROVED");
    assert!(bench.world.commands().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_procedure_is_refused_while_one_is_open() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    bench.world.hold("BITE");
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    let second = bench.start(&case_id, &digest).await;
    assert_eq!(reason(second), "PROCEDURE_ACTIVE");

    // An interrupted one may have arms inside, so it counts as open too.
    bench.world.arrived("BITE", 1).await;
    bench.procedures.stop_procedure(stop()).await.unwrap();
    bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    let third = bench.start(&case_id, &digest).await;
    assert_eq!(reason(third), "PROCEDURE_ACTIVE");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_target_out_of_reach_is_named_before_anything_moves() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    *bench.world.unreachable.lock().unwrap() = Some((1, "TOO_DEEP"));
    let refusal = bench.start(&case_id, &digest).await.unwrap_err();
    assert!(
        refusal
            .message()
            .contains("bite 1 of the plan cannot be reached: depth is 131 mm"),
        "{refusal:?}"
    );
    assert_eq!(reason::<()>(Err(refusal)), "UNREACHABLE_BITE");
    assert!(bench.world.commands().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_voided_in_mid_procedure_takes_no_further_bite() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let (case_id, digest) = bench.approved().await;
    let procedure_id = bench.start(&case_id, &digest).await.unwrap();
    bench.world.arrived("BITE", 1).await;
    bench.upload(&case_id).await;
    bench.world.let_go();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "APPROVAL_VOID");
    assert_eq!(bench.world.count("BITE"), 1);
    let repeat = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert_eq!(reason(repeat), "APPROVAL_VOID");
    bench
        .recover(&procedure_id, RecoveryAction::Withdraw)
        .await
        .unwrap();
    bench.reaches(&procedure_id, ProcedureState::Aborted).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_reaches_the_devices_while_a_step_is_under_way() {
    let mut bench = Bench::new().await;
    bench.world.hold("INSERT FORCEPS");
    let procedure_id = bench.started().await;
    bench.world.arrived("INSERT FORCEPS", 1).await;
    bench.procedures.stop_procedure(stop()).await.unwrap();
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert!(*bench.world.stops.borrow() >= 2);
    assert_eq!(
        (procedure.reason.as_str(), procedure.detail.as_str()),
        ("STOPPED", "bleeding")
    );
    let step = procedure.step.unwrap();
    assert_eq!(
        (step.kind(), step.state()),
        (StepKind::Insert, StepState::Failed)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_that_comes_while_a_start_is_checked_is_not_lost() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    bench.world.hold("CHECK");
    let mut checks = bench.world.checks.subscribe();
    let mut stopping = bench.procedures.clone();
    let stop = async {
        let checked = checks.wait_for(|checks| *checks > 0);
        tokio::time::timeout(PATIENCE, checked)
            .await
            .unwrap()
            .unwrap();
        stopping.stop_procedure(stop()).await.unwrap();
    };
    let world = bench.world.clone();
    let (started, ()) = tokio::join!(bench.start(&case_id, &digest), async {
        stop.await;
        world.let_go();
    });
    let procedure = bench
        .reaches(&started.unwrap(), ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "STOPPED");
    assert!(bench.world.commands().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_needs_no_procedure() {
    let mut bench = Bench::new().await;
    let stop = proto::StopProcedureRequest {
        wait_for_devices: true,
        ..stop()
    };
    bench.procedures.stop_procedure(stop).await.unwrap();
    assert_eq!(*bench.world.stops.borrow(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn leases_are_renewed_while_a_step_lasts() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    let mut renewals = bench.world.renewals.subscribe();
    let before = *renewals.borrow_and_update();
    let renewed = renewals.wait_for(|renewals| *renewals >= before + 4);
    tokio::time::timeout(PATIENCE, renewed)
        .await
        .unwrap()
        .unwrap();
    bench.world.let_go();
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lost_lease_interrupts_and_leaves_the_bite_in_doubt() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    *bench.world.refuse_renewals.lock().unwrap() = true;
    let procedure = bench
        .reaches(&procedure_id, ProcedureState::Interrupted)
        .await;
    assert_eq!(procedure.reason, "LEASE_EXPIRED");
    assert_eq!(procedure.step.unwrap().state(), StepState::InDoubt);
    assert!(*bench.world.stops.borrow() >= 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_procedure_that_is_over_takes_no_wishes() {
    let mut bench = Bench::new().await;
    let procedure_id = bench.started().await;
    bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(reason(bench.pause(&procedure_id).await), "PROCEDURE_STATE");
    let recovered = bench
        .recover(&procedure_id, RecoveryAction::RepeatBite)
        .await;
    assert_eq!(reason(recovered), "PROCEDURE_STATE");
    // And the next one may start.
    bench.started().await;
}

fn stop() -> proto::StopProcedureRequest {
    proto::StopProcedureRequest {
        reason: "bleeding".to_owned(),
        ..proto::StopProcedureRequest::default()
    }
}
