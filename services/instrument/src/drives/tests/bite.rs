use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_empty_jaw_closes_to_its_position() {
    let mut world = World::homed().await;
    let report = world
        .run(Command::Bite {
            current_limit_ma: 500.0,
        })
        .await;
    let end = report.bite.unwrap();
    assert_eq!((end.jaw, end.peak_current_ma), (Jaw::ClosedEmpty, 40.0));
    assert!((end.position_mm - 10.0).abs() < 0.02);
    assert_eq!(world.handle.snapshot().jaw, Jaw::ClosedEmpty);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tissue_that_stops_the_jaw_ends_the_bite_at_the_current_limit_and_the_jaw_opens_again() {
    let mut world = World::homed().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.obstacle_qc = Some(6.0 * QC_PER_MM)
    });
    let report = world
        .run(Command::Bite {
            current_limit_ma: 300.0,
        })
        .await;
    let end = report.bite.unwrap();
    assert_eq!((end.jaw, end.peak_current_ma), (Jaw::ClosedOnTissue, 300.0));
    assert!((end.position_mm - 6.0).abs() < 0.01);
    assert_eq!(
        report.operation.detail,
        "closed at 6.000 mm with a peak of 300 mA"
    );
    let opened = world.run(Command::OpenJaw).await;
    assert_eq!(opened.operation.state, OperationState::Done, "{opened:?}");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Open);
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(
        drive.get(objects::FOLLOWING_ERROR_WINDOW),
        2_150,
        "the window is that of moves again"
    );
    assert_eq!(drive.get(objects::OUTPUT_CURRENT_LIMIT), 800);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bite_that_is_stopped_leaves_the_jaw_unknown() {
    let mut world = World::homed().await;
    // The bite shall not end before it is stopped.
    world.cell.hold_time();
    let mut ticket = world
        .begin(Command::Bite {
            current_limit_ma: 500.0,
        })
        .await
        .unwrap();
    world
        .cell
        .until(FORCEPS_FEED, |drive| !drive.targets_qc.is_empty())
        .await;
    assert_eq!(world.handle.snapshot().jaw, Jaw::Moving);
    world.handle.stop("doubt".into()).await.unwrap();
    assert_eq!(
        ticket.ended().await.unwrap().operation.state,
        OperationState::Stopped
    );
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
}
