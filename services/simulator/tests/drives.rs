//! EPOS4 drives alone, as anybody's tests start them: their bus, faults as a client orders them, and the truth.

// Helpers of a test may panic as the test itself does.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use arthro_bootstrap::status;
use arthro_proto::simulator::v1::drive_fault::Fault;
use arthro_proto::simulator::v1::drive_fault_service_client::DriveFaultServiceClient;
use arthro_proto::simulator::v1::drive_truth::Position;
use arthro_proto::simulator::v1::{
    BusOff, ClearDriveFaultsRequest, DriveFault, DriveTruth, DroppedNode, GearRatio,
    GetDrivesRequest, InjectDriveFaultRequest, ListDriveFaultsRequest, RandomFrames, SilentSdo,
    WaitForDriveFaultRequest,
};
use epos4_link::bus::{self, CanBus};
use epos4_link::canopen::object::{Address, Object};
use epos4_link::canopen::sdo::{Initiate, Request, Response, request_cob_id, response_cob_id};
use epos4_link::dictionary;
use epos4_link::frame::Frame;
use epos4_link::frame::error::{ControllerState, Report};
use epos4_link::objects;
use tonic::transport::Channel;
use tonic::{Code, Status};

/// The program with four drives, many times as fast as real ones; it ends with this.
struct Drives {
    process: Child,
    faults: DriveFaultServiceClient<Channel>,
    bus: Box<dyn CanBus>,
}

