//! One service as a child process of this program.
//!
//! A child drains when its standard input closes, so that it never outlives its parent, however that
//! one ends. It announces its address on standard output; its log goes to a file.

use std::fs::File;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use serde::Deserialize;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};

use crate::arguments::ServiceName;
use crate::cell::config::Configuration;
use crate::exit::{Failure, Kind};

/// How long a service may take to come up, wall time.
const START_LIMIT: Duration = Duration::from_secs(30);
/// How long it may take to drain before it is ended.
const DRAIN_LIMIT: Duration = Duration::from_secs(6);

/// A running service.
#[derive(Debug)]
pub struct Process {
    /// Which service.
    pub service: ServiceName,
    /// Where it listens.
    pub address: SocketAddr,
    scheme: &'static str,
    log: PathBuf,
    child: Child,
    stdin: Option<ChildStdin>,
}

#[derive(Deserialize)]
struct Announcement {
    address: SocketAddr,
}

impl Process {
    /// Starts `service` with this configuration and waits until it listens.
    pub async fn start(
        service: ServiceName,
        config: &Configuration,
        listen: SocketAddr,
        logs: &Path,
    ) -> Result<Self, Failure> {
        let log = logs.join(format!("{}.log", service.as_str()));
        let mut child = Command::new(std::env::current_exe()?)
            .args(["serve", service.as_str(), "--until-stdin-closes"])
            .arg(format!("--listen={listen}"))
            .arg("--config")
            .arg(config.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::options().create(true).append(true).open(&log)?)
            .kill_on_drop(true)
            .spawn()?;
        let stdin = child.stdin.take();
        let mut lines = BufReader::new(child.stdout.take().ok_or_else(|| not_up(service, &log))?);
        let mut line = String::new();
        let announced = tokio::time::timeout(START_LIMIT, lines.read_line(&mut line)).await;
        let announcement: Announcement = announced
            .ok()
            .and_then(Result::ok)
            .and_then(|_| serde_json::from_str(&line).ok())
            .ok_or_else(|| not_up(service, &log))?;
        Ok(Self {
            service,
            address: announcement.address,
            scheme: if config.has_tls() { "https" } else { "http" },
            log,
            child,
            stdin,
        })
    }

    /// The service's address as clients write it.
    pub fn url(&self) -> String {
        format!("{}://{}", self.scheme, self.address)
    }

    /// The process id.
    pub fn id(&self) -> Option<u32> {
        self.child.id()
    }

    /// Whether it still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Resolves when the process ends by itself.
    pub async fn ended(&mut self) -> Failure {
        let status = match self.child.wait().await {
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        Failure::new(
            Kind::Unreachable,
            "SERVICE_ENDED",
            format!(
                "{} ended ({status}); its log is {}{}",
                self.service.as_str(),
                self.log.display(),
                last_lines(&self.log)
            ),
        )
    }

    /// Lets the service drain; ends it if it does not.
    pub async fn stop(mut self) {
        drop(self.stdin.take());
        let drained = tokio::time::timeout(DRAIN_LIMIT, self.child.wait()).await;
        if drained.is_err() {
            // It did not drain in time; nothing it holds is worth waiting for.
            self.child.kill().await.ok();
        }
    }
}

fn not_up(service: ServiceName, log: &Path) -> Failure {
    Failure::new(
        Kind::Unreachable,
        "SERVICE_NOT_STARTED",
        format!(
            "{} did not come up within {} s; its log is {}{}",
            service.as_str(),
            START_LIMIT.as_secs(),
            log.display(),
            last_lines(log)
        ),
    )
}

/// The end of a log, because the folder it lies in may be a temporary one.
fn last_lines(log: &Path) -> String {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let lines: Vec<&str> = text.lines().rev().take(5).collect();
    lines
        .iter()
        .rev()
        .map(|line| format!("\n  | {line}"))
        .collect()
}
