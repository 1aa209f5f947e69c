//! arthro-planning: decides which bites leave a smooth crescent.
//!
//! A plan is made in stages, each a module: the meniscus becomes [`voxels`] in the axes of its
//! [`crescent`]; the contour of the [`target`] leads outboard of the [`lesion`]; the [`bites`] of the
//! [`jaw`] clear what lies inboard of it, each at a time at which the [`tissue`] lets it; the
//! [`evaluation`] scores them. The [`paper`]'s own planner stands beside it for comparison. [`plan`]
//! runs the stages, [`server`] serves them. All but the server is pure: same request and seed, same
//! plan.

pub mod band;
mod banded;
pub mod bites;
pub mod config;
pub mod contour;
pub mod crescent;
pub mod error;
pub mod evaluation;
pub mod jaw;
pub mod lesion;
pub mod paper;
pub mod plan;
pub mod reach;
pub mod server;
pub mod target;
pub mod tissue;
pub mod view;
pub mod voxels;

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::planning::v1::planning_service_server::PlanningServiceServer;

pub use config::Config;
pub use error::Error;

/// The planning server.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "planning";
    const DEFAULT_PORT: u16 = 50052;
    type Config = Config;

    async fn build(config: Config, _host: Host) -> Result<tonic::service::Routes, BoxError> {
        if config.max_computations == 0 {
            return Err("planning.max_computations is 0; must be at least 1".into());
        }
        let planning = server::Planning::new(&config);
        Ok(tonic::service::Routes::new(PlanningServiceServer::new(
            planning,
        )))
    }
}
