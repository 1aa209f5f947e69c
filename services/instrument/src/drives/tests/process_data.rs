use epos4_link::canopen::object::Address;

use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_watches_this_host_and_sends_what_it_does() {
    let world = World::ready().await;
    for node_id in 1..=4 {
        let drive = world.cell.drive(node_id);
        assert_eq!(drive.get(objects::CONSUMER_HEARTBEAT_1), 127 << 16 | 300);
        assert_eq!(drive.get(objects::ABORT_CONNECTION_OPTION), 3);
        assert_eq!(drive.get(objects::COMMUNICATION_ERROR_BEHAVIOUR), 0);
        let mapped: Vec<Vec<u8>> = [(0x1A00, 1), (0x1A01, 1), (0x1A01, 2), (0x1A02, 1)]
            .map(|(index, subindex)| drive.objects[&Address::new(index, subindex)].clone())
            .into();
        assert_eq!(
            mapped,
            [0x6041_0010_u32, 0x6064_0020, 0x30D1_0220, 0x60FD_0020]
                .map(|entry| entry.to_le_bytes().to_vec())
        );
    }
    assert!(world.cell.host_heartbeats.load(Ordering::Relaxed) > 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_a_resting_drive_does_is_shown_although_nobody_asks() {
    let world = World::homed().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.position_qc = 5.0 * QC_PER_MM;
    });
    let shown = |state: &Snapshot| {
        let sample = state.axes[1].sample;
        sample.is_some_and(|sample| (sample.position - 5.0).abs() < 0.001)
    };
    world.until(shown).await;
    let snapshot = world.handle.snapshot();
    assert!(snapshot.age(Axis::ForcepsFeed).unwrap() < Duration::from_secs(1));
    assert_eq!(snapshot.axes[1].safe_torque_off, Some(false));
    assert_eq!(snapshot.axes[1].i2t.unwrap().motor_percent, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_that_changes_and_does_not_send_it_is_a_fault() {
    let world = World::homed().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.mute = true;
        drive.position_qc += 1000.0;
    });
    world.until(|state| state.axes[1].fault.is_some()).await;
    assert_eq!(world.fault(Axis::ForcepsFeed), "STALE_PROCESS_DATA");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_move_whose_process_data_stay_out_is_stopped() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.cell.change(FORCEPS_FEED, |drive| drive.mute = true);
    world.cell.let_time_go();
    let ended = ticket.ended().await.unwrap().operation;
    assert_eq!(ended.reason, "STALE_PROCESS_DATA", "{}", ended.detail);
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_quick_stop_goes_by_process_data_and_is_confirmed() {
    let mut world = World::homed().await;
    let mut ticket = world.long_move().await;
    world.handle.stop("the operator".into()).await.unwrap();
    ticket.ended().await.unwrap();
    let sent = world.cell.host_pdos.lock().unwrap().clone();
    for node_id in 1..=4 {
        assert!(sent.contains(&Frame::standard(0x200 + node_id, [0x02, 0x00])));
    }
    let drive = world.cell.drive(FORCEPS_FEED);
    let quick_stops = drive.controlwords.iter().filter(|word| **word == 0x0002);
    assert_eq!(quick_stops.count(), 2, "as process data and by SDO");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fault_whose_emergency_was_lost_is_noticed_and_told_with_its_response() {
    let cell = FakeCell::start();
    cell.change(FORCEPS_FEED, |drive| drive.enter_fault(0x8130));
    let world = World::start(cell);
    world.until(|state| state.axes[1].fault.is_some()).await;
    let fault = world.handle.snapshot().axes[1].fault.clone().unwrap();
    assert_eq!(
        (fault.reason, fault.code),
        ("CAN_COMMUNICATION", Some(0x8130))
    );
    assert!(fault.response.contains("fell silent"), "{}", fault.response);
    world
        .cell
        .change(FORCEPS_ROTATION, |drive| drive.enter_fault(0x4380));
    world.until(|state| state.axes[0].fault.is_some()).await;
    assert_eq!(world.fault(Axis::ForcepsRotation), "OVERTEMPERATURE");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn safe_torque_off_is_shown() {
    let world = World::homed().await;
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.set(objects::STO_INPUTS, 0));
    world.cell.fault(FORCEPS_FEED, 0x8A88);
    world
        .until(|state| state.axes[1].safe_torque_off == Some(true))
        .await;
    world.until(|state| state.axes[1].fault.is_some()).await;
    assert_eq!(world.fault(Axis::ForcepsFeed), "SAFE_TORQUE_OFF");
}
