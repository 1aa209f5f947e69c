//! After a crash of the gateway nothing resumes by itself.
#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

use std::process::Stdio;

use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::gateway::v1::{
    GetReportRequest, Procedure, ProcedureState, RecoverProcedureRequest, RecoveryAction,
    StartProcedureRequest, StepKind, StepState, WatchProcedureRequest,
};
use arthro_proto::motion::v1::WatchStateRequest;
use arthro_proto::simulator::v1::GetAccountRequest;
use arthro_tests::Cell;
use arthro_tests::cell::{arthro, signal};
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tonic::transport::Channel;

/// Starts of a gateway before the killed one's hold on the journal must be gone.
const STARTS: usize = 50;

/// A gateway on the state of one that was killed. A killed process ends a moment after the signal was sent; until then
/// its journal is in use, and a second gateway refuses to start.
async fn restarted_gateway(cell: &Cell) -> (Child, ProcedureServiceClient<Channel>) {
    for _ in 0..STARTS {
        let mut process = Command::new(arthro())
            .args(["serve", "gateway", "--listen", "127.0.0.1:0", "--config"])
            .arg(&cell.at.config)
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()
            .expect("the gateway starts");
        let mut line = String::new();
        let stdout = process.stdout.take().expect("standard output is piped");
        BufReader::new(stdout)
            .read_line(&mut line)
            .await
            .expect("standard output is read");
        if line.is_empty() {
            process.wait().await.expect("the gateway ended");
            continue;
        }
        let announced: serde_json::Value = serde_json::from_str(&line).expect("an announcement");
        let address = announced["address"].as_str().expect("an address");
        let client = ProcedureServiceClient::connect(format!("http://{address}"))
            .await
            .expect("the gateway is reached");
        return (process, client);
    }
    panic!("the gateway did not start in {STARTS} tries");
}

/// Watches until `until` holds of the procedure.
async fn watch_until(
    client: &mut ProcedureServiceClient<Channel>,
    procedure_id: &str,
    until: impl Fn(&Procedure) -> bool,
) -> Procedure {
    let request = WatchProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        ..WatchProcedureRequest::default()
    };
    let mut states = client
        .watch_procedure(request)
        .await
        .expect("the procedure can be watched")
        .into_inner();
    while let Some(message) = states.message().await.expect("the stream goes on") {
        let procedure = message.procedure.expect("a procedure");
        if until(&procedure) {
            return procedure;
        }
    }
    panic!("the procedure ended before that");
}

/// Whether an arm moved within `seconds` of controller time.
async fn anything_moves(cell: &Cell, seconds: f64) -> bool {
    let mut motion = cell.motion().await;
    let request = WatchStateRequest { period_s: 0.1 };
    let mut states = motion
        .watch_state(request)
        .await
        .expect("the arms can be watched")
        .into_inner();
    let mut first = None;
    loop {
        let state = states.message().await.expect("the stream goes on");
        let arms = state.expect("a state").arms;
        let (joints, time_s): (Vec<f64>, f64) = (
            arms.iter().flat_map(|arm| arm.joints_rad.clone()).collect(),
            arms[0].controller_time_s,
        );
        let (began_s, at_first) = first.get_or_insert_with(|| (time_s, joints.clone()));
        let moved = joints
            .iter()
            .zip(at_first.iter())
            .any(|(now, then): (&f64, &f64)| (now - then).abs() > 1e-3);
        if moved || time_s - *began_s > seconds {
            return moved;
        }
    }
}

#[tokio::test]
async fn a_procedure_whose_gateway_was_killed_is_interrupted_where_it_was_and_waits() {
    let cell = Cell::up_with(&["--time-scale", "10"]).await;
    let (case, plan_digest) = cell.approved_case().await;
    let mut procedures = cell.procedures().await;
    let request = StartProcedureRequest {
        case_id: case,
        plan_digest,
        operator: "test".to_owned(),
    };
    let started = procedures
        .start_procedure(request)
        .await
        .expect("it starts");
    let id = started
        .into_inner()
        .procedure
        .expect("a procedure")
        .procedure_id;
    let inside = |procedure: &Procedure| {
        procedure.bites_done >= 1
            && procedure
                .step
                .as_ref()
                .is_some_and(|step| step.kind() == StepKind::Insert)
    };
    watch_until(&mut procedures, &id, inside).await;
    signal(cell.at.processes["gateway"], "KILL").await;

    let (gateway, mut procedures) = restarted_gateway(&cell).await;
    let interrupted = watch_until(&mut procedures, &id, |procedure| {
        procedure.state() == ProcedureState::Interrupted
    })
    .await;
    assert_eq!(interrupted.reason, "GATEWAY_RESTARTED");
    let report = procedures
        .get_report(GetReportRequest {
            procedure_id: id.clone(),
        })
        .await
        .expect("the journal is there")
        .into_inner();
    let last = report.steps.last().expect("steps were journalled");
    assert!(
        !matches!(last.state(), StepState::Done | StepState::Unspecified),
        "the interrupted step is not held as done: {last:?}"
    );
    // The lease of the killed gateway runs out first; from then on everything must stand still.
    let bites_before = bites(&cell).await;
    while anything_moves(&cell, 2.0).await {}
    assert!(!anything_moves(&cell, 20.0).await);
    assert_eq!(bites(&cell).await, bites_before);

    let request = RecoverProcedureRequest {
        procedure_id: id.clone(),
        action: RecoveryAction::Withdraw.into(),
        operator: "test".to_owned(),
        acknowledge: true,
        // The drives' leases ran out with the gateway; the arms may have latched what they saw then.
        recover_faults: true,
    };
    procedures
        .recover_procedure(request)
        .await
        .expect("the operator decides");
    watch_until(&mut procedures, &id, |procedure| {
        procedure.state() == ProcedureState::Aborted
    })
    .await;
    let account = account(&cell).await;
    assert!(account.collisions.is_empty(), "{:?}", account.collisions);
    assert!(account.shafts.iter().all(|shaft| shaft.rcm_max_mm <= 0.5));
    drop(gateway);
    cell.teardown().await;
}

async fn account(cell: &Cell) -> arthro_proto::simulator::v1::GetAccountResponse {
    let mut referee = cell.referee().await;
    let account = referee.get_account(GetAccountRequest {}).await;
    account.expect("the referee answers").into_inner()
}

async fn bites(cell: &Cell) -> u32 {
    let account = account(cell).await;
    account.bites + account.empty_bites
}
