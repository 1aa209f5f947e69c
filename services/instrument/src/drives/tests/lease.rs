use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_the_holder_of_the_lease_commands() {
    let mut world = World::homed().await;
    world.handle.release(world.token).await.unwrap();
    assert_eq!(world.reason(MOVE_ROTATION).await, "NO_LEASE");
    let newer = world
        .handle
        .acquire("other".into(), Duration::from_secs(60))
        .await
        .unwrap()
        .fencing_token;
    assert!(newer > world.token);
    assert_eq!(world.reason(MOVE_ROTATION).await, "STALE_FENCING_TOKEN");
    assert!(world.cell.drive(FORCEPS_ROTATION).targets_qc.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_repeated_operation_is_answered_and_does_not_act_again() {
    let mut world = World::homed().await;
    let authorization = world.authorization();
    let mut first = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    let mut again = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    assert!(!first.repeated && again.repeated);
    assert_eq!(first.ended().await, again.ended().await);
    let mut later = world
        .handle
        .command(authorization.clone(), MOVE_ROTATION)
        .await
        .unwrap();
    assert_eq!(
        later.ended().await.unwrap().operation.state,
        OperationState::Done
    );
    assert_eq!(world.cell.drive(FORCEPS_ROTATION).targets_qc, [10_752]);
    let other = Command::Move {
        axis: Axis::ForcepsRotation,
        target: 91.0,
    };
    let refused = world
        .handle
        .command(authorization, other)
        .await
        .unwrap_err();
    assert!(matches!(
        refused,
        Refusal::Authority(arthro_authority::Refusal::OperationIdReused { .. })
    ));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lost_lease_quick_stops_the_drives() {
    let mut world = World::homed().await;
    world.handle.release(world.token).await.unwrap();
    world.token = world
        .handle
        .acquire("short".into(), Duration::from_millis(200))
        .await
        .unwrap()
        .fencing_token;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled,
        "homing left it so"
    );
    for node_id in 1..=4 {
        world
            .cell
            .until(node_id, |drive| drive.state == State::QuickStopActive)
            .await;
    }
    assert_eq!(world.reason(MOVE_ROTATION).await, "LEASE_EXPIRED");
}
