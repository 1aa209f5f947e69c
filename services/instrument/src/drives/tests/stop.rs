use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stop_needs_no_lease_and_ends_every_motion() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.handle.stop("the operator".into()).await.unwrap();
    let stopped = ticket.ended().await.unwrap().operation;
    assert_eq!(
        (stopped.state, &*stopped.reason),
        (OperationState::Stopped, "STOPPED")
    );
    assert_eq!(stopped.detail, "stopped: the operator");
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(
        (drive.state, drive.controlwords.last()),
        (State::QuickStopActive, Some(&0x0002))
    );
    assert!(drive.position_qc < 14.0 * QC_PER_MM);
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
    // Nothing goes on by itself; a new command does.
    world.cell.let_time_go();
    let moved = world.feed_to(2.0).await;
    assert_eq!(moved.operation.state, OperationState::Done);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_silent_bus_is_a_fault_of_every_axis_and_stop_says_that_it_cannot() {
    let world = World::homed().await;
    for node_id in 1..=4 {
        world.cell.change(node_id, |drive| drive.dead = true);
    }
    world
        .until(|state| state.axes.iter().all(|axis| axis.fault.is_some()))
        .await;
    let refused = world.handle.stop("nobody hears".into()).await.unwrap_err();
    assert!(matches!(refused, Refusal::StopNotConfirmed(_)), "{refused}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_service_that_shuts_down_leaves_drives_that_stand_without_power_and_do_not_miss_it() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.shut_down.take().unwrap().send(()).unwrap();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "SHUTDOWN");
    for node_id in 1..=4 {
        world
            .cell
            .until(node_id, |drive| {
                drive.state == State::SwitchOnDisabled
                    && drive.get(objects::CONSUMER_HEARTBEAT_1) == 0
            })
            .await;
    }
    let words = world.cell.drive(FORCEPS_FEED).controlwords;
    assert_eq!(words[words.len() - 3..], [0x0002, 0x0002, 0x0000]);
}
