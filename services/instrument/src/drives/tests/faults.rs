use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_lost_heartbeat_stops_the_others_and_stays_until_it_is_recovered() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world
        .cell
        .change(FORCEPS_ROTATION, |drive| drive.dead = true);
    world.cell.let_time_go();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(
        (ended.state, &*ended.reason),
        (OperationState::Failed, "HEARTBEAT_LOST")
    );
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
    world
        .until(|state| state.axes[0].readiness != Readiness::Ready)
        .await;
    world
        .cell
        .change(FORCEPS_ROTATION, |drive| drive.dead = false);
    world
        .until(|state| state.axes[0].readiness == Readiness::Ready)
        .await;
    assert_eq!(
        world.fault(Axis::ForcepsRotation),
        "HEARTBEAT_LOST",
        "it does not go by itself"
    );
    assert_eq!(world.reason(MOVE_ROTATION).await, "AXIS_FAULTED");
    let recovered = world.run(Command::Recover(Axis::ALL.to_vec())).await;
    assert_eq!(recovered.operation.state, OperationState::Done);
    assert_eq!(
        world.run(MOVE_ROTATION).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_emergency_is_latched_and_a_fault_that_persists_is_not_recovered() {
    let mut world = World::homed().await;
    world.cell.fault(FORCEPS_FEED, 0x2310);
    world.until(|state| state.axes[1].fault.is_some()).await;
    assert_eq!(world.fault(Axis::ForcepsFeed), "OVERCURRENT");
    world
        .cell
        .until(FORCEPS_ROTATION, |drive| {
            drive.state == State::QuickStopActive
        })
        .await;
    world
        .handle
        .stop("wait until the quick stop is over".into())
        .await
        .unwrap();
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.fault_persists = true);
    let failed = world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(failed.operation.reason, "OVERCURRENT");
    assert_eq!(world.fault(Axis::ForcepsFeed), "OVERCURRENT");
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.fault_persists = false);
    let recovered = world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(recovered.operation.state, OperationState::Done);
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::SwitchOnDisabled,
        "nothing is switched on by that"
    );
    assert_eq!(
        world.feed_to(1.0).await.operation.state,
        OperationState::Done
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_that_restarts_has_a_fault_and_no_reference() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.cell.restart(FORCEPS_FEED);
    world.cell.let_time_go();
    assert_eq!(
        ticket.ended().await.unwrap().operation.reason,
        "UNEXPECTED_BOOT_UP"
    );
    world
        .until(|state| state.axes[1].readiness == Readiness::Ready)
        .await;
    world
        .handle
        .stop("wait until the quick stop is over".into())
        .await
        .unwrap();
    assert_eq!(world.reason(Command::OpenJaw).await, "AXIS_FAULTED");
    world.run(Command::Recover(vec![Axis::ForcepsFeed])).await;
    assert_eq!(world.reason(Command::OpenJaw).await, "NOT_HOMED");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_statusword_that_no_standard_knows_is_a_fault() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.statusword = Some(0x006F));
    assert_eq!(
        ticket.ended().await.unwrap().operation.reason,
        "UNKNOWN_STATUSWORD"
    );
    assert_eq!(world.fault(Axis::ForcepsFeed), "UNKNOWN_STATUSWORD");
}
