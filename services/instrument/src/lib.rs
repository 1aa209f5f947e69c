//! Drives the four axes of the two instruments: positions in mm and degrees, homing, the bite, and the supervision of
//! the EPOS4 drives behind a CANopen bus.
//!
//! [`axis`], [`check`], [`homing`], [`positioning`], [`bite`], [`force`], [`switches`] and [`supervisor`] decide, without
//! I/O; [`drives`] is the task that owns the bus and acts; [`server`] is the API.

pub mod axis;
pub mod bite;
pub mod check;
pub mod config;
pub mod drives;
pub mod error;
pub mod force;
pub mod homing;
pub mod positioning;
pub mod server;
pub mod supervisor;
pub mod switches;

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::instrument::v1::instrument_service_server::InstrumentServiceServer;
use tonic::service::Routes;

/// The instrument service.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "instrument";
    const DEFAULT_PORT: u16 = 50054;
    type Config = config::Config;

    async fn build(config: Self::Config, host: Host) -> Result<Routes, BoxError> {
        let (drives, handle) = drives::Drives::new(config.check()?);
        let (hold, draining) = (host.drain.hold(), host.drain.clone());
        tokio::spawn(async move {
            drives.run(draining).await;
            drop(hold);
        });
        Ok(Routes::new(InstrumentServiceServer::new(
            server::Instrument::new(handle, host.drain),
        )))
    }
}
