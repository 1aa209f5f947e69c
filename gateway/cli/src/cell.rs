//! A simulated cell with all services, each in a process of its own.
//!
//! The simulator comes up first, because only it knows where its controllers and its bus listen; the
//! services follow with a configuration made from that and from the cell's calibration; the gateway
//! comes last. One file, `arthro.toml`, holds the configuration of all of them, so that any one can
//! be started again by hand: `arthro serve NAME --config arthro.toml`.

mod config;
mod loopback;
mod process;
pub mod targets;
mod tls;

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use arthro_proto::{instrument, motion, simulator};
use arthro_simulator::scenario::Scenario;
use serde_json::json;
use tokio::signal::unix::{SignalKind, signal};

use crate::arguments::{ServiceName, Up};
use crate::cell::config::Configuration;
use crate::cell::process::Process;
use crate::cell::targets::Targets;
use crate::connection;
use crate::demo;
use crate::exit::{Failure, Kind};
use crate::output::Output;
use crate::pki::Site;

/// How long arms and drives may take to be ready, wall time.
const READY_LIMIT: Duration = Duration::from_secs(30);

/// Where a cell listens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ports {
    /// Free ones, so that any number of cells run beside each other.
    Free,
    /// Those of the documentation: 50050 to 50059, arms at 127.0.0.11 and 127.0.0.12.
    Standard,
}

/// Addresses as clients write them.
#[derive(Clone, Debug)]
pub struct Urls {
    pub gateway: String,
    pub planning: String,
    pub motion: String,
    pub simulator: String,
}

/// A running cell.
#[derive(Debug)]
pub struct Cell {
    folder: PathBuf,
    processes: Vec<Process>,
    arms: Vec<String>,
    can: String,
}

impl Cell {
    /// Starts everything and waits until arms and drives are ready. State goes to `folder`; with a site all speak TLS.
    pub async fn start(
        scenario: &Scenario,
        folder: &Path,
        time_scale: f64,
        ports: Ports,
        tls: Option<Site>,
        output: &Output,
    ) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder)?;
        // Children have a working folder of their own.
        let folder = folder.canonicalize()?;
        scenario
            .save(&folder)
            .map_err(|error| Failure::failed("SCENARIO_UNWRITABLE", error))?;
        Targets::of(scenario).write(&folder.join("targets.toml"))?;
        let mut cell = Self {
            folder,
            processes: Vec::new(),
            arms: Vec::new(),
            can: String::new(),
        };
        let mut configuration = Configuration::new(cell.folder.join("arthro.toml"), tls);
        configuration.simulator(&cell.folder, time_scale, loopback::arms(ports)?)?;
        cell.launch(ServiceName::Simulator, ports, &mut configuration)
            .await?;
        let mut referee =
            RefereeServiceClient::new(connection::open(&cell.url(ServiceName::Simulator)).await?);
        let request = simulator::v1::GetCellRequest {};
        let described = referee.get_cell(request).await?.into_inner();
        cell.arms = described.arm_addresses;
        cell.can = described.can_address;

        configuration.services(scenario, &cell.arms, &cell.can)?;
        for service in [
            ServiceName::Registration,
            ServiceName::Planning,
            ServiceName::Motion,
            ServiceName::Instrument,
        ] {
            cell.launch(service, ports, &mut configuration).await?;
        }
        configuration.gateway(scenario, &cell.folder, |service| cell.address(service))?;
        cell.launch(ServiceName::Gateway, ports, &mut configuration)
            .await?;
        output.note("the simulated cell and five services are up; waiting for arms and drives");
        cell.ready().await?;
        Ok(cell)
    }

    async fn launch(
        &mut self,
        service: ServiceName,
        ports: Ports,
        configuration: &mut Configuration,
    ) -> Result<(), Failure> {
        let port = match ports {
            Ports::Free => 0,
            Ports::Standard => service.standard_port(),
        };
        let listen = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port);
        let process = Process::start(service, configuration, listen, &self.folder).await?;
        configuration.listens(service, process.address)?;
        self.processes.push(process);
        Ok(())
    }

    fn process(&self, service: ServiceName) -> Option<&Process> {
        self.processes
            .iter()
            .find(|process| process.service == service)
    }

    fn address(&self, service: ServiceName) -> String {
        self.process(service)
            .map_or_else(String::new, |process| process.address.to_string())
    }

    fn url(&self, service: ServiceName) -> String {
        self.process(service).map_or_else(String::new, Process::url)
    }

    /// What clients of the cell connect to.
    pub fn urls(&self) -> Urls {
        Urls {
            gateway: self.url(ServiceName::Gateway),
            planning: self.url(ServiceName::Planning),
            motion: self.url(ServiceName::Motion),
            simulator: self.url(ServiceName::Simulator),
        }
    }

    /// Waits until both arms are powered and connected and all drives answer.
    async fn ready(&mut self) -> Result<(), Failure> {
        let (arms, drives) = (
            arms_ready(self.url(ServiceName::Motion)),
            drives_ready(self.url(ServiceName::Instrument)),
        );
        tokio::select! {
            ready = async { tokio::try_join!(arms, drives) } => ready.map(|_| ()),
            failure = self.failed() => Err(failure),
            () = tokio::time::sleep(READY_LIMIT) => Err(Failure::new(
                Kind::Unreachable,
                "CELL_NOT_READY",
                format!("arms and drives were not ready within {} s", READY_LIMIT.as_secs()),
            )),
        }
    }

    /// Resolves when any process ends by itself.
    pub async fn failed(&mut self) -> Failure {
        let ends = self
            .processes
            .iter_mut()
            .map(|process| Box::pin(process.ended()));
        let mut ends: Vec<_> = ends.collect();
        std::future::poll_fn(|context| {
            ends.iter_mut()
                .find_map(|end| match end.as_mut().poll(context) {
                    std::task::Poll::Ready(failure) => Some(std::task::Poll::Ready(failure)),
                    std::task::Poll::Pending => None,
                })
                .unwrap_or(std::task::Poll::Pending)
        })
        .await
    }

    /// Drains everything, the gateway first.
    pub async fn stop(mut self) {
        while let Some(process) = self.processes.pop() {
            process.stop().await;
        }
    }
}

