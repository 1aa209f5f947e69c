//! Where things are: the preoperative model in what the camera sees, the camera and the tool on their arms, the surface
//! in a scan.
//!
//! - [`pipeline::register`] finds the model in a view at any scale and judges what it found, without any server. It
//!   prepares a [`problem`] (a [`model`] and a [`view`]), searches it by the [`robust`] or the [`paper`] pipeline, gathers
//!   the [`evidence`] and holds it to the [`gate`].
//! - [`depth::from_view`] makes the view from depth images, [`mod@reconstruct`] the model from a scan.
//! - [`calibration`] finds mountings and tool tips.

pub mod budget;
pub mod calibration;
pub mod cells;
pub mod config;
pub mod contact;
pub mod covariance;
pub mod depth;
pub mod error;
pub mod evidence;
pub mod gate;
pub mod input;
pub mod lattice;
pub mod model;
pub mod moments;
pub mod mse;
pub mod neighbours;
pub mod paper;
pub mod pipeline;
pub mod problem;
pub mod reconstruct;
pub mod robust;
pub mod sampling;
pub mod scale;
pub mod scaled_icp;
mod server;
pub mod super4pcs;
pub mod view;
pub mod visibility;

use arthro_bootstrap::{BoxError, Host};
use tonic::service::Routes;

pub use crate::config::Config;

/// The registration server: stateless, any replica may answer.
#[derive(Debug)]
pub struct Server;

impl arthro_bootstrap::Service for Server {
    const NAME: &'static str = "registration";
    const DEFAULT_PORT: u16 = 50051;
    type Config = Config;

    async fn build(config: Config, _host: Host) -> Result<Routes, BoxError> {
        if config.max_computations == 0 {
            return Err("registration.max_computations is 0, must be at least 1".into());
        }
        Ok(server::routes(&config))
    }
}
