//! Approval: bound to every bit of what was approved, and to as many persons as must.

use arthro_gateway::approval::{Policy, Second};
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::CaseState;
use sqlx::SqliteConnection;
use tonic::Status;

use super::bench::{Bench, reason};

/// Of each of these columns this many bits are flipped, one at a time.
const FLIPS: usize = 60;

async fn two_surgeons(second: Second) -> Bench {
    Bench::with(|config| config.approval = Policy { persons: 2, second }).await
}

async fn sign(
    bench: &mut Bench,
    case_id: &str,
    digest: &str,
    surgeon: &str,
) -> Result<proto::Case, Status> {
    let request = proto::ApprovePlanRequest {
        case_id: case_id.to_owned(),
        plan_digest: digest.to_owned(),
        surgeon: surgeon.to_owned(),
    };
    let answer = bench.cases.approve_plan(request).await?;
    Ok(answer.into_inner().case.unwrap())
}

async fn countersign(
    bench: &mut Bench,
    case_id: &str,
    digest: &str,
    person: &str,
) -> Result<proto::Case, Status> {
    let request = proto::CountersignPlanRequest {
        case_id: case_id.to_owned(),
        plan_digest: digest.to_owned(),
        person: person.to_owned(),
    };
    let answer = bench.cases.countersign_plan(request).await?;
    Ok(answer.into_inner().case.unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_that_needs_two_names_does_not_start_with_one() {
    let mut bench = two_surgeons(Second::Surgeon).await;
    let (case_id, digest) = bench.planned().await;
    let case = sign(&mut bench, &case_id, &digest, "Dr. Adams")
        .await
        .unwrap();
    assert_eq!(case.state(), CaseState::Planned);
    assert_eq!((case.approvals.len(), case.approvals_needed), (1, 2));
    let refused = bench.start(&case_id, &digest).await;
    assert_eq!(reason(refused), "SECOND_APPROVAL_NEEDED");
    assert!(bench.world.commands().is_empty());

    let again = sign(&mut bench, &case_id, &digest, "DR. ADAMS").await;
    assert_eq!(reason(again), "SAME_PERSON");
    let again = countersign(&mut bench, &case_id, &digest, "Dr. Adams").await;
    assert_eq!(reason(again), "SAME_PERSON");

    let case = sign(&mut bench, &case_id, &digest, "Dr. Brown")
        .await
        .unwrap();
    assert_eq!(case.state(), CaseState::Approved);
    let names: Vec<_> = case
        .approvals
        .iter()
        .map(|approval| &approval.name)
        .collect();
    assert_eq!(names, ["Dr. Adams", "Dr. Brown"]);
    bench.start(&case_id, &digest).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_second_name_comes_after_the_first_and_only_where_it_is_asked_for() {
    let mut bench = two_surgeons(Second::Operator).await;
    let (case_id, digest) = bench.planned().await;
    let early = countersign(&mut bench, &case_id, &digest, "Olsen").await;
    assert_eq!(reason(early), "NOT_APPROVED");
    sign(&mut bench, &case_id, &digest, "Dr. Adams")
        .await
        .unwrap();
    let case = countersign(&mut bench, &case_id, &digest, "Olsen")
        .await
        .unwrap();
    assert_eq!(case.state(), CaseState::Approved);

    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let needless = countersign(&mut bench, &case_id, &digest, "Olsen").await;
    assert_eq!(reason(needless), "NO_SECOND_APPROVAL");
}

#[tokio::test(flavor = "multi_thread")]
async fn both_names_outlive_a_crash() {
    let mut bench = two_surgeons(Second::Surgeon).await;
    let (case_id, digest) = bench.planned().await;
    sign(&mut bench, &case_id, &digest, "Dr. Adams")
        .await
        .unwrap();
    sign(&mut bench, &case_id, &digest, "Dr. Brown")
        .await
        .unwrap();
    let before = bench.get(&case_id).await.case.unwrap();
    bench.kill().await;
    bench.restart(|_| {}).await;
    assert_eq!(bench.get(&case_id).await.case.unwrap(), before);
}

async fn read(file: &mut SqliteConnection, column: &str) -> Vec<u8> {
    let query = format!("SELECT CAST({column} AS BLOB) FROM cases");
    sqlx::query_scalar(sqlx::AssertSqlSafe(query))
        .fetch_one(file)
        .await
        .unwrap()
}

async fn write(file: &mut SqliteConnection, column: &str, value: &[u8], kind: &str) {
    let query = format!("UPDATE cases SET {column} = CAST($1 AS {kind})");
    sqlx::query(sqlx::AssertSqlSafe(query))
        .bind(value.to_vec())
        .execute(file)
        .await
        .unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_edited_by_one_bit_in_the_journal_is_never_performed() {
    let mut bench = Bench::new().await;
    let (case_id, digest) = bench.approved().await;
    let mut file = bench.intrude().await;
    let (mut attempts, mut accepted) = (0, 0);
    for (column, kind) in [
        ("plan", "BLOB"),
        ("registration", "BLOB"),
        ("model_digest", "TEXT"),
        ("approved_digest", "TEXT"),
    ] {
        let whole = read(&mut file, column).await;
        for flip in 0..FLIPS {
            let mut edited = whole.clone();
            // Spread over the whole value; of a digest's letters only the lowest bits give another letter.
            let at = flip * whole.len() / FLIPS;
            edited[at] ^= 1 << (flip % if kind == "TEXT" { 3 } else { 8 });
            write(&mut file, column, &edited, kind).await;
            attempts += 1;
            accepted += u32::from(bench.start(&case_id, &digest).await.is_ok());
        }
        write(&mut file, column, &whole, kind).await;
    }
    println!("{attempts} attempts with one bit edited, {accepted} accepted");
    assert!(attempts >= 100);
    assert_eq!(accepted, 0);
    assert!(bench.world.commands().is_empty());
    // What was approved still is.
    bench.start(&case_id, &digest).await.unwrap();
}
