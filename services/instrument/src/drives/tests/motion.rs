use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_without_reference_moves_only_to_find_it() {
    let mut world = World::ready().await;
    assert_eq!(world.reason(MOVE_ROTATION).await, "NOT_HOMED");
    assert_eq!(world.reason(Command::OpenJaw).await, "NOT_HOMED");
    let home = world.run(Command::Home(vec![Axis::ForcepsFeed])).await;
    assert_eq!(home.operation.detail, "forceps_feed at -1.000 mm");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Open);
    let moved = world.feed_to(3.0).await;
    assert_eq!(
        (moved.operation.state, &*moved.operation.detail),
        (OperationState::Done, "forceps_feed at 3.000 mm")
    );
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(drive.targets_qc, [64_512]);
    assert_eq!(drive.get(objects::PROFILE_VELOCITY), 6_300);
    assert_eq!(
        drive.get(objects::MAX_POSITION_LIMIT),
        (14.15 * QC_PER_MM).round() as i32
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_search_for_a_switch_that_no_input_has_is_refused_before_the_motor_obeys() {
    let mut world = World::ready().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::digital_input_function(1), 255)
    });
    let home = world.run(Command::Home(vec![Axis::ForcepsFeed])).await;
    assert_eq!(home.operation.reason, "HOMING_SWITCH_NOT_MAPPED");
    assert_ne!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled
    );
    assert_eq!(world.fault(Axis::ForcepsFeed), "");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_motion_goes_on_when_nobody_watches_it() {
    let mut world = World::homed().await;
    drop(world.long_move().await);
    assert_eq!(world.reason(Command::OpenJaw).await, "AXIS_MOVING");
    let refused = world.handle.release(world.token).await.unwrap_err();
    world.cell.let_time_go();
    assert!(matches!(
        refused,
        Refusal::AxisMoving {
            axis: Axis::ForcepsFeed,
            ..
        }
    ));
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.position_qc == 14.0 * QC_PER_MM)
        .await;
    world.until(|state| !state.axes[1].moving).await;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_reference_that_falls_during_a_move_is_a_fault() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.cell.change(FORCEPS_FEED, |drive| drive.homed = false);
    world.cell.let_time_go();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "REFERENCE_LOST");
    assert_eq!(world.fault(Axis::ForcepsFeed), "REFERENCE_LOST");
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_homing_that_is_broken_off_is_named() {
    let mut world = World::ready().await;
    world.cell.hold_time();
    let mut ticket = world
        .begin(Command::Home(vec![Axis::ForcepsFeed]))
        .await
        .unwrap();
    world
        .cell
        .until(FORCEPS_FEED, |drive| {
            drive.controlwords.last() == Some(&0x001F)
        })
        .await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.state = State::SwitchedOn;
    });
    world.cell.let_time_go();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "HOMING_INTERRUPTED");
    assert_eq!(world.fault(Axis::ForcepsFeed), "HOMING_INTERRUPTED");
}
