//! A gateway as a process of its own, which can be killed, halted, and kept from writing.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use arthro_gateway::Config;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::ProcedureState;
use tonic::Status;
use tonic::transport::Channel;

use super::bench::{Bench, audit_in};
use super::fakes::{PATIENCE, World};

pub struct Gateway {
    /// A client of it.
    pub bench: Bench,
    process: Child,
}

impl Gateway {
    pub async fn start(name: &str, config: &Config, world: &Arc<World>) -> Self {
        Self::begin(name, config, world, spawn).await
    }

    /// The same with a disk of `kib` mounted at a folder, which only it sees.
    pub async fn start_with_disk(config: &Config, world: &Arc<World>, at: &Path, kib: u32) -> Self {
        let at = at.to_owned();
        let spawn = move |file: &Path| spawn_with_disk(file, &at, kib);
        Self::begin("gateway", config, world, spawn).await
    }

    async fn begin(
        name: &str,
        config: &Config,
        world: &Arc<World>,
        spawn: impl FnOnce(&Path) -> (Child, String) + Send + 'static,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = Config {
            name: name.to_owned(),
            audit: audit_in(folder.path()),
            ..config.clone()
        };
        let file = folder.path().join("cell.toml");
        let sections = toml::Table::from_iter([(
            "gateway".to_owned(),
            toml::Value::try_from(&config).unwrap(),
        )]);
        std::fs::write(&file, sections.to_string()).unwrap();
        let (process, address) = tokio::task::spawn_blocking(move || spawn(&file))
            .await
            .unwrap();
        let channel = Channel::from_shared(format!("http://{address}"))
            .unwrap()
            .connect_lazy();
        Self {
            bench: Bench::at(channel, world.clone(), config, folder),
            process,
        }
    }

    pub fn signal(&self, signal: &str) {
        let signalled = Command::new("sh")
            .args(["-c", &format!("kill -{signal} {}", self.process.id())])
            .status()
            .unwrap();
        assert!(signalled.success());
    }

    /// Its process, for a shell.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Tells it to end, as what started it does by closing its standard input.
    pub fn tell_to_end(&mut self) {
        drop(self.process.stdin.take());
    }

    /// Asks until the gateway tells of the procedure in this state.
    pub async fn tells(&mut self, procedure_id: &str, state: ProcedureState) -> proto::Procedure {
        let until = Instant::now() + PATIENCE;
        loop {
            let procedure = self.bench.report(procedure_id).await.procedure.unwrap();
            if procedure.state() == state {
                return procedure;
            }
            assert!(
                Instant::now() < until,
                "never told of {state:?}: {procedure:?}"
            );
            tokio::task::yield_now().await;
        }
    }

    pub async fn stop(&mut self) -> Result<(), Status> {
        let request = proto::StopProcedureRequest::default();
        self.bench
            .procedures
            .stop_procedure(request)
            .await
            .map(drop)
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

fn spawn(config: &Path) -> (Child, String) {
    // Whoever writes beyond the limit of a file's size is killed, unless the signal is ignored from the start.
    let mut shell = Command::new("sh");
    shell.args(["-c", r#"trap "" XFSZ; exec "$0" "$@""#]);
    announced(shell, config)
}

/// What begins a process with mounts of its own.
fn with_mounts() -> Command {
    let mut command = Command::new("unshare");
    command.args(["--mount", "--map-root-user"]);
    command
}

/// Whether this machine lets a process have mounts of its own.
pub fn may_mount() -> bool {
    let mut tried = with_mounts();
    tried.args(["mount", "-t", "tmpfs", "tmpfs", "/mnt"]);
    tried.status().is_ok_and(|status| status.success())
}

fn spawn_with_disk(config: &Path, at: &Path, kib: u32) -> (Child, String) {
    let mut shell = with_mounts();
    shell.args(["sh", "-c"]).arg(format!(
        r#"mount -t tmpfs -o size={kib}k tmpfs {} && exec "$0" "$@""#,
        at.display()
    ));
    announced(shell, config)
}

/// Starts the gateway by a shell that becomes it.
fn announced(mut shell: Command, config: &Path) -> (Child, String) {
    let mut process = shell
        .arg(env!("CARGO_BIN_EXE_arthro-gateway"))
        .arg("--config")
        .arg(config)
        .args(["--listen", "127.0.0.1:0", "--until-stdin-closes"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(process.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    let announced: serde_json::Value = serde_json::from_str(&line)
        .unwrap_or_else(|error| panic!("the gateway said {line:?}: {error}"));
    let address = announced["address"].as_str().unwrap().to_owned();
    (process, address)
}
