//! Only one commands a device, and anyone may stop it.

use arthro_bootstrap::status;
use arthro_proto::common::v1::{Arm, Authorization};
use arthro_proto::instrument::v1 as instrument;
use arthro_proto::motion::v1::{self as motion, move_request};
use arthro_tests::Cell;

fn lease_request(holder: &str) -> motion::AcquireLeaseRequest {
    motion::AcquireLeaseRequest {
        holder: holder.to_owned(),
        ttl_s: 30.0,
    }
}

fn retract(fencing_token: u64) -> motion::MoveRequest {
    motion::MoveRequest {
        authorization: Some(Authorization {
            fencing_token,
            operation_id: "commander-test".to_owned(),
        }),
        arm: Arm::Forceps.into(),
        motion: Some(move_request::Motion::Retract(motion::RetractMove {
            depth_mm: -50.0,
            speed_mm_s: 0.0,
        })),
    }
}

#[tokio::test]
async fn a_second_commander_is_refused_and_told_who_commands() {
    let cell = Cell::up().await;
    let mut arms = cell.motion().await;
    arms.acquire_lease(lease_request("first"))
        .await
        .expect("nobody commands yet");
    let refusal = arms
        .acquire_lease(lease_request("second"))
        .await
        .unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("LEASE_HELD"));
    assert!(refusal.message().contains("first"), "{}", refusal.message());

    let mut drives = cell.instrument().await;
    let ask = |holder: &str| instrument::AcquireLeaseRequest {
        holder: holder.to_owned(),
        ttl_s: 30.0,
    };
    drives
        .acquire_lease(ask("first"))
        .await
        .expect("nobody commands yet");
    let refusal = drives.acquire_lease(ask("second")).await.unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("LEASE_HELD"));
    cell.teardown().await;
}

#[tokio::test]
async fn a_move_without_a_lease_and_one_with_a_stale_token_are_refused() {
    let cell = Cell::up().await;
    let mut arms = cell.motion().await;
    let refusal = arms.r#move(retract(1)).await.unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("NO_LEASE"));

    let first = arms
        .acquire_lease(lease_request("first"))
        .await
        .expect("a lease");
    let stale = first.into_inner().lease.expect("a lease").fencing_token;
    let request = motion::ReleaseLeaseRequest {
        fencing_token: stale,
    };
    arms.release_lease(request)
        .await
        .expect("a lease can be given back");
    arms.acquire_lease(lease_request("second"))
        .await
        .expect("a lease");
    let refusal = arms.r#move(retract(stale)).await.unwrap_err();
    assert_eq!(
        status::reason(&refusal).as_deref(),
        Some("STALE_FENCING_TOKEN")
    );
    cell.teardown().await;
}

#[tokio::test]
async fn stopping_needs_no_lease() {
    let cell = Cell::up().await;
    let stop = motion::StopRequest {
        arm: Arm::Unspecified.into(),
        reason: "test".to_owned(),
    };
    cell.motion()
        .await
        .stop(stop)
        .await
        .expect("anyone may stop the arms");
    let stop = instrument::StopRequest {
        reason: "test".to_owned(),
    };
    cell.instrument()
        .await
        .stop(stop)
        .await
        .expect("anyone may stop the drives");
    cell.teardown().await;
}
