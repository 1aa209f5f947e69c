//! Simulated EPOS4 drives without a cell around them: `arthro-simulator epos4`, for anybody's tests.

mod flags;
mod node_ids;

use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use arthro_bootstrap::{BoxError, Host, Service};
use arthro_proto::simulator::v1::drive_fault_service_server::DriveFaultServiceServer;
use epos4_link::bus::socketcand::server::Server;
use serde::{Deserialize, Serialize};
use tonic::service::Routes;

pub use self::flags::main;
pub use self::node_ids::NodeIds;
use super::Pace;
use crate::Error;
use crate::bench::{Bench, JawConfig};
use crate::epos4::{Bus, socketcand, wire};
use crate::server::DriveFaultApi;

/// The section `[epos4]`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where socketcand's protocol is served, its bus is named `can0`; empty: nowhere.
    pub listen: String,
    /// A bus to join, such as `socketcan:vcan0`; empty: none.
    pub bus: String,
    /// Node ids, such as `1-4` or `2,5`. 1 to 4 have the mechanisms of the cell's axes, others turn freely.
    pub nodes: NodeIds,
    /// Speed of the drives' clock against the wall clock, 0.01 .. 1000.
    pub time_scale: f64,
    /// The bus goes on in steps of this, ms, 1 .. 10; within one the drives keep their own cycle of 0.4 ms. Longer steps
    /// leave more of a slow machine to others.
    pub step_ms: u64,
    /// Above real time the clock waits this long for a heartbeat that a drive expects, ms, 1 .. 10000.
    pub client_wait_ms: u64,
    /// The jaw that node 2 closes.
    pub jaw: JawConfig,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, SOCKETCAND_PORT)).to_string(),
            bus: String::new(),
            nodes: NodeIds::default(),
            time_scale: 1.0,
            step_ms: 1,
            client_wait_ms: 1000,
            jaw: JawConfig::default(),
        }
    }
}

/// The port of socketcand.
const SOCKETCAND_PORT: u16 = 29_536;
/// The drives as a server: their bus, and faults over gRPC.
#[derive(Debug)]
pub struct Standalone;

impl Service for Standalone {
    const NAME: &'static str = "epos4";
    const DEFAULT_PORT: u16 = 50059;
    const OFFERS: Option<&'static [&'static str]> =
        Some(&["arthro.simulator.v1.DriveFaultService"]);
    type Config = Config;

    async fn build(config: Config, host: Host) -> Result<Routes, BoxError> {
        let listen = config.checked()?;
        let bus = Bus::new(Bench::drives(config.nodes.as_slice()));
        let server = match listen {
            Some(address) => Some(
                socketcand::serve(address, Arc::clone(&bus))
                    .await
                    .map_err(|source| Error::Listen { address, source })?,
            ),
            None => None,
        };
        let wire = match config.bus.as_str() {
            "" => None,
            address => Some(wire::join(&bus, address).await?),
        };
        announce(server.as_ref(), &config)?;
        let ticking = tokio::spawn(run(config, Arc::clone(&bus)));
        tokio::spawn(async move {
            host.drain.started().await;
            ticking.abort();
            drop((server, wire));
        });
        let faults = DriveFaultApi::new(bus);
        Ok(Routes::new(DriveFaultServiceServer::new(faults)))
    }
}

impl Config {
    /// Refuses numbers out of range; where to listen.
    ///
    /// # Errors
    /// Names the first one.
    pub fn checked(&self) -> Result<Option<SocketAddr>, BoxError> {
        self.jaw
            .checked()
            .map_err(|error| format!("epos4.jaw.{error}"))?;
        let refused = |field, value: String, limit| {
            Box::new(Error::Config {
                field,
                value,
                limit,
            })
        };
        if !(0.01..=1000.0).contains(&self.time_scale) {
            let value = self.time_scale.to_string();
            return Err(refused("epos4.time_scale", value, "0.01 .. 1000"));
        }
        if !(1..=10).contains(&self.step_ms) {
            let value = self.step_ms.to_string();
            return Err(refused("epos4.step_ms", value, "1 .. 10 ms"));
        }
        if !(1..=10_000).contains(&self.client_wait_ms) {
            let value = self.client_wait_ms.to_string();
            return Err(refused("epos4.client_wait_ms", value, "1 .. 10000 ms"));
        }
        match (self.listen.as_str(), self.bus.as_str()) {
            ("", "") => Err(refused(
                "epos4.listen",
                "empty".to_owned(),
                "an address, as epos4.bus is empty too",
            )),
            ("", _) => Ok(None),
            (listen, _) => match listen.parse() {
                Ok(address) => Ok(Some(address)),
                Err(_) => Err(refused(
                    "epos4.listen",
                    listen.to_owned(),
                    "an address and port such as 127.0.0.1:29536",
                )),
            },
        }
    }
}

/// One line of JSON for scripts that wait for the drives.
fn announce(server: Option<&Server>, config: &Config) -> std::io::Result<()> {
    let served = server.map(|server| format!("socketcand://{}/can0", server.address()));
    let joined = Some(config.bus.clone()).filter(|bus| !bus.is_empty());
    let fields = [("can", served), ("bus", joined)]
        .into_iter()
        .filter_map(|(name, address)| Some(format!(r#""{name}":"{}","#, address?)));
    let ids: Vec<String> = config.nodes.as_slice().iter().map(u8::to_string).collect();
    let fields: String = fields.collect();
    let mut out = std::io::stdout();
    writeln!(
        out,
        r#"{{"epos4":{{{fields}"nodes":[{}]}}}}"#,
        ids.join(",")
    )?;
    out.flush()
}

/// Ticks the bus until the task is aborted.
async fn run(config: Config, bus: Arc<Bus>) {
    let client_wait = Duration::from_millis(config.client_wait_ms);
    let mut bench = Bench::new(config.nodes.as_slice(), config.jaw.clone());
    let step_s = config.step_ms as f64 / 1000.0;
    let mut pace = Pace::new(step_s, config.time_scale);
    let mut steps = 0_u64;
    loop {
        pace.next().await;
        if config.time_scale > 1.0 {
            bus.wait_for_heartbeats(step_s, client_wait).await;
        }
        steps += 1;
        let mechanics = bench.mechanics(&bus.positions_quadcounts());
        bus.tick(step_s, steps as f64 * step_s, &mechanics);
        tokio::task::yield_now().await;
    }
}
