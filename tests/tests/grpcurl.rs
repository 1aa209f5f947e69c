//! Operators speak to the services with grpcurl: everything it can list, it can describe and call.

use arthro_tests::Cell;
use arthro_tests::peers::{run, text};

/// Every server with the gRPC services it must list.
const SERVERS: [(&str, &[&str]); 6] = [
    (
        "gateway",
        &[
            "arthro.gateway.v1.AuditService",
            "arthro.gateway.v1.CaseService",
            "arthro.gateway.v1.ProcedureService",
        ],
    ),
    (
        "registration",
        &["arthro.registration.v1.RegistrationService"],
    ),
    ("planning", &["arthro.planning.v1.PlanningService"]),
    ("motion", &["arthro.motion.v1.MotionService"]),
    ("instrument", &["arthro.instrument.v1.InstrumentService"]),
    (
        "simulator",
        &[
            "arthro.simulator.v1.CameraService",
            "arthro.simulator.v1.RefereeService",
        ],
    ),
];

async fn grpcurl(cell: &Cell, server: &str, before: &[&str], after: &[&str]) -> (bool, String) {
    let address = cell.url(server).trim_start_matches("http://").to_owned();
    let mut arguments = vec!["-plaintext"];
    arguments.extend_from_slice(before);
    arguments.push(&address);
    arguments.extend_from_slice(after);
    let output = run("grpcurl", &arguments).await;
    (output.status.success(), text(&output))
}

#[tokio::test]
async fn every_server_lists_and_describes_its_services_and_answers_health_checks() {
    let cell = Cell::up().await;
    for (server, services) in SERVERS {
        let (listed, list) = grpcurl(&cell, server, &[], &["list"]).await;
        assert!(listed, "{server}: {list}");
        for service in services {
            assert!(list.contains(service), "{server} lists {list:?}");
            let (described, description) =
                grpcurl(&cell, server, &[], &["describe", service]).await;
            assert!(described, "{service}: {description}");
            assert!(
                description.contains("// "),
                "{service} is described without its comments: {description}"
            );
        }
        let (healthy, health) = grpcurl(&cell, server, &[], &["grpc.health.v1.Health/Check"]).await;
        assert!(healthy && health.contains("SERVING"), "{server}: {health}");
    }
    cell.teardown().await;
}

#[tokio::test]
async fn a_bad_request_prints_decoded_field_violations() {
    let cell = Cell::up().await;
    let request = r#"{"points": [{"x_mm": 1}], "spacing_mm": -1}"#;
    let (accepted, answer) = grpcurl(
        &cell,
        "planning",
        &["-d", request],
        &["arthro.planning.v1.PlanningService/FitContour"],
    )
    .await;
    assert!(!accepted);
    assert!(answer.contains("InvalidArgument"), "{answer}");
    assert!(answer.contains("google.rpc.BadRequest"), "{answer}");
    assert!(answer.contains(r#""field":"points""#), "{answer}");
    cell.teardown().await;
}

#[tokio::test]
async fn a_refusal_by_state_prints_its_reason_word() {
    let cell = Cell::up().await;
    let request = r#"{"authorization": {"fencing_token": 1, "operation_id": "x"}, "arm": "ARM_FORCEPS", "retract": {"depth_mm": -10}}"#;
    let (accepted, answer) = grpcurl(
        &cell,
        "motion",
        &["-d", request],
        &["arthro.motion.v1.MotionService/Move"],
    )
    .await;
    assert!(!accepted);
    assert!(answer.contains("google.rpc.ErrorInfo"), "{answer}");
    assert!(answer.contains("NO_LEASE"), "{answer}");
    cell.teardown().await;
}
