use super::*;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn objects_are_read_and_written_but_none_that_moves_the_drive() {
    let mut world = World::ready().await;
    let torque_constant = Address::new(0x3001, 5);
    let write = |address| Command::Write {
        axis: Axis::ForcepsFeed,
        address,
        data: vec![1, 2, 0, 0],
    };
    let written = world.run(write(torque_constant)).await;
    assert_eq!(written.operation.state, OperationState::Done);
    assert_eq!(
        world.handle.read(Axis::ForcepsFeed, torque_constant).await,
        Ok(vec![1, 2, 0, 0])
    );
    assert_eq!(
        world.reason(write(objects::CONTROLWORD.address)).await,
        "OBJECT_RESERVED"
    );
    let refused = world
        .handle
        .read(Axis::ForcepsFeed, Address::new(0x6072, 0))
        .await
        .unwrap_err();
    assert!(
        matches!(&refused, Refusal::Object(error) if error.abort_code() == Some(AbortCode::NO_OBJECT))
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn bad_requests_name_field_value_and_limit() {
    let mut world = World::homed().await;
    let server = Instrument::new(world.handle.clone(), Drain::never());
    let mut authorization = || {
        let Authorization {
            fencing_token,
            operation_id,
        } = world.authorization();
        Some(arthro_proto::common::v1::Authorization {
            fencing_token,
            operation_id,
        })
    };
    let feed = proto::Axis::ForcepsFeed as i32;
    let cases = [
        (
            feed,
            Some(Position::FeedMm(14.5)),
            "target: 14.5 mm is outside the travel of forceps_feed, -1 to 14 mm",
        ),
        (
            feed,
            Some(Position::FeedMm(f64::NAN)),
            "target: NaN is not a position of forceps_feed",
        ),
        (
            feed,
            Some(Position::AngleDeg(5.0)),
            "target: is angle_deg; forceps_feed takes feed_mm",
        ),
        (feed, None, "target: is missing; forceps_feed takes feed_mm"),
        (
            9,
            Some(Position::FeedMm(5.0)),
            "axis: is 9; there are axes 1 to 4",
        ),
        (
            3,
            Some(Position::AngleDeg(-46.0)),
            "target: -46 deg is outside the travel of arthroscope_rotation, -45 to 180 deg",
        ),
    ];
    for (axis, value, message) in cases {
        let target = Some(proto::AxisPosition { value });
        let request = proto::MoveAxisRequest {
            authorization: authorization(),
            axis,
            target,
        };
        let status = server
            .move_axis(tonic::Request::new(request))
            .await
            .unwrap_err();
        assert_eq!(
            (status.code(), status.message()),
            (Code::InvalidArgument, message)
        );
        assert_eq!(arthro_bootstrap::status::violations(&status).len(), 1);
    }
    let bite = proto::BiteRequest {
        authorization: authorization(),
        current_limit_ma: 501.0,
    };
    let status = server.bite(tonic::Request::new(bite)).await.unwrap_err();
    assert_eq!(
        status.message(),
        "current_limit_ma: is 501; must be within 1 to 500, or 0 for 500"
    );
    let unauthorized = proto::OpenJawRequest {
        authorization: None,
    };
    let status = server
        .open_jaw(tonic::Request::new(unauthorized))
        .await
        .unwrap_err();
    assert_eq!(
        arthro_bootstrap::status::violations(&status)[0].0,
        "authorization"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bite_is_streamed_and_ends_with_jaw_and_peak_also_when_repeated() {
    use tokio_stream::StreamExt as _;
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
            (last.jaw(), last.peak_current_ma),
            (proto::JawState::ClosedEmpty, 40.0)
        );
        assert!(!last.state.as_ref().unwrap().moving);
    }
    assert_eq!(world.cell.drive(FORCEPS_FEED).targets_qc.len(), 1);
}
