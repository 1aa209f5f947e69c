//! One simulated controller without a cell around it: `arthro-simulator ur5`, for anybody's tests.

mod flags;

use std::io::Write as _;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::common::v1 as common;
use arthro_proto::simulator::v1::fault_service_server::FaultServiceServer;
use serde::{Deserialize, Serialize};
use tonic::service::Routes;

pub use self::flags::main;
use super::Pace;
use crate::Error;
use crate::clock::lock;
use crate::server::{FaultApi, Patient};
use crate::ur5::{self, Controller, Ports, ServerOptions, Servers, Shared};

/// The section `[ur5]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Address of the controller. Foreign clients have the ports fixed, so two controllers need two addresses.
    pub bind: IpAddr,
    /// The ports of a real controller, or free ones.
    pub ports: PortChoice,
    /// Speed of the controller's clock against the wall clock, 0.01 .. 1000. Above 1 it waits for clients that control.
    pub time_scale: f64,
    /// Above real time the clock waits this long for a client that owes an answer, ms, 1 .. 10000.
    pub client_wait_ms: u64,
    /// What the arm is like.
    pub arm: ur5::Config,
}

/// Which ports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum PortChoice {
    /// 29999, 30001-30004, 30011-30013.
    #[default]
    Standard,
    /// Any; the first line of standard output tells them.
    Free,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            bind: IpAddr::V4(Ipv4Addr::LOCALHOST),
            ports: PortChoice::Standard,
            time_scale: 1.0,
            client_wait_ms: 1000,
            arm: ur5::Config::default(),
        }
    }
}

/// The controller as a server: the wires of the real one, and faults over gRPC.
#[derive(Debug)]
pub struct Standalone;

impl Service for Standalone {
    const NAME: &'static str = "ur5";
    const DEFAULT_PORT: u16 = 50059;
    const OFFERS: Option<&'static [&'static str]> = Some(&["arthro.simulator.v1.FaultService"]);
    type Config = Config;

    async fn build(config: Config, host: Host) -> Result<Routes, BoxError> {
        config.checked()?;
        let controller: Shared = Arc::new(Mutex::new(Controller::new(config.arm.clone())));
        let options = ServerOptions {
            bind: config.bind,
            ports: match config.ports {
                PortChoice::Standard => Ports::default(),
                PortChoice::Free => Ports::FREE,
            },
            ..ServerOptions::default()
        };
        let servers = ur5::serve(Arc::clone(&controller), options)
            .await
            .map_err(|source| Error::Listen {
                address: SocketAddr::new(config.bind, options.ports.rtde),
                source,
            })?;
        announce(&servers)?;
        let patient = Patient {
            arm: common::Arm::Unspecified,
            controller: Arc::clone(&controller),
            links: Arc::clone(servers.links()),
        };
        let ticking = tokio::spawn(run(config, controller, servers));
        tokio::spawn(async move {
            host.drain.started().await;
            ticking.abort();
        });
        let faults = FaultApi::new(vec![patient]);
        Ok(Routes::new(FaultServiceServer::new(faults)))
    }
}

impl Config {
    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// Names the first one.
    pub fn checked(&self) -> Result<&Self, BoxError> {
        self.arm
            .checked()
            .map_err(|error| format!("ur5.arm.{error}"))?;
        if !(0.01..=1000.0).contains(&self.time_scale) {
            return Err(Box::new(Error::Config {
                field: "ur5.time_scale",
                value: self.time_scale.to_string(),
                limit: "0.01 .. 1000",
            }));
        }
        if !(1..=10_000).contains(&self.client_wait_ms) {
            return Err(Box::new(Error::Config {
                field: "ur5.client_wait_ms",
                value: self.client_wait_ms.to_string(),
                limit: "1 .. 10000 ms",
            }));
        }
        Ok(self)
    }
}

/// One line of JSON for scripts that wait for the controller.
fn announce(servers: &Servers) -> std::io::Result<()> {
    let named = servers.addresses().named();
    let fields = named.map(|(name, address)| format!(r#""{name}":"{address}""#));
    let mut out = std::io::stdout();
    writeln!(out, r#"{{"ur5":{{{}}}}}"#, fields.join(","))?;
    out.flush()
}

/// Ticks the controller until the task is aborted.
async fn run(config: Config, controller: Shared, servers: Servers) {
    let step_s = lock(&controller).step_s();
    let client_wait = Duration::from_millis(config.client_wait_ms);
    let mut pace = Pace::new(step_s, config.time_scale);
    loop {
        pace.next().await;
        lock(&controller).tick();
        servers.ticked();
        if config.time_scale > 1.0 {
            servers.wait_for_clients(client_wait).await;
        }
        tokio::task::yield_now().await;
    }
}
