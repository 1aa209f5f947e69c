//! The simulated operating cell: two UR5 controllers, four EPOS4 drives, a depth camera, a knee with
//! tissue, and a referee that knows the truth.
//!
//! Everything is reached through the wires that a real cell has (RTDE, URScript, dashboard, CAN), and
//! the camera and the referee through gRPC. One seed makes a whole case: [`scenario`]. The truth lives
//! in [`cell`] and is pure; [`clock`] lets it pass. [`standalone`] is one device without a cell.

pub mod bench;
pub mod calibration_board;
pub mod camera;
pub mod cell;
pub mod clock;
pub mod config;
pub mod divot;
pub mod epos4;
pub mod error;
pub mod jaw;
pub mod knee;
pub mod referee;
pub mod scenario;
pub mod server;
pub mod standalone;
pub mod ur5;
pub mod voxels;

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::bench_service_server::BenchServiceServer;
use arthro_proto::simulator::v1::camera_service_server::CameraServiceServer;
use arthro_proto::simulator::v1::drive_fault_service_server::DriveFaultServiceServer;
use arthro_proto::simulator::v1::fault_service_server::FaultServiceServer;
use arthro_proto::simulator::v1::referee_service_server::RefereeServiceServer;
use tonic::service::Routes;

use crate::camera::Camera;
use crate::cell::Cell;
use crate::clock::{Arm, Driven};
use crate::config::ArmConfig;
pub use crate::config::Config;
pub use crate::error::Error;
use crate::server::{BenchApi, CameraApi, DriveFaultApi, FaultApi, Patient, RefereeApi};

/// The simulator as a server.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "simulator";
    const DEFAULT_PORT: u16 = 50059;
    const HELP_AFTER: &'static str = "With `ur5` or `epos4` as first argument: one such device alone, see `arthro-simulator epos4 --help`.";
    type Config = Config;

    async fn build(config: Config, host: Host) -> Result<Routes, BoxError> {
        let scenario = Arc::new(config.checked()?.scenario()?);
        let [forceps_rad, arthroscope_rad] = scenario.spec.layout.start_joints_rad;
        let arms = [
            arm(&config.forceps_arm, forceps_rad).await?,
            arm(&config.arthroscope_arm, arthroscope_rad).await?,
        ];
        let bus = epos4::Bus::new(cell::axes::drives());
        let can = epos4::socketcand::serve(config.can_listen, Arc::clone(&bus))
            .await
            .map_err(|source| Error::Listen {
                address: config.can_listen,
                source,
            })?;
        let cell = Arc::new(Mutex::new(Cell::new(&scenario)));
        let arm_addresses = [&arms[0], &arms[1]].map(|arm| address(&arm.servers.addresses()));
        let can_address = format!("socketcand://{}/can0", can.address());
        tracing::info!(
            forceps = %arm_addresses[0],
            arthroscope = %arm_addresses[1],
            can = %can_address,
            time_scale = config.time_scale,
            "the cell is on its wires"
        );
        let names = [common::Arm::Forceps, common::Arm::Arthroscope];
        let patients = names.into_iter().zip(&arms).map(|(name, arm)| Patient {
            arm: name,
            controller: Arc::clone(&arm.controller),
            links: Arc::clone(arm.servers.links()),
        });
        let faults = FaultApi::new(patients.collect());
        let drive_faults = DriveFaultApi::new(Arc::clone(&bus));
        let options = clock::Options {
            time_scale: config.time_scale,
            client_wait: Duration::from_millis(config.client_wait_ms),
        };
        let driven = Driven {
            cell: Arc::clone(&cell),
            arms,
            bus,
        };
        let (clock, ticking) = clock::start(options, driven);
        tokio::spawn(async move {
            host.drain.started().await;
            ticking.abort();
            // The bus goes last: whoever drains still hears its drives.
            drop(can);
        });
        let bench = BenchApi::new(Arc::clone(&scenario), Arc::clone(&cell));
        let camera = CameraApi::new(Camera::new(&scenario), bench.clone());
        let referee = RefereeApi {
            scenario,
            cell,
            clock,
            arm_addresses,
            can_address,
        };
        Ok(Routes::new(CameraServiceServer::new(camera))
            .add_service(BenchServiceServer::new(bench))
            .add_service(RefereeServiceServer::new(referee))
            .add_service(FaultServiceServer::new(faults))
            .add_service(DriveFaultServiceServer::new(drive_faults)))
    }
}

/// A controller on its wires, the arm at its start.
async fn arm(config: &ArmConfig, joints_rad: [f64; 6]) -> Result<Arm, Error> {
    let arm = ur5::Config {
        joints_rad,
        powered: config.powered,
        version: config.version,
        ..ur5::Config::of(config.series)
    };
    arm.checked().map_err(Error::from)?;
    let controller = Arc::new(Mutex::new(ur5::Controller::new(arm)));
    let servers = ur5::serve(Arc::clone(&controller), config.options())
        .await
        .map_err(|source| Error::Listen {
            address: SocketAddr::new(config.bind, config.rtde_port),
            source,
        })?;
    Ok(Arm {
        controller,
        servers,
    })
}

/// The host alone when all ports are the standard ones, else `host:dashboard:rtde:script`.
fn address(bound: &ur5::servers::Addresses) -> String {
    let standard = ur5::Ports::default();
    let host = bound.rtde.ip();
    let ports = [bound.dashboard, bound.rtde, bound.realtime].map(|address| address.port());
    if ports == [standard.dashboard, standard.rtde, standard.realtime] {
        return host.to_string();
    }
    let [dashboard, rtde, script] = ports;
    format!("{host}:{dashboard}:{rtde}:{script}")
}
