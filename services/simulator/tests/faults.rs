//! Faults as a client orders them over gRPC, and a controller alone as anybody's tests start it.

// Helpers of a test may panic as the test itself does.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use arthro_bootstrap::status;
use arthro_bootstrap::{Host, Service};
use arthro_proto::common::v1::Arm;
use arthro_proto::simulator::v1::fault_service_client::FaultServiceClient;
use arthro_proto::simulator::v1::inject_robot_fault_request::Fault;
use arthro_proto::simulator::v1::{
    ClearFaultsRequest, ControlPlace, EmergencyStopFault, InjectLinkFaultRequest,
    InjectRobotFaultRequest, JointFault, JointNumbers, LinkFaultKind, LinkFaultSpec,
    ListFaultsRequest, ListFaultsResponse, PacketDirection, SafeguardState, StopButton, UrService,
    VersionClaim, WaitForLinkFaultRequest,
};
use arthro_simulator::standalone::ur5::{Config, PortChoice, Standalone};
use arthro_simulator::ur5;
use tokio::io::AsyncReadExt;
use tokio::net::{TcpListener, TcpStream};
use tonic::transport::Channel;
use tonic::transport::server::TcpIncoming;
use tonic::{Code, Status};

/// A controller alone, powered, on free ports; ends with the test's runtime.
struct Served(FaultServiceClient<Channel>);

impl Served {
    async fn of(series: ur5::Series) -> Self {
        let config = Config {
            ports: PortChoice::Free,
            arm: ur5::Config {
                powered: true,
                ..ur5::Config::of(series)
            },
            ..Config::default()
        };
        let routes = Standalone::build(config, Host::alone()).await.unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(
            tonic::transport::Server::builder()
                .add_routes(routes)
                .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true))),
        );
        let channel = Channel::from_shared(format!("http://{address}")).unwrap();
        Self(FaultServiceClient::new(channel.connect().await.unwrap()))
    }

    async fn link(&mut self, fault: LinkFaultSpec) -> Result<u64, Status> {
        let request = InjectLinkFaultRequest {
            arm: Arm::Unspecified.into(),
            fault: Some(fault),
        };
        let response = self.0.inject_link_fault(request).await?;
        Ok(response.into_inner().fault_id)
    }

    async fn robot(&mut self, fault: Fault) -> Result<(), Status> {
        let request = InjectRobotFaultRequest {
            arm: Arm::Unspecified.into(),
            fault: Some(fault),
        };
        self.0.inject_robot_fault(request).await.map(drop)
    }

    async fn list(&mut self) -> ListFaultsResponse {
        let response = self.0.list_faults(ListFaultsRequest {}).await;
        response.unwrap().into_inner()
    }
}

