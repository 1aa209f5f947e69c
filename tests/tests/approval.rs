//! Nothing moves without an approved plan whose digest equals what is executed.

use arthro_proto::gateway::v1::{GetCaseRequest, RevisePlanRequest};
use arthro_proto::simulator::v1::GetAccountRequest;
use arthro_tests::Cell;

/// Nobody went in: the portals were not passed.
async fn insertions(cell: &Cell) -> u32 {
    let account = cell.referee().await.get_account(GetAccountRequest {}).await;
    let shafts = account.expect("the referee answers").into_inner().shafts;
    shafts.iter().map(|shaft| shaft.insertions).sum()
}

#[tokio::test]
async fn a_run_without_approval_is_refused_and_nothing_moves() {
    let cell = Cell::up().await;
    let (case, digest) = cell.planned_case().await;
    let answer = cell
        .command(&["run", &case, "--operator", "test", "--digest", &digest])
        .await;
    assert_eq!((answer.code, answer.reason()), (3, "NOT_APPROVED"));
    assert_eq!(insertions(&cell).await, 0);
    cell.teardown().await;
}

#[tokio::test]
async fn a_case_without_a_plan_is_not_run() {
    let cell = Cell::up().await;
    let case = cell.registered_case().await;
    let answer = cell.command(&["run", &case, "--operator", "test"]).await;
    assert_eq!((answer.code, answer.reason()), (3, "NOT_PLANNED"));
    assert_eq!(insertions(&cell).await, 0);
    cell.teardown().await;
}

#[tokio::test]
async fn a_plan_revised_after_approval_is_not_run() {
    let cell = Cell::up().await;
    let (case, digest) = cell.approved_case().await;

    let mut cases = cell.cases().await;
    let request = GetCaseRequest {
        case_id: case.clone(),
    };
    let plan = cases.get_case(request).await.expect("the case is there");
    let mut bites = plan.into_inner().plan.expect("a plan is there").bites;
    bites.pop();
    let request = RevisePlanRequest {
        case_id: case.clone(),
        bites,
    };
    let revised = cases
        .revise_plan(request)
        .await
        .expect("a bite may be left out");
    let revised = revised.into_inner().case.expect("a case comes back");
    assert_ne!(revised.plan_digest, digest);
    assert_eq!(revised.approved_by, "");

    for digest in [&digest, &revised.plan_digest] {
        let answer = cell
            .command(&["run", &case, "--operator", "test", "--digest", digest])
            .await;
        assert_eq!(answer.code, 3, "{}", answer.json);
        assert!(
            ["NOT_APPROVED", "APPROVAL_VOID", "DIGEST_MISMATCH"].contains(&answer.reason()),
            "{}",
            answer.json
        );
    }
    assert_eq!(insertions(&cell).await, 0);
    cell.teardown().await;
}

#[tokio::test]
async fn a_digest_that_nobody_saw_cannot_be_approved() {
    let cell = Cell::up().await;
    let (case, digest) = cell.planned_case().await;
    let other = digest.replace(|c: char| c.is_ascii_digit(), "a");
    let answer = cell
        .command(&[
            "case",
            "approve",
            &case,
            "--digest",
            &other,
            "--surgeon",
            "test",
        ])
        .await;
    assert_eq!((answer.code, answer.reason()), (3, "DIGEST_MISMATCH"));
    cell.teardown().await;
}
