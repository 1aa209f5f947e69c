use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService as _;
use tokio_stream::StreamExt as _;

use super::*;
use crate::bite::BiteResult;
use crate::server::Instrument;

const BITE: Command = Command::Bite {
    current_limit_ma: 500.0,
};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_empty_jaw_closes_until_its_blades_meet() {
    let mut world = World::homed().await;
    let report = world.run(BITE).await;
    let end = report.bite.unwrap();
    assert_eq!(
        (end.result, end.contact_mm),
        (BiteResult::ClosedEmpty, None)
    );
    assert!((end.position_mm - 10.1).abs() < 0.02);
    assert!((end.peak_current_ma - 240.0).abs() < 50.0, "{end:?}");
    assert_eq!(world.handle.snapshot().jaw, Jaw::ClosedEmpty);
    // The jaw is forced open: what was known of it is given up.
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.obstacle_qc = Some(8.0 * QC_PER_MM);
        drive.position_qc = 8.0 * QC_PER_MM;
    });
    world.until(|state| state.jaw == Jaw::Unknown).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn tissue_that_stops_the_jaw_on_the_way_is_not_bitten_and_the_jaw_opens_again() {
    let mut world = World::homed().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.obstacle_qc = Some(6.0 * QC_PER_MM)
    });
    let limit = Command::Bite {
        current_limit_ma: 300.0,
    };
    let report = world.run(limit).await;
    assert_eq!(
        (report.operation.state, &*report.operation.reason),
        (OperationState::Failed, "JAW_NOT_CLOSED")
    );
    let end = report.bite.unwrap();
    assert_eq!(
        (end.result, end.peak_current_ma),
        (BiteResult::NotClosed, 300.0)
    );
    assert!((end.position_mm - 6.0).abs() < 0.01);
    // The time of the fake drives flies, and between two looks the jaw does some tenths of a millimetre.
    assert!((end.contact_mm.unwrap() - 6.0).abs() < 0.5, "{end:?}");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
    assert_eq!(world.fault(Axis::ForcepsFeed), "", "the drive obeys");
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(
        drive.get(objects::OUTPUT_CURRENT_LIMIT),
        120,
        "what could not be bitten is not pressed any longer"
    );
    world
        .cell
        .until(FORCEPS_FEED, |drive| drive.state == State::QuickStopActive)
        .await;
    world
        .handle
        .stop("wait until the quick stop is over".into())
        .await
        .unwrap();
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
async fn thin_tissue_is_held_closed() {
    let mut world = World::homed().await;
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.obstacle_qc = Some(9.8 * QC_PER_MM)
    });
    let report = world.run(BITE).await;
    assert_eq!(report.operation.state, OperationState::Done, "{report:?}");
    assert_eq!(report.bite.unwrap().result, BiteResult::ClosedOnTissue);
    let snapshot = world.handle.snapshot();
    assert_eq!(snapshot.jaw, Jaw::ClosedOnTissue);
    let drive = world.cell.drive(FORCEPS_FEED);
    assert_eq!(
        (drive.state, drive.get(objects::OUTPUT_CURRENT_LIMIT)),
        (State::OperationEnabled, 500),
        "it goes on closing with the current of the bite"
    );
    let again = world.run(BITE).await;
    assert_eq!(again.operation.reason, "JAW_NOT_OPEN");
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).targets_qc,
        drive.targets_qc,
        "the refused bite sent no target"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_belt_that_slips_is_a_fault_and_no_closed_jaw() {
    let mut world = World::homed().await;
    world
        .cell
        .change(FORCEPS_FEED, |drive| drive.belt_slips = true);
    let report = world.run(BITE).await;
    assert_eq!(report.operation.reason, "JAW_CLOSURE_DOUBTFUL");
    assert_eq!(report.bite.unwrap().result, BiteResult::Stalled);
    assert_eq!(world.fault(Axis::ForcepsFeed), "JAW_CLOSURE_DOUBTFUL");
    assert_eq!(world.handle.snapshot().jaw, Jaw::Unknown);
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

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bite_is_streamed_and_ends_with_jaw_and_peak_also_when_repeated() {
    let mut world = World::homed().await;
    let server = Instrument::new(world.handle.clone(), Drain::never());
    let Authorization {
        fencing_token,
        operation_id,
    } = world.authorization();
    let authorization = Some(arthro_proto::common::v1::Authorization {
        fencing_token,
        operation_id,
    });
    let request = proto::BiteRequest {
        authorization,
        current_limit_ma: 0.0,
        force_limit_n: 0.0,
    };
    for repeated in [false, true] {
        let stream = server
            .bite(tonic::Request::new(request.clone()))
            .await
            .unwrap()
            .into_inner();
        let messages: Vec<_> = stream.map(Result::unwrap).collect().await;
        let last = messages.last().unwrap();
        let operation = last.operation.as_ref().unwrap();
        assert_eq!(operation.repeated, repeated);
        assert_eq!(
            operation.state(),
            arthro_proto::common::v1::OperationState::Done
        );
        assert_eq!(
            (last.jaw(), last.result()),
            (proto::JawState::ClosedEmpty, proto::BiteResult::ClosedEmpty)
        );
        assert!(last.peak_current_ma > 200.0);
        assert!(!last.state.as_ref().unwrap().moving);
    }
    let targets_qc = world.cell.drive(FORCEPS_FEED).targets_qc;
    assert_eq!(targets_qc.len(), 2, "first at closing speed, then slowly");
    assert_eq!(targets_qc[0], targets_qc[1]);
}

/// Whatever is commanded in whatever order, with whatever between the blades.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn random_commands_send_no_target_beyond_the_travel_and_never_tell_a_false_jaw() {
    let mut world = World::homed().await;
    // Numerical Recipes' generator: every run is the same.
    let mut seed = 6_u32;
    let mut random = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((u64::from(seed) * u64::from(below)) >> 32) as u32
    };
    let (mut closed, mut refused) = (0, 0);
    for _ in 0..200 {
        let obstacle_qc = f64::from(random(140)) / 10.0 * QC_PER_MM;
        let is_free = random(2) == 0;
        world.cell.change(FORCEPS_FEED, |drive| {
            let is_ahead = drive.position_qc < obstacle_qc;
            drive.obstacle_qc = (!is_free && is_ahead).then_some(obstacle_qc);
        });
        let command = match random(6) {
            0 => Command::Home(vec![Axis::ForcepsFeed]),
            1 => Command::Move {
                axis: Axis::ForcepsFeed,
                target: f64::from(random(151)) / 10.0 - 1.0,
            },
            2 | 3 => Command::OpenJaw,
            _ => Command::Bite {
                current_limit_ma: 150.0 + f64::from(random(350)),
            },
        };
        let Ok(mut ticket) = world.begin(command).await else {
            refused += 1;
            world.handle.stop("wait".into()).await.unwrap();
            world.run(Command::Recover(Axis::ALL.to_vec())).await;
            continue;
        };
        if random(8) == 0 {
            world.handle.stop("at random".into()).await.unwrap();
        }
        ticket.ended().await.unwrap();
        let told = world.handle.snapshot().jaw;
        let at_mm = world.cell.drive(FORCEPS_FEED).position_qc / QC_PER_MM;
        match told {
            Jaw::ClosedEmpty | Jaw::ClosedOnTissue => {
                closed += 1;
                assert!(at_mm >= 9.68, "{told:?} at {at_mm} mm");
            }
            Jaw::Open => assert!(at_mm <= 0.02, "open at {at_mm} mm"),
            Jaw::Moving => panic!("nothing moves any more"),
            Jaw::Unknown => {}
        }
    }
    assert!(closed > 5 && refused > 5, "{closed} {refused}");
    for target_qc in world.cell.drive(FORCEPS_FEED).targets_qc {
        let target_mm = f64::from(target_qc) / QC_PER_MM;
        assert!((-1.0001..=14.0001).contains(&target_mm), "{target_mm}");
    }
}
