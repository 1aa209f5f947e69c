//! Finds the pose of a preoperative model in what the camera sees: the paper's Super4PCS and scaled ICP, kept robust
//! on partial views, and an honest verdict. [`pipeline::register`] is the whole of it without any server;
//! [`depth::deproject`] makes the view from a depth image.

pub mod calibration;
pub mod cancel;
pub mod config;
pub mod depth;
pub mod error;
mod field;
pub mod input;
pub mod mse;
pub mod neighbours;
pub mod pipeline;
pub mod sampling;
pub mod scaled_icp;
pub mod seeds;
mod server;
pub mod super4pcs;
pub mod surface;
pub mod verdict;
pub mod visibility;

use arthro_bootstrap::{BoxError, Drain};
use tonic::service::Routes;

pub use crate::config::Config;

/// The registration server: stateless, any replica may answer.
#[derive(Debug)]
pub struct Server;

impl arthro_bootstrap::Service for Server {
    const NAME: &'static str = "registration";
    const DEFAULT_PORT: u16 = 50051;
    type Config = Config;

    async fn build(config: Config, _drain: Drain) -> Result<Routes, BoxError> {
        if config.max_computations == 0 {
            return Err("registration.max_computations is 0, must be at least 1".into());
        }
        Ok(server::routes(&config))
    }
}
