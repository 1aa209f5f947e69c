//! A gateway between many clients and bad ones stays one that can be stopped, refuses nobody wrongly, and keeps its memory.
//! How fast it is under load is measured by `tests/run load`.

use std::time::Duration;

use arthro_proto::gateway::v1::StartProcedureRequest;
use arthro_tests::Cell;
use arthro_tests::load::{Crowd, Lie, Resident, Stopper, Uploads, resident_bytes, upload};
use tonic::Code;

const WATCHERS: usize = 30;
const ASKERS: usize = 10;
const IDLE_STREAMS: usize = 1500;
const IDLE_CONNECTIONS: usize = 30;
/// Each who never reads may leave 400 KB of states behind, each idle stream a few KB.
const GROWTH_MAX_BYTES: u64 = 150 * 1024 * 1024;

/// A procedure that was started and is under way.
async fn started(cell: &Cell) -> (String, String) {
    let (case_id, plan_digest) = cell.approved_case().await;
    let request = StartProcedureRequest {
        case_id: case_id.clone(),
        plan_digest,
        operator: "test".to_owned(),
    };
    let answer = cell.procedures().await.start_procedure(request).await;
    let procedure = answer.expect("an approved plan starts").into_inner();
    let procedure = procedure.procedure.expect("a procedure comes back");
    (case_id, procedure.procedure_id)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_gets_through_a_crowd_and_nobody_is_refused_wrongly() {
    let cell = Cell::up().await;
    let (case_id, procedure_id) = started(&cell).await;
    let stopper = Stopper::at(&cell);
    // Interrupted, it stays open for as long as it is watched.
    stopper
        .stop_for(Duration::from_millis(1))
        .await
        .expect("a stop is acknowledged");
    let gateway = cell.at.processes["gateway"];
    let before = resident_bytes(gateway);
    let resident = Resident::of(gateway);

    let crowd = Crowd::of(cell.url("gateway"), &procedure_id);
    let slow = crowd.watch_without_reading(50, 0.02).await;
    let idle = crowd.watch_over(IDLE_STREAMS, IDLE_CONNECTIONS, 60.0).await;
    let watching = crowd.watch(WATCHERS, 0.02).await;
    let prefaces = crowd.begin_prefaces(50).await;
    let headers = crowd.begin_headers(50).await;
    let uploads = Uploads::to(cell.url("gateway"), &case_id, 2).await;
    let asking = crowd.ask(ASKERS, None).await;
    let stops = stopper
        .stop_for(Duration::from_secs(2))
        .await
        .expect("every stop is acknowledged");

    assert!(stops.gateway.count() > 0);
    assert_eq!(watching.open(), WATCHERS);
    assert_eq!(idle.open(), IDLE_STREAMS);
    assert!(watching.received() > WATCHERS as u64);
    assert_eq!(uploads.strange(), 0);
    let asked = asking.end().await;
    assert_eq!(asked.refused, 0);
    assert!(asked.latencies.count() > ASKERS);
    let growth = resident.most_bytes().saturating_sub(before);
    assert!(growth < GROWTH_MAX_BYTES, "grew by {growth} bytes");
    drop((slow, prefaces, headers));
    cell.teardown().await;
}

#[tokio::test]
async fn an_upload_of_4_gib_is_refused_with_its_limit_whatever_it_announced() {
    let cell = Cell::up().await;
    let created = cell
        .done(&["case", "create", "test", "--model", &model(&cell)])
        .await;
    let case_id = created["case_id"].as_str().expect("a case has an id");
    let mut cases = cell.cases().await;
    for (lie, limit) in [
        (Lie::None, "must be within 4 .. 500000"),
        (Lie::Small, "the header announced 12000"),
    ] {
        let refusal = upload(&mut cases, case_id, lie)
            .await
            .expect_err("it is too large");
        assert_eq!(refusal.code(), Code::InvalidArgument, "{refusal:?}");
        assert!(refusal.message().contains(limit), "{refusal:?}");
    }
    cell.teardown().await;
}

fn model(cell: &Cell) -> String {
    cell.at.model.display().to_string()
}
