use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::axis_position::Value as Position;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService as _;
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::AbortCode;
use tonic::Code;

use super::*;
use crate::server::Instrument;

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
    let bites = [
        (
            501.0,
            0.0,
            "current_limit_ma: is 501; must be within 120 to 500, or 0 for 500",
        ),
        (
            f64::NAN,
            0.0,
            "current_limit_ma: is NaN; must be within 120 to 500, or 0 for 500",
        ),
        (
            300.0,
            30.0,
            "force_limit_n: is 30 and current_limit_ma is 300; a bite has one limit",
        ),
        (
            0.0,
            170.0,
            "force_limit_n: is 170 N, 501 mA; must be within 120 to 500 mA, 22.7 to 169.5 N",
        ),
        (
            0.0,
            1000.0,
            "force_limit_n: is refused: 1000 N is outside of the calibrated 0 to 270 N",
        ),
        (
            0.0,
            f64::NAN,
            "force_limit_n: is refused: NaN N is outside of the calibrated 0 to 270 N",
        ),
    ];
    for (current_limit_ma, force_limit_n, message) in bites {
        let bite = proto::BiteRequest {
            authorization: authorization(),
            current_limit_ma,
            force_limit_n,
        };
        let status = server.bite(tonic::Request::new(bite)).await.unwrap_err();
        assert_eq!(
            (status.code(), status.message()),
            (Code::InvalidArgument, message)
        );
    }
    let switches = proto::CommissionSwitchesRequest {
        authorization: authorization(),
        axis: feed,
        timeout_s: 0.5,
    };
    let status = server
        .commission_switches(tonic::Request::new(switches))
        .await
        .unwrap_err();
    assert_eq!(
        status.message(),
        "timeout_s: is 0.5; must be within 1 to 600, or 0 for 60"
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
