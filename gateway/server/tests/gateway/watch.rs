//! Watching: every change or one state a period, to the end, for many at once; and asking once.

use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::ProcedureState;
use tonic::{Code, Streaming};

use super::bench::{Bench, reason};
use super::fakes::PATIENCE;

async fn watch(
    bench: &mut Bench,
    procedure_id: &str,
    period_s: f64,
) -> Streaming<proto::WatchProcedureResponse> {
    let request = proto::WatchProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        period_s,
    };
    bench
        .procedures
        .watch_procedure(request)
        .await
        .unwrap()
        .into_inner()
}

/// The next state, or none at the end.
async fn next(states: &mut Streaming<proto::WatchProcedureResponse>) -> Option<proto::Procedure> {
    let message = tokio::time::timeout(PATIENCE, states.message())
        .await
        .expect("a state comes or the watch ends");
    message.unwrap().map(|message| message.procedure.unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watch_with_a_period_tells_the_state_again_though_nothing_changed() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;

    let mut states = watch(&mut bench, &procedure_id, 0.005).await;
    let first = next(&mut states).await.unwrap();
    for _ in 0..5 {
        assert_eq!(next(&mut states).await.as_ref(), Some(&first));
    }
    bench.world.let_go();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watch_with_a_period_ends_with_the_end_of_the_procedure() {
    let mut bench = Bench::new().await;
    let procedure_id = bench.started().await;
    let mut states = watch(&mut bench, &procedure_id, 0.005).await;
    let mut last = None;
    while let Some(state) = next(&mut states).await {
        last = Some(state);
    }
    assert_eq!(last.unwrap().state(), ProcedureState::Completed);
}

#[tokio::test(flavor = "multi_thread")]
async fn all_who_watch_see_the_same_end() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    let mut watching = Vec::new();
    for watcher in 0..20 {
        let period_s = f64::from(watcher % 2) * 0.005;
        watching.push(watch(&mut bench, &procedure_id, period_s).await);
    }
    bench.world.let_go();
    for mut states in watching {
        let mut last = None;
        while let Some(state) = next(&mut states).await {
            last = Some(state);
        }
        let last = last.unwrap();
        assert_eq!(last.state(), ProcedureState::Completed);
        assert_eq!(last.bites_done, 3);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_period_out_of_range_is_refused_with_its_limits() {
    let mut bench = Bench::new().await;
    let procedure_id = bench.started().await;
    for period_s in [-1.0, 0.0005, 60.5, f64::NAN, f64::INFINITY] {
        let request = proto::WatchProcedureRequest {
            procedure_id: procedure_id.clone(),
            period_s,
        };
        let refusal = bench.procedures.watch_procedure(request).await.unwrap_err();
        assert_eq!(refusal.code(), Code::InvalidArgument, "{period_s}");
        assert!(
            refusal
                .message()
                .contains("must be 0 or within 0.001 .. 60 s"),
            "{refusal:?}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_open_and_an_ended_procedure_can_be_asked_for() {
    let mut bench = Bench::new().await;
    bench.world.hold("BITE");
    let procedure_id = bench.started().await;
    bench.world.arrived("BITE", 1).await;
    assert_eq!(
        get(&mut bench, &procedure_id).await.state(),
        ProcedureState::Running
    );

    bench.world.let_go();
    let ended = bench
        .reaches(&procedure_id, ProcedureState::Completed)
        .await;
    assert_eq!(get(&mut bench, &procedure_id).await, ended);

    let request = proto::GetProcedureRequest {
        procedure_id: "nobody".to_owned(),
    };
    let refusal = bench.procedures.get_procedure(request).await;
    assert_eq!(reason(refusal), "UNKNOWN_PROCEDURE");
}

async fn get(bench: &mut Bench, procedure_id: &str) -> proto::Procedure {
    let request = proto::GetProcedureRequest {
        procedure_id: procedure_id.to_owned(),
    };
    let answer = bench.procedures.get_procedure(request).await.unwrap();
    answer.into_inner().procedure.unwrap()
}