fn drop_all() -> LinkFaultSpec {
    LinkFaultSpec {
        kind: LinkFaultKind::Drop.into(),
        service: UrService::Rtde.into(),
        ..LinkFaultSpec::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_link_fault_is_listed_until_it_is_cleared() {
    let mut served = Served::of(ur5::Series::E).await;
    let id = served.link(drop_all()).await.unwrap();
    let listed = served.list().await;
    assert_eq!((listed.links.len(), listed.links[0].fault_id), (1, id));
    let told = listed.links[0].fault.clone().unwrap();
    assert_eq!((told.kind(), told.share), (LinkFaultKind::Drop, 1.0));
    let cleared = served
        .0
        .clear_faults(ClearFaultsRequest { fault_id: id })
        .await;
    assert_eq!(cleared.unwrap().into_inner().cleared, 1);
    assert_eq!(served.list().await.links, []);
    for refusal in [
        served
            .0
            .clear_faults(ClearFaultsRequest { fault_id: id })
            .await
            .unwrap_err(),
        served
            .0
            .wait_for_link_fault(WaitForLinkFaultRequest {
                fault_id: id,
                affected: 1,
            })
            .await
            .unwrap_err(),
    ] {
        assert_eq!(refusal.code(), Code::NotFound);
        assert_eq!(status::reason(&refusal).as_deref(), Some("FAULT_NOT_FOUND"));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_makes_no_sense_is_refused_by_field() {
    let mut served = Served::of(ur5::Series::E).await;
    let spec = drop_all();
    for (fault, field) in [
        (LinkFaultSpec::default(), "fault.kind"),
        (
            LinkFaultSpec {
                share: f64::NAN,
                ..spec.clone()
            },
            "fault.share",
        ),
        (
            LinkFaultSpec {
                share: 1.1,
                ..spec.clone()
            },
            "fault.share",
        ),
        (
            LinkFaultSpec {
                service: 99,
                ..spec.clone()
            },
            "fault.service",
        ),
        (
            LinkFaultSpec {
                kind: LinkFaultKind::Delay.into(),
                ..spec.clone()
            },
            "fault.delay_s",
        ),
        (
            LinkFaultSpec {
                kind: LinkFaultKind::Nan.into(),
                service: UrService::Dashboard.into(),
                ..spec.clone()
            },
            "fault.service",
        ),
        (
            LinkFaultSpec {
                kind: LinkFaultKind::Stall.into(),
                direction: PacketDirection::ToController.into(),
                ..spec
            },
            "fault.direction",
        ),
    ] {
        let refusal = served.link(fault).await.unwrap_err();
        assert_eq!(refusal.code(), Code::InvalidArgument);
        assert_eq!(status::violations(&refusal)[0].0, field);
    }
    let numbers = |values: &[f64]| JointNumbers {
        values: values.to_vec(),
    };
    for (fault, field) in [
        (
            Fault::Joint(JointFault {
                joint: 6,
                failed: true,
            }),
            "joint.joint",
        ),
        (Fault::ExtraLagS(numbers(&[0.1; 5])), "extra_lag_s"),
        (Fault::ExtraLagS(numbers(&[-0.1; 6])), "extra_lag_s"),
        (
            Fault::EncoderOffsetRad(numbers(&[f64::NAN; 6])),
            "encoder_offset_rad",
        ),
        (Fault::SpeedSlider(2.0), "speed_slider"),
        (Fault::Safeguard(0), "safeguard"),
        (
            Fault::Version(VersionClaim {
                service: UrService::Rtde.into(),
                version: "new".to_owned(),
            }),
            "version.version",
        ),
    ] {
        let refusal = served.robot(fault).await.unwrap_err();
        assert_eq!(status::violations(&refusal)[0].0, field);
    }
    let request = InjectRobotFaultRequest {
        arm: Arm::Forceps.into(),
        fault: Some(Fault::SpeedSlider(1.0)),
    };
    let refusal = served.0.inject_robot_fault(request).await.unwrap_err();
    assert_eq!(status::violations(&refusal)[0].0, "arm");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_happens_to_an_arm_is_told_and_cleared() {
    let mut served = Served::of(ur5::Series::E).await;
    let lag = JointNumbers {
        values: vec![0.02; 6],
    };
    for fault in [
        Fault::EmergencyStop(EmergencyStopFault {
            button: StopButton::System.into(),
            pressed: true,
        }),
        Fault::Safeguard(SafeguardState::Open.into()),
        Fault::Control(ControlPlace::Local.into()),
        Fault::ExtraLagS(lag),
        Fault::SpeedSlider(0.5),
    ] {
        served.robot(fault).await.unwrap();
    }
    let told = served.list().await.robots.remove(0);
    assert_eq!(told.safety_mode, "SYSTEM_EMERGENCY_STOP");
    assert!(told.system_button_pressed && !told.robot_button_pressed);
    assert_eq!(told.safeguard(), SafeguardState::Open);
    assert_eq!(told.control(), ControlPlace::Local);
    assert_eq!((told.extra_lag_s[2], told.speed_slider), (0.02, 0.5));
    served
        .0
        .clear_faults(ClearFaultsRequest { fault_id: 0 })
        .await
        .unwrap();
    let told = served.list().await.robots.remove(0);
    assert_eq!(told.safety_mode, "NORMAL");
    assert_eq!(
        (told.extra_lag_s[2], told.control()),
        (0.0, ControlPlace::Remote)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cb3_has_no_local_control_and_an_arm_without_power_no_protective_stop() {
    let mut served = Served::of(ur5::Series::Cb3).await;
    let refusal = served
        .robot(Fault::Control(ControlPlace::Local.into()))
        .await
        .unwrap_err();
    assert_eq!(
        status::reason(&refusal).as_deref(),
        Some("NO_REMOTE_CONTROL")
    );
    served
        .robot(Fault::PowerOff(Default::default()))
        .await
        .unwrap();
    let stop = Fault::ProtectiveStop("collision".to_owned());
    let refusal = served.robot(stop).await.unwrap_err();
    assert_eq!(status::reason(&refusal).as_deref(), Some("ARM_NOT_RUNNING"));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_program_tells_its_ports_and_a_client_can_wait_for_a_fault() {
    let mut process = Command::new(env!("CARGO_BIN_EXE_arthro-simulator"))
        .args(["ur5", "--ports", "free", "--series", "e", "--powered"])
        .args(["--grpc", "127.0.0.1:0", "--until-stdin-closes"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(process.stdout.take().unwrap()).lines();
    let mut quoted = || -> Vec<String> {
        let line = lines.next().unwrap().unwrap();
        line.split('"').map(str::to_owned).collect()
    };
    let after = |words: &[String], name: &str| {
        let at = words.iter().position(|word| word == name).unwrap();
        words[at + 2].clone()
    };
    let controller = quoted();
    let grpc = after(&quoted(), "address");
    let mut realtime = TcpStream::connect(after(&controller, "realtime"))
        .await
        .unwrap();
    assert_eq!(realtime.read_i32().await.unwrap(), 1220);
    let channel = Channel::from_shared(format!("http://{grpc}")).unwrap();
    let mut faults = FaultServiceClient::new(channel.connect().await.unwrap());
    let request = InjectLinkFaultRequest {
        arm: Arm::Unspecified.into(),
        fault: Some(LinkFaultSpec {
            service: UrService::Realtime.into(),
            ..drop_all()
        }),
    };
    let response = faults.inject_link_fault(request).await.unwrap();
    let wait = WaitForLinkFaultRequest {
        fault_id: response.into_inner().fault_id,
        affected: 25,
    };
    let met = faults.wait_for_link_fault(wait).await.unwrap().into_inner();
    assert!(met.affected >= 25);
    drop(process.stdin.take());
    assert!(process.wait().unwrap().success());
}
