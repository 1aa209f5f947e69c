use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn drives_are_set_up_and_none_is_switched_on() {
    let world = World::ready().await;
    let state = world.handle.snapshot();
    assert_eq!(state.axes[1].identity.unwrap().serial_number, 1002);
    assert_eq!(state.jaw, Jaw::Unknown);
    for node_id in 1..=4 {
        let drive = world.cell.drive(node_id);
        assert_eq!(
            (drive.state, drive.controlwords.len()),
            (State::SwitchOnDisabled, 0)
        );
        assert_eq!(drive.get(objects::PRODUCER_HEARTBEAT), 100);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_of_another_kind_is_not_commanded() {
    let cell = FakeCell::start();
    cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::PRODUCT_CODE, 0x6150_0000)
    });
    let mut world = World::start(cell);
    let why = "product code (0x1018:02) is 0x61500000, configured is 0x60500000";
    let not_ready = Readiness::NotReady {
        reason: "WRONG_DEVICE",
        detail: why.to_owned(),
    };
    world
        .until(|state| state.axes[1].readiness == not_ready)
        .await;
    world
        .until(|state| state.axes[0].readiness == Readiness::Ready)
        .await;
    world.token = world
        .handle
        .acquire("test".into(), Duration::from_secs(60))
        .await
        .unwrap()
        .fencing_token;
    assert_eq!(
        world.reason(Command::Home(vec![Axis::ForcepsFeed])).await,
        "AXIS_NOT_READY"
    );
    assert!(world.cell.drive(FORCEPS_FEED).controlwords.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_with_other_settings_is_not_commanded_and_every_mismatch_is_told() {
    let cell = FakeCell::start();
    cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::GEAR_NUMERATOR, 16);
        drive.set(objects::INPUT_POLARITY, 0);
    });
    let world = World::start(cell);
    let not_ready = Readiness::NotReady {
        reason: "CONFIGURATION_MISMATCH",
        detail: "gear reduction numerator (0x3003:01) is 16/1, configured is 21/1; digital input polarity (0x3141:02) is \
                 0x0000: input 1 is active high, configured is active low"
            .to_owned(),
    };
    world
        .until(|state| state.axes[1].readiness == not_ready)
        .await;
    // Put right, it is taken without a restart of the service.
    world.cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::GEAR_NUMERATOR, 21);
        drive.set(objects::INPUT_POLARITY, 1);
    });
    world
        .until(|state| state.axes[1].readiness == Readiness::Ready)
        .await;
}

#[tokio::test]
async fn the_service_starts_without_a_bus_and_says_so() {
    let unused = std::net::TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let config = Config {
        bus: format!("socketcand://{unused}/can0"),
        ..Config::default()
    };
    let (drives, handle) = Drives::new(config.check().unwrap());
    let owner = tokio::spawn(drives.run(Drain::never()));
    let lease = handle
        .acquire("test".into(), Duration::from_secs(60))
        .await
        .unwrap();
    let authorization = Authorization {
        fencing_token: lease.fencing_token,
        operation_id: "home".into(),
    };
    let refused = handle
        .command(authorization, Command::Home(vec![Axis::ForcepsFeed]))
        .await
        .unwrap_err();
    assert!(matches!(refused, Refusal::AxisNotReady { .. }));
    let status = tonic::Status::from(handle.stop("test".into()).await.unwrap_err());
    assert_eq!(
        arthro_bootstrap::status::reason(&status).as_deref(),
        Some("STOP_NOT_CONFIRMED")
    );
    owner.abort();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_drive_that_was_set_up_for_another_axis_is_refused_by_name() {
    let cell = FakeCell::start();
    cell.change(FORCEPS_FEED, |drive| {
        drive.set(objects::GEAR_NUMERATOR, 84);
        drive.set(objects::OUTPUT_CURRENT_LIMIT, 4500);
    });
    let world = World::start(cell);
    world
        .until(|state| {
            let readiness = &state.axes[1].readiness;
            matches!(
                readiness,
                Readiness::NotReady {
                    reason: "CONFIGURATION_MISMATCH",
                    ..
                }
            )
        })
        .await;
    let snapshot = world.handle.snapshot();
    let Readiness::NotReady { detail, .. } = &snapshot.axes[1].readiness else {
        panic!("ready");
    };
    for part in ["0x3003:01", "84", "0x3001:02", "4500 mA"] {
        assert!(detail.contains(part), "{detail}");
    }
}
