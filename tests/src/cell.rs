//! A simulated cell with all services, started as a user starts it: by `arthro up`.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use arthro_proto::gateway::v1::calibration_service_client::CalibrationServiceClient;
use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use arthro_proto::motion::v1::motion_service_client::MotionServiceClient;
use arthro_proto::planning::v1::planning_service_client::PlanningServiceClient;
use arthro_proto::registration::v1::registration_service_client::RegistrationServiceClient;
use arthro_proto::simulator::v1::referee_service_client::RefereeServiceClient;
use serde::Deserialize;
use tempfile::TempDir;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, Command};
use tonic::transport::Channel;

/// How long the cell may take to come up or go down, wall time.
const LIMIT: Duration = Duration::from_secs(60);

/// What `arthro up --json` prints when everything is there.
#[derive(Clone, Debug, Deserialize)]
pub struct Announcement {
    /// Address of each service by name.
    pub services: std::collections::BTreeMap<String, String>,
    /// Process id of each service by name.
    pub processes: std::collections::BTreeMap<String, u32>,
    /// Address of each arm's controller.
    pub arms: Vec<String>,
    /// The CAN bus, `socketcand://host:port/can0`.
    pub can: String,
    /// The configuration of all services.
    pub config: PathBuf,
    /// The model, lesion and targets of the case in the cell.
    pub model: PathBuf,
    /// Points inside the damaged tissue.
    pub lesion: PathBuf,
    /// Start, goal and box.
    pub targets: PathBuf,
}

/// A running cell. End it with [`Cell::teardown`]; dropping it ends it too, less gently.
#[derive(Debug)]
pub struct Cell {
    /// Where everything is.
    pub at: Announcement,
    process: Child,
    folder: TempDir,
}

/// The `arthro` binary that `tests/run` built.
pub fn arthro() -> PathBuf {
    let this = std::env::current_exe().expect("a running test has a path");
    // Of target/release/deps/test-xyz, or of a program beside it: target/release/arthro.
    let beside = this.ancestors().skip(1).take(2);
    let binary = beside.map(|folder| folder.join("arthro"));
    binary
        .into_iter()
        .find(|binary| binary.is_file())
        .unwrap_or_else(|| {
            panic!(
                "no arthro beside {}; build it with `cargo build --release`, or use tests/run",
                this.display()
            )
        })
}

impl Cell {
    /// The built-in phantom at up to 50 times real time.
    pub async fn up() -> Self {
        Self::up_with(&[]).await
    }

    /// The same with further flags of `arthro up`.
    pub async fn up_with(flags: &[&str]) -> Self {
        Self::up_telling(flags, Stdio::inherit()).await
    }

    /// The same; what it has to say to a person goes to `told`.
    pub async fn up_telling(flags: &[&str], told: Stdio) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut process = Command::new(arthro())
            .args(["up", "--json", "--free-ports", "--state"])
            .arg(folder.path())
            .args(flags)
            .stdout(Stdio::piped())
            .stderr(told)
            .kill_on_drop(true)
            .spawn()
            .expect("arthro starts");
        let stdout = process.stdout.take().expect("standard output is piped");
        let mut lines = BufReader::new(stdout);
        let mut line = String::new();
        tokio::time::timeout(LIMIT, lines.read_line(&mut line))
            .await
            .expect("the cell comes up in time")
            .expect("standard output can be read");
        let at = serde_json::from_str(&line)
            .unwrap_or_else(|error| panic!("arthro up announced {line:?}: {error}"));
        Self {
            at,
            process,
            folder,
        }
    }

    /// Where configuration, logs and journal lie.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Ends everything and waits until it is gone.
    pub async fn teardown(mut self) {
        let id = self.process.id().expect("the cell still runs");
        signal(id, "TERM").await;
        tokio::time::timeout(LIMIT, self.process.wait())
            .await
            .expect("the cell ends in time")
            .expect("the cell can be waited for");
    }

    /// Address of a service by name.
    pub fn url(&self, service: &str) -> &str {
        &self.at.services[service]
    }

    async fn channel(&self, service: &str) -> Channel {
        Channel::from_shared(self.url(service).to_owned())
            .expect("announced addresses are valid")
            .connect()
            .await
            .unwrap_or_else(|error| panic!("{service}: {error}"))
    }

    /// A client of the cases.
    pub async fn cases(&self) -> CaseServiceClient<Channel> {
        CaseServiceClient::new(self.channel("gateway").await)
            .max_decoding_message_size(64 * 1024 * 1024)
    }

    /// A client of the calibrations.
    pub async fn calibrations(&self) -> CalibrationServiceClient<Channel> {
        CalibrationServiceClient::new(self.channel("gateway").await)
    }

    /// A client of the procedures.
    pub async fn procedures(&self) -> ProcedureServiceClient<Channel> {
        ProcedureServiceClient::new(self.channel("gateway").await)
    }

    /// A client of the arms.
    pub async fn motion(&self) -> MotionServiceClient<Channel> {
        MotionServiceClient::new(self.channel("motion").await)
    }

    /// A client of the instruments.
    pub async fn instrument(&self) -> InstrumentServiceClient<Channel> {
        InstrumentServiceClient::new(self.channel("instrument").await)
    }

    /// A client of the registration.
    pub async fn registration(&self) -> RegistrationServiceClient<Channel> {
        RegistrationServiceClient::new(self.channel("registration").await)
    }

    /// A client of the planning.
    pub async fn planning(&self) -> PlanningServiceClient<Channel> {
        PlanningServiceClient::new(self.channel("planning").await)
    }

    /// A client of the referee.
    pub async fn referee(&self) -> RefereeServiceClient<Channel> {
        RefereeServiceClient::new(self.channel("simulator").await)
    }
}

/// Sends a signal to a process that the test started.
pub async fn signal(id: u32, name: &str) {
    let sent = Command::new("kill")
        .args([&format!("-{name}"), &id.to_string()])
        .status()
        .await
        .expect("kill runs");
    assert!(sent.success(), "no process {id} to send {name} to");
}