/// Both arms are connected, powered and without fault.
async fn arms_ready(url: String) -> Result<(), Failure> {
    let mut client = MotionServiceClient::new(connection::open(&url).await?);
    let request = motion::v1::WatchStateRequest { period_s: 0.1 };
    let mut states = client.watch_state(request).await?.into_inner();
    while let Some(state) = states.message().await? {
        let ready =
            |arm: &motion::v1::ArmState| arm.robot_mode == "RUNNING" && arm.fault_reason.is_empty();
        if state.arms.len() == 2 && state.arms.iter().all(ready) {
            return Ok(());
        }
    }
    Err(Failure::new(
        Kind::Unreachable,
        "ARMS_NOT_READY",
        "the motion service stopped reporting before both arms ran",
    ))
}

/// All four drives answer.
async fn drives_ready(url: String) -> Result<(), Failure> {
    let mut client = InstrumentServiceClient::new(connection::open(&url).await?);
    let request = instrument::v1::WatchStateRequest { period_s: 0.1 };
    let mut states = client.watch_state(request).await?.into_inner();
    while let Some(state) = states.message().await? {
        let ready = |axis: &instrument::v1::AxisState| {
            axis.nmt_state == "OPERATIONAL" && axis.fault_reason.is_empty()
        };
        if state.axes.len() == 4 && state.axes.iter().all(ready) {
            return Ok(());
        }
    }
    Err(Failure::new(
        Kind::Unreachable,
        "DRIVES_NOT_READY",
        "the instrument service stopped reporting before all drives answered",
    ))
}

/// `arthro up`: keeps a cell running until it is told to end.
pub async fn up(arguments: &Up, output: &Output) -> Result<(), Failure> {
    let scenario = demo::scenario(&arguments.cell, output)?;
    let ports = if arguments.free_ports {
        Ports::Free
    } else {
        Ports::Standard
    };
    let time_scale = arguments.cell.time_scale;
    let site = arguments.tls.as_deref().map(tls::site).transpose()?;
    let announced = site.clone();
    let mut cell = Box::pin(Cell::start(
        &scenario,
        &arguments.state,
        time_scale,
        ports,
        site,
        output,
    ))
    .await?;
    announce(&cell, announced.as_ref(), output)?;
    let mut terminate = signal(SignalKind::terminate())?;
    loop {
        tokio::select! {
            failure = cell.failed() => {
                output.note(format!("arthro: {}", failure.message));
                cell.forget_ended();
            }
            _ = tokio::signal::ctrl_c() => break,
            _ = terminate.recv() => break,
        }
    }
    cell.stop().await;
    Ok(())
}

impl Cell {
    /// The others go on; the operator may start the ended one again by hand.
    fn forget_ended(&mut self) {
        self.processes.retain_mut(|process| {
            let running = process.is_running();
            if !running {
                // Shown once, where the person who must act reads.
                Output::new(false).note(format!(
                    "start it again with: arthro serve {} --config {}",
                    process.service.as_str(),
                    self.folder.join("arthro.toml").display()
                ));
            }
            running
        });
    }
}

fn announce(cell: &Cell, tls: Option<&Site>, output: &Output) -> Result<(), Failure> {
    let by_name = |value: fn(&Process) -> serde_json::Value| -> BTreeMap<&str, serde_json::Value> {
        cell.processes
            .iter()
            .map(|process| (process.service.as_str(), value(process)))
            .collect()
    };
    output.result(&json!({
        "services": by_name(|process| process.url().into()),
        "processes": by_name(|process| process.id().into()),
        "arms": cell.arms,
        "can": cell.can,
        "config": cell.folder.join("arthro.toml"),
        "model": cell.folder.join("model.ply"),
        "lesion": cell.folder.join("lesion.ply"),
        "targets": cell.folder.join("targets.toml"),
        "tls": tls.map(Site::folder),
    }));
    for process in &cell.processes {
        output.line(format!(
            "{:<13} {}",
            process.service.as_str(),
            process.url()
        ));
    }
    output.line(format!("{:<13} {}", "arms", cell.arms.join("  ")));
    output.line(format!("{:<13} {}", "bus", cell.can));
    // A record keeps the name that the certificate has.
    let you = if tls.is_some() { "surgeon" } else { "you" };
    let identity = tls.map(tls::exports).transpose()?.unwrap_or_default();
    let folder = cell.folder.display();
    let gateway = cell.url(ServiceName::Gateway);
    let simulator = cell.url(ServiceName::Simulator);
    output.line(format!(
        "state         {folder}\n\n\
         a procedure by hand:\n  \
         {identity}export ARTHRO_GATEWAY={gateway}\n  \
         arthro case create knee --model {folder}/model.ply --lesion {folder}/lesion.ply   # prints CASE\n  \
         arthro case scene CASE --simulator {simulator}\n  \
         arthro case register CASE && arthro case accept CASE --operator {you}\n  \
         arthro case plan CASE                                                             # prints DIGEST\n  \
         arthro case approve CASE --digest DIGEST --surgeon {you}\n  \
         arthro run CASE --operator {you}\n\n\
         ctrl-c ends everything"
    ));
    Ok(())
}
