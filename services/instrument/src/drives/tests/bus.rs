use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::frame::error::{Class, Report as ControllerReport};

use super::*;

const ERROR_PASSIVE: [u8; 8] = [0, 0x20, 0, 0, 0, 0, 130, 0];

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_controller_that_went_bus_off_comes_back_when_a_person_recovers() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world
        .cell
        .inject(ControllerReport::frame(Class::BUS_OFF, [0; 8]));
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "BUS_OFF");
    world
        .until(|state| state.bus.condition == BusCondition::Off)
        .await;
    world.until_all_have("BUS_OFF").await;
    assert_eq!(world.reason(MOVE_ROTATION).await, "AXIS_FAULTED");
    let refused = world.handle.stop("nobody hears".into()).await.unwrap_err();
    assert!(matches!(refused, Refusal::StopNotConfirmed(_)), "{refused}");
    assert_eq!(world.restarts.load(Ordering::Relaxed), 0);

    world.cell.let_time_go();
    assert_eq!(world.recover_all().await, OperationState::Done);
    assert_eq!(world.restarts.load(Ordering::Relaxed), 1);
    assert_eq!(world.handle.snapshot().bus.condition, BusCondition::Active);
    assert_eq!(world.faults(), [""; 4]);
    let moved = world.run(MOVE_ROTATION).await;
    assert_eq!(moved.operation.state, OperationState::Done, "{moved:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_error_passive_controller_stops_every_axis_and_is_shown_with_its_counters() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    let report = ControllerReport::frame(Class::CONTROLLER | Class::COUNTERS, ERROR_PASSIVE);
    world.cell.inject(report);
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "BUS_ERROR_PASSIVE");
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
    let bus = world.handle.snapshot().bus;
    assert_eq!(bus.condition, BusCondition::ErrorPassive);
    assert_eq!(bus.counters.map(|counters| counters.transmit), Some(130));
    world.until_all_have("BUS_ERROR_PASSIVE").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bus_that_takes_no_frames_is_named_and_joined_again_without_moving() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.is_choked.store(true, Ordering::Relaxed);
    world.cell.let_time_go();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "BUS_QUEUE_FULL");
    world.until_all_have("BUS_QUEUE_FULL").await;
    let commands = world.cell.drive(FORCEPS_FEED).targets_qc.len();
    world.is_choked.store(false, Ordering::Relaxed);
    world.until_ready().await;
    assert_eq!(world.faults(), ["BUS_QUEUE_FULL"; 4], "they stay");
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).targets_qc.len(),
        commands,
        "nothing goes on by itself"
    );
    assert_eq!(world.recover_all().await, OperationState::Done);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_drives_of_one_number_are_a_fault_of_that_axis() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    for _ in 0..5 {
        world
            .cell
            .inject(heartbeat::encode(2, nmt::State::Operational));
    }
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "DUPLICATE_NODE_ID");
    assert_eq!(world.faults(), ["", "DUPLICATE_NODE_ID", "", ""]);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn another_drive_in_the_place_of_one_is_not_commanded_before_a_person_has_seen_it() {
    let mut world = World::homed().await;
    world.cell.restart_as(FORCEPS_FEED, |drive| {
        drive.set(objects::SERIAL_NUMBER, 4711)
    });
    world
        .until(|state| {
            let readiness = &state.axes[1].readiness;
            matches!(
                readiness,
                Readiness::NotReady {
                    reason: "WRONG_NODE",
                    ..
                }
            )
        })
        .await;
    assert_eq!(world.fault(Axis::ForcepsFeed), "UNEXPECTED_BOOT_UP");
    world
        .handle
        .stop("quick stop is over".into())
        .await
        .unwrap();
    let home = Command::Home(vec![Axis::ForcepsFeed]);
    assert_eq!(world.reason(home).await, "AXIS_FAULTED");
    assert_eq!(world.recover_all().await, OperationState::Done);
    let identity = world.handle.snapshot().axes[1].identity.unwrap();
    assert_eq!(identity.serial_number, 4711);
    assert_eq!(world.reason(Command::OpenJaw).await, "NOT_HOMED");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_load_of_the_bus_is_shown() {
    let world = World::homed().await;
    world.until(|state| state.bus.load > 0.0).await;
    let bus = world.handle.snapshot().bus;
    assert!(bus.load < 0.5, "{bus:?}");
    assert_eq!(bus.bit_rate, 1_000_000);
}
