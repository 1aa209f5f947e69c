//! Moves the two UR5 arms of a cell: free moves outside, and pivots, insertions and retractions whose
//! shaft stays on the portal.
//!
//! [`kinematics`], [`rcm`], [`time_law`], [`trajectory`], [`free_way`], [`way`], [`plan`], [`sweep`], [`clearance`], [`check`] and
//! [`supervisor`] decide, without I/O; [`teach`] finds portals and shafts from poses; [`cell`] is where the two
//! owners see each other; [`arm`] is the task that owns an arm and acts; [`command`] keeps the lease and the
//! remembered operations; [`server`] is the API.

pub mod arm;
pub mod bodies;
pub mod cell;
pub mod check;
pub mod clearance;
pub mod command;
pub mod config;
pub mod controller;
pub mod error;
pub mod free_way;
pub mod kinematics;
pub mod layout;
pub mod limits;
pub mod plan;
pub mod rcm;
pub mod roll;
pub mod server;
pub mod supervisor;
pub mod sweep;
pub mod teach;
pub mod time_law;
pub mod trajectory;
pub mod way;
pub mod workspace;

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::motion::v1::motion_service_server::MotionServiceServer;
use arthro_proto::motion::v1::teaching_service_server::TeachingServiceServer;
use tonic::service::Routes;

use self::command::Commander;
use self::config::{ArmSetup, Config};
use self::controller::UrController;
use self::server::{Arm, Motion};

/// The motion service.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "motion";
    const DEFAULT_PORT: u16 = 50053;
    type Config = Config;

    async fn build(config: Config, host: Host) -> Result<Routes, BoxError> {
        let mut forceps = config.arms.forceps.check("forceps")?;
        let mut arthroscope = config.arms.arthroscope.check("arthroscope")?;
        config.layout.seat(&mut forceps, &mut arthroscope)?;
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH)?;
        let started = Instant::now();
        let start = u64::try_from(since_1970.as_millis())?;
        let commander = Commander::new(start, Box::new(move || started.elapsed()));
        let arms = [
            start_arm(forceps, &commander),
            start_arm(arthroscope, &commander),
        ];
        let motion = Motion::new(commander, arms, host.drain.clone());
        let stopped = motion.clone();
        tokio::spawn(async move {
            host.drain.started().await;
            stopped.stop_all("the service is shutting down").await;
        });
        Ok(Routes::new(MotionServiceServer::new(motion.clone()))
            .add_service(TeachingServiceServer::new(motion)))
    }
}

/// Starts the owner of an arm; it connects in the background.
fn start_arm(setup: ArmSetup, commander: &Commander) -> Arm {
    let (connector, controller) = UrController::new(setup.link);
    let (handle, owner) = setup.options.start(connector, commander.clone());
    tokio::spawn(owner.run());
    Arm {
        handle,
        controller,
        neutral_joints_rad: setup.neutral_joints_rad,
    }
}
