//! A pause inside the knee, and a motion service that is killed with both tools inside: what the operator is
//! told, and that the tools come out along their shafts.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::process::Stdio;
use std::time::Duration;

use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    GetRecoveryRequest, GetRecoveryResponse, PauseProcedureRequest, Procedure, ProcedureState,
    RecoverProcedureRequest, RecoveryAction, ResumeProcedureRequest, StartProcedureRequest,
    StepKind, StepState, WatchProcedureRequest,
};
use arthro_proto::simulator::v1::{GetAccountRequest, GetAccountResponse};
use arthro_tests::Cell;
use arthro_tests::cell::{arthro, signal};
use tokio::process::{Child, Command};
use tonic::transport::Channel;

/// Wall time for what a service does when it comes up.
const PATIENCE: Duration = Duration::from_secs(60);
/// Between two questions.
const PERIOD: Duration = Duration::from_millis(200);

type Client = ProcedureServiceClient<Channel>;

async fn watch_until(
    client: &mut Client,
    procedure_id: &str,
    until: impl Fn(&Procedure) -> bool,
) -> Procedure {
    let request = WatchProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        ..Default::default()
    };
    let watched = client.watch_procedure(request).await;
    let mut states = watched.expect("it can be watched").into_inner();
    let mut last = None;
    while let Some(message) = states.message().await.expect("the stream goes on") {
        let procedure = message.procedure.expect("a procedure");
        if until(&procedure) {
            return procedure;
        }
        last = Some(procedure);
    }
    panic!("the procedure ended before that: {last:?}");
}

fn in_step(procedure: &Procedure, kind: StepKind, bites_done: u32) -> bool {
    let step = procedure.step.as_ref();
    let under_way = |step: &arthro_proto::gateway::v1::Step| {
        step.kind() == kind && step.state() == StepState::Intended
    };
    procedure.bites_done >= bites_done && step.is_some_and(under_way)
}

/// Asks until the answer is as wanted.
async fn recovery_until(
    client: &mut Client,
    procedure_id: &str,
    wanted: impl Fn(&GetRecoveryResponse) -> bool,
) -> GetRecoveryResponse {
    let asking = async {
        loop {
            let request = GetRecoveryRequest {
                procedure_id: procedure_id.to_owned(),
            };
            let answer = client.get_recovery(request).await;
            let recovery = answer.expect("it is answered").into_inner();
            if wanted(&recovery) {
                return recovery;
            }
            tokio::time::sleep(PERIOD).await;
        }
    };
    tokio::time::timeout(PATIENCE, asking)
        .await
        .expect("the devices answer")
}

async fn account(cell: &Cell) -> GetAccountResponse {
    let mut referee = cell.referee().await;
    let account = referee.get_account(GetAccountRequest {}).await;
    account.expect("the referee answers").into_inner()
}

/// The motion service again, at the address that the gateway knows.
fn restarted_motion(cell: &Cell) -> Child {
    let address = cell.url("motion").trim_start_matches("http://");
    Command::new(arthro())
        .args(["serve", "motion", "--listen", address, "--config"])
        .arg(&cell.at.config)
        .stdout(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .expect("motion starts")
}

#[tokio::test]
async fn a_pause_inside_goes_on_and_tools_that_motion_forgot_inside_come_out() {
    let cell = Cell::up_with(&["--time-scale", "10"]).await;
    let (case_id, plan_digest) = cell.approved_case().await;
    let mut procedures = cell.procedures().await;
    let request = StartProcedureRequest {
        case_id,
        plan_digest,
        operator: "test".to_owned(),
    };
    let started = procedures.start_procedure(request).await;
    let started = started.expect("it starts").into_inner();
    let id = started.procedure.expect("a procedure").procedure_id;

    watch_until(&mut procedures, &id, |procedure| {
        in_step(procedure, StepKind::Insert, 0)
    })
    .await;
    let pause = PauseProcedureRequest {
        procedure_id: id.clone(),
    };
    procedures
        .pause_procedure(pause)
        .await
        .expect("it is taken");
    let paused = watch_until(&mut procedures, &id, |procedure| {
        procedure.state() == ProcedureState::Paused
    })
    .await;
    assert_eq!(account(&cell).await.bites, 0, "{paused:?}");
    let resume = ResumeProcedureRequest {
        procedure_id: id.clone(),
        acknowledge: true,
    };
    procedures
        .resume_procedure(resume)
        .await
        .expect("the arms stand where they stood");

    watch_until(&mut procedures, &id, |procedure| {
        in_step(procedure, StepKind::Retract, 1)
    })
    .await;
    signal(cell.at.processes["motion"], "KILL").await;
    let interrupted = watch_until(&mut procedures, &id, |procedure| {
        procedure.state() == ProcedureState::Interrupted
    })
    .await;
    assert_eq!(interrupted.bites_done, 1, "{interrupted:?}");
    let blind = recovery_until(&mut procedures, &id, |recovery| {
        !recovery.unanswered.is_empty()
    })
    .await;
    assert!(blind.arms.is_empty());

    let motion = restarted_motion(&cell);
    let recovery = recovery_until(&mut procedures, &id, |recovery| {
        let mut arms = recovery.arms.iter();
        recovery.arms.len() == 2 && arms.all(|arm| arm.connected && arm.stood.is_some())
    })
    .await;
    assert!(
        recovery.arms.iter().all(|arm| !arm.has_portal),
        "{recovery:?}"
    );
    assert!(
        recovery.arms.iter().any(|arm| arm.depth_mm > 0.0),
        "a tool is inside: {recovery:?}"
    );
    assert!(recovery.arms.iter().all(|arm| arm.off_portal_mm < 1.0));
    let tissue = recovery.tissue.expect("the plan has figures");
    assert!(0.0 < tissue.removed_mm3 && tissue.removed_mm3 < tissue.planned_mm3);

    let decided = RecoverProcedureRequest {
        procedure_id: id.clone(),
        action: RecoveryAction::Withdraw.into(),
        operator: "test".to_owned(),
        acknowledge: true,
        recover_faults: true,
    };
    procedures
        .recover_procedure(decided)
        .await
        .expect("the operator decides");
    let over = watch_until(&mut procedures, &id, |procedure| {
        matches!(
            procedure.state(),
            ProcedureState::Aborted | ProcedureState::Interrupted
        )
    })
    .await;
    assert_eq!(over.state(), ProcedureState::Aborted, "{over:?}");
    let account = account(&cell).await;
    assert_eq!(account.bites + account.empty_bites, 1);
    assert!(account.collisions.is_empty(), "{:?}", account.collisions);
    assert!(account.shafts.iter().all(|shaft| shaft.rcm_max_mm <= 0.5));
    drop(motion);
    cell.teardown().await;
}