impl Drives {
    async fn start(arguments: &[&str]) -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_arthro-simulator"))
            .args(["epos4", "--listen", "127.0.0.1:0", "--grpc", "127.0.0.1:0"])
            .args(["--time-scale", "20", "--until-stdin-closes"])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let mut after = |name: &str| {
            let line = lines.next().unwrap().unwrap();
            let words: Vec<&str> = line.split('"').collect();
            let at = words.iter().position(|word| *word == name).unwrap();
            words[at + 2].to_owned()
        };
        let can = after("can");
        let grpc = after("address");
        let channel = Channel::from_shared(format!("http://{grpc}")).unwrap();
        Self {
            process,
            faults: DriveFaultServiceClient::new(channel.connect().await.unwrap()),
            bus: bus::connect(&can).await.unwrap(),
        }
    }

    async fn request(&mut self, node_id: u8, request: Request) -> Response {
        let frame = Frame::standard(request_cob_id(node_id), request.encode());
        self.bus.send(frame).unwrap();
        loop {
            let heard = self.bus.receive().await.unwrap().frame;
            if heard.cob_id() == Some(response_cob_id(node_id)) {
                return Response::decode(heard.data().try_into().unwrap());
            }
        }
    }

    async fn read<T>(&mut self, node_id: u8, object: Object<T>) -> i64 {
        match self.request(node_id, Request::Upload(object.address)).await {
            Response::Upload(address, Initiate::Expedited(payload)) => {
                let entry = dictionary::entry(address).unwrap();
                entry.kind.decode(payload.as_slice()).unwrap()
            }
            other => panic!("{other:?}"),
        }
    }

    async fn write<T>(&mut self, node_id: u8, object: Object<T>, value: i64) {
        let address: Address = object.address;
        let data = dictionary::entry(address).unwrap().kind.encode(value);
        let download = Request::Download(address, Initiate::of(&data));
        let response = self.request(node_id, download).await;
        assert_eq!(response, Response::Download(address));
    }

    async fn inject(&mut self, node_id: u32, fault: Fault) -> Result<u64, Status> {
        let request = InjectDriveFaultRequest {
            node_id,
            fault: Some(DriveFault { fault: Some(fault) }),
        };
        let response = self.faults.inject_drive_fault(request).await?;
        Ok(response.into_inner().fault_id)
    }

    async fn clear(&mut self, fault_id: u64) -> Result<u32, Status> {
        let request = ClearDriveFaultsRequest { fault_id };
        let response = self.faults.clear_drive_faults(request).await?;
        Ok(response.into_inner().cleared)
    }

    async fn truth(&mut self) -> Vec<DriveTruth> {
        let response = self.faults.get_drives(GetDrivesRequest {}).await.unwrap();
        response.into_inner().drives
    }

    /// Enables a drive and lets it move to this position as it counts; until it stands.
    async fn move_to(&mut self, node_id: u8, target_qc: i64) {
        self.write(node_id, objects::TARGET_POSITION, target_qc)
            .await;
        for controlword in [0x06, 0x0F, 0x1F] {
            self.write(node_id, objects::CONTROLWORD, controlword).await;
        }
        let mut standing = 0;
        // A blocked drive is at its limit for a while before it stands.
        while standing < 50 {
            let rpm = self.read(node_id, objects::VELOCITY_ACTUAL).await;
            let moving = self.truth().await[usize::from(node_id) - 1].moving;
            standing = if rpm == 0 && !moving { standing + 1 } else { 0 };
        }
    }

    fn stop(mut self) {
        drop(self.process.stdin.take());
        assert!(self.process.wait().unwrap().success());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_jaw_presses_on_its_block_with_what_the_current_limit_leaves() {
    let mut drives = Drives::start(&["--set", "jaw.tissue_cut_n=200.0"]).await;
    let places: Vec<Position> = drives
        .truth()
        .await
        .iter()
        .map(|it| it.position.unwrap())
        .collect();
    assert_eq!(
        places,
        [
            Position::PositionDeg(0.0),
            Position::PositionMm(2.5),
            Position::PositionDeg(0.0),
            Position::PositionMm(1.3)
        ]
    );
    drives
        .write(2, objects::FOLLOWING_ERROR_WINDOW, i64::from(u32::MAX))
        .await;
    // Slowly, so that the rotor's momentum adds little.
    drives.write(2, objects::PROFILE_VELOCITY, 500).await;
    for limit_ma in [150, 250, 350] {
        drives
            .write(2, objects::OUTPUT_CURRENT_LIMIT, limit_ma)
            .await;
        drives.move_to(2, 9 * 21_504).await;
        let jaw = drives.truth().await.remove(1);
        let Some(Position::PositionMm(feed_mm)) = jaw.position else {
            panic!("{jaw:?}")
        };
        // 2 pi 0.6 · 21 · 9 mNm/A / 2 mm, less 40 mA of friction and the spring.
        let screw_n = 0.356_3 * (limit_ma as f64 - 40.0);
        let expected_n = screw_n - 0.5 * feed_mm;
        assert!(
            (jaw.jaw_force_n - expected_n).abs() < 0.1 * expected_n,
            "{limit_ma} mA: {} N for {expected_n} N at {feed_mm} mm",
            jaw.jaw_force_n
        );
        assert_eq!(jaw.drive_state, "OPERATION_ENABLED");
        drives.write(2, objects::OUTPUT_CURRENT_LIMIT, 800).await;
        drives.move_to(2, 0).await;
    }
    drives.stop();
}

#[tokio::test(flavor = "multi_thread")]
async fn faults_are_ordered_listed_waited_for_and_cleared() {
    let mut drives = Drives::start(&["--nodes", "1-2"]).await;
    let id = drives
        .inject(2, Fault::SilentSdo(SilentSdo {}))
        .await
        .unwrap();
    let unanswered = Request::Upload(objects::STATUSWORD.address).encode();
    for _ in 0..3 {
        let request = Frame::standard(request_cob_id(2), unanswered);
        drives.bus.send(request).unwrap();
    }
    let wait = WaitForDriveFaultRequest {
        fault_id: id,
        affected: 3,
    };
    let met = drives.faults.wait_for_drive_fault(wait).await.unwrap();
    assert_eq!(met.into_inner().affected, 3);
    let gear = Fault::Gear(GearRatio {
        numerator: 4,
        denominator: 1,
    });
    drives.inject(0, gear).await.unwrap();
    assert_eq!(drives.read(1, objects::GEAR_NUMERATOR).await, 4);
    let list = drives.faults.list_drive_faults(ListDriveFaultsRequest {});
    let list = list.await.unwrap().into_inner().faults;
    let told: Vec<_> = list
        .iter()
        .map(|it| (it.node_id, it.affected, it.fault.unwrap().fault.unwrap()))
        .collect();
    assert_eq!(told, [(2, 3, Fault::SilentSdo(SilentSdo {})), (0, 2, gear)]);
    assert_eq!(drives.clear(0).await.unwrap(), 2);
    assert_eq!(drives.read(2, objects::GEAR_NUMERATOR).await, 21);
    let refusal = drives.clear(id).await.unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("FAULT_NOT_FOUND"));
    drives.stop();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dropped_node_and_a_bus_off_host_are_told_as_they_are() {
    let mut drives = Drives::start(&[]).await;
    let id = drives
        .inject(3, Fault::DropNode(DroppedNode {}))
        .await
        .unwrap();
    let truth = drives.truth().await.remove(2);
    assert!(!truth.supplied);
    drives.clear(id).await.unwrap();
    loop {
        let heard = drives.bus.receive().await.unwrap().frame;
        if heard == Frame::standard(0x703, [0]) {
            break;
        }
    }
    drives.inject(0, Fault::BusOff(BusOff {})).await.unwrap();
    loop {
        let heard = drives.bus.receive().await.unwrap().frame;
        if let Some(report) = Report::decode(&heard) {
            assert_eq!(report.state(), Some(ControllerState::BusOff));
            break;
        }
    }
    drives.stop();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fault_that_cannot_be_is_refused_by_field_value_and_limit() {
    let mut drives = Drives::start(&[]).await;
    let frames = |share| RandomFrames { share, seed: 1 };
    for (node_id, fault, field, words) in [
        (
            9,
            Fault::SilentSdo(SilentSdo {}),
            "node_id",
            "9 is not on the bus, [1, 2, 3, 4] are",
        ),
        (2, Fault::BusOff(BusOff {}), "node_id", "2 must be 0"),
        (
            2,
            Fault::LateHeartbeatS(f64::NAN),
            "fault.late_heartbeat_s",
            "0.001 .. 60 s",
        ),
        (
            2,
            Fault::SlowSdoS(61.0),
            "fault.slow_sdo_s",
            "61 must be within 0.001 .. 60 s",
        ),
        (
            2,
            Fault::Emergency(0x1_0000),
            "fault.emergency",
            "65536 must be within 1 .. 65535",
        ),
        (
            2,
            Fault::Emergency(0),
            "fault.emergency",
            "0 must be within",
        ),
        (
            2,
            Fault::SlippingBeltShare(1.5),
            "fault.slipping_belt_share",
            "1.5 must be above 0",
        ),
        (
            2,
            Fault::CutWireInput(9),
            "fault.cut_wire_input",
            "9 must be within 1 .. 8",
        ),
        (
            2,
            Fault::PressedSwitchInput(0),
            "fault.pressed_switch_input",
            "0 must be within 1 .. 8",
        ),
        (
            2,
            Fault::CorruptFrame(frames(-0.1)),
            "fault.corrupt_frame.share",
            "-0.1 must be above 0",
        ),
        (
            2,
            Fault::LostPdo(frames(f64::NAN)),
            "fault.lost_pdo.share",
            "NaN must be above 0",
        ),
        (
            2,
            Fault::SupplyV(-1.0),
            "fault.supply_v",
            "-1 must be within 0 .. 100 V",
        ),
        (
            2,
            Fault::PowerStageC(900.0),
            "fault.power_stage_c",
            "900 must be",
        ),
        (
            2,
            Fault::I2tMotorPercent(201.0),
            "fault.i2t_motor_percent",
            "201 must be",
        ),
    ] {
        let refusal = drives.inject(node_id, fault).await.unwrap_err();
        assert_eq!(refusal.code(), Code::InvalidArgument);
        let (named, description) = status::violations(&refusal).remove(0);
        assert_eq!(named, field);
        assert!(description.contains(words), "{description}");
    }
    let nothing = InjectDriveFaultRequest::default();
    let refusal = drives.faults.inject_drive_fault(nothing).await.unwrap_err();
    assert_eq!(status::violations(&refusal)[0].0, "fault");
    let list = drives.faults.list_drive_faults(ListDriveFaultsRequest {});
    assert_eq!(
        list.await.unwrap().into_inner().faults,
        [],
        "a refused fault leaves nothing"
    );
    drives.stop();
}
