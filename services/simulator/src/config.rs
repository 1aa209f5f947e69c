//! The section `[simulator]`: which case, where the wires are, how fast the cell's clock runs.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;

use arthro_geometry::ply;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::scenario::{Scenario, Spec};
use crate::ur5::{Ports, Series, ServerOptions, Version};

/// What can be set.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Folder of a saved scenario. Without one the case is made from `model` and `seed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scenario: Option<PathBuf>,
    /// A meniscus surface (PLY that states its space and unit). Without one the phantom is used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<PathBuf>,
    /// Where the knee lies and what noise the camera has.
    pub seed: u64,
    /// Speed of the cell's clock against the wall clock, 0.01 .. 1000.
    pub time_scale: f64,
    /// Above real time the clock waits this long for a client that owes an answer, ms, 1 .. 10000.
    pub client_wait_ms: u64,
    /// Controller of the forceps arm.
    pub forceps_arm: ArmConfig,
    /// Controller of the arthroscope arm.
    pub arthroscope_arm: ArmConfig,
    /// Where the drives' bus is served by the socketcand protocol; port 0 takes a free one.
    pub can_listen: SocketAddr,
}

/// One arm's controller.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArmConfig {
    /// Foreign clients have the ports fixed, so each arm has an address of its own.
    pub bind: IpAddr,
    /// Dashboard server; 0 takes a free port, as for the others.
    pub dashboard_port: u16,
    /// Primary interface.
    pub primary_port: u16,
    /// Secondary interface.
    pub secondary_port: u16,
    /// Realtime interface.
    pub realtime_port: u16,
    /// RTDE.
    pub rtde_port: u16,
    /// Primary interface that takes no programs.
    pub primary_read_only_port: u16,
    /// Secondary interface that takes no programs.
    pub secondary_read_only_port: u16,
    /// Realtime interface that takes no programs.
    pub realtime_read_only_port: u16,
    /// Generation of the controller. The referee knows the bodies of a CB3 arm (UR5) only.
    pub series: Series,
    /// Software of the controller; unset: that of its series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<Version>,
    /// Starts with brakes released, not powered off.
    pub powered: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            scenario: None,
            model: None,
            seed: 1,
            time_scale: 1.0,
            client_wait_ms: 1000,
            forceps_arm: ArmConfig::at(Ipv4Addr::new(127, 0, 0, 11)),
            arthroscope_arm: ArmConfig::at(Ipv4Addr::new(127, 0, 0, 12)),
            can_listen: SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 29_536),
        }
    }
}

impl Default for ArmConfig {
    fn default() -> Self {
        Self::at(Ipv4Addr::LOCALHOST)
    }
}

impl ArmConfig {
    fn at(bind: Ipv4Addr) -> Self {
        let ports = Ports::default();
        Self {
            bind: IpAddr::V4(bind),
            dashboard_port: ports.dashboard,
            primary_port: ports.primary,
            secondary_port: ports.secondary,
            realtime_port: ports.realtime,
            rtde_port: ports.rtde,
            primary_read_only_port: ports.primary_read_only,
            secondary_read_only_port: ports.secondary_read_only,
            realtime_read_only_port: ports.realtime_read_only,
            series: Series::Cb3,
            version: None,
            powered: false,
        }
    }

    /// As the controller's servers take it.
    pub fn options(&self) -> ServerOptions {
        ServerOptions {
            bind: self.bind,
            ports: Ports {
                dashboard: self.dashboard_port,
                primary: self.primary_port,
                secondary: self.secondary_port,
                realtime: self.realtime_port,
                rtde: self.rtde_port,
                primary_read_only: self.primary_read_only_port,
                secondary_read_only: self.secondary_read_only_port,
                realtime_read_only: self.realtime_read_only_port,
            },
            ..ServerOptions::default()
        }
    }
}

impl Config {
    /// The case.
    ///
    /// # Errors
    /// When a file is missing or refused, or both a scenario and a model are named.
    pub fn scenario(&self) -> Result<Scenario, Error> {
        let spec = Spec {
            seed: self.seed,
            ..Spec::default()
        };
        match (&self.scenario, &self.model) {
            (Some(_), Some(model)) => Err(Error::Config {
                field: "simulator.model",
                value: model.display().to_string(),
                limit: "unset beside simulator.scenario",
            }),
            (Some(folder), None) => Scenario::load(folder),
            (None, None) => Scenario::phantom(spec),
            (None, Some(path)) => {
                let file = |source| Error::File {
                    path: path.clone(),
                    source,
                };
                let bytes = std::fs::read(path).map_err(file)?;
                let mesh = ply::read_mesh(&bytes, None).map_err(|source| Error::Ply {
                    path: path.clone(),
                    source,
                })?;
                Scenario::of_mesh(spec, mesh)
            }
        }
    }

    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// Names the first one.
    pub fn checked(&self) -> Result<&Self, Error> {
        if !(0.01..=1000.0).contains(&self.time_scale) {
            return Err(Error::Config {
                field: "simulator.time_scale",
                value: self.time_scale.to_string(),
                limit: "0.01 .. 1000",
            });
        }
        if !(1..=10_000).contains(&self.client_wait_ms) {
            return Err(Error::Config {
                field: "simulator.client_wait_ms",
                value: self.client_wait_ms.to_string(),
                limit: "1 .. 10000 ms",
            });
        }
        Ok(self)
    }
}
