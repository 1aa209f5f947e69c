//! What every server of the house shares, and nothing else: configuration, telemetry, TLS, limits,
//! health, reflection and the drain.
//!
//! A server is a [`Service`]; its `main.rs` is one line:
//!
//! ```ignore
//! fn main() -> std::process::ExitCode {
//!     arthro_bootstrap::main::<arthro_planning::Server>()
//! }
//! ```
//!
//! The order of the boot: flags, configuration (no port is bound yet), telemetry, devices and owner
//! tasks ([`Service::build`]), bind, announce the address, serve, drain on a signal.

pub mod calls;
pub mod config;
mod drain;
mod host;
pub mod identity;
mod reflection;
mod run;
mod serve;
pub mod status;
mod telemetry;

use std::fmt::Debug;

use serde::Serialize;
use serde::de::DeserializeOwned;

pub use crate::calls::Deadline;
pub use crate::config::ServerConfig;
pub use crate::drain::{Drain, Hold};
pub use crate::host::{Host, RefusedCall};
pub use crate::identity::{Caller, Role};
pub use crate::run::{ExitStatus, main, run};

/// Any error that ends the boot.
pub type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// One server of the house.
pub trait Service: Sized + Send + 'static {
    /// The service's name: the section of the configuration file, the environment's prefix
    /// (`ARTHRO_<NAME>__`), and the package `arthro.<name>.v1` of its API.
    const NAME: &'static str;

    /// The port it listens on unless told otherwise.
    const DEFAULT_PORT: u16;

    /// Full names of the gRPC services it offers, where these are not all of its package.
    const OFFERS: Option<&'static [&'static str]> = None;

    /// What `--help` says after the flags.
    const HELP_AFTER: &'static str = "";

    /// The fields of the service's section beside `server`.
    type Config: Serialize + DeserializeOwned + Default + Send + Debug;

    /// Checks the configuration, connects devices, spawns owner tasks, returns the routes.
    ///
    /// # Errors
    /// Anything that must keep the server from starting.
    fn build(
        config: Self::Config,
        host: Host,
    ) -> impl Future<Output = Result<tonic::service::Routes, BoxError>> + Send;
}
