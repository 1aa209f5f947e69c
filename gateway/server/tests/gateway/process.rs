//! A gateway as a process of its own, which can be killed, halted, and kept from writing.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use arthro_gateway::Config;
use arthro_gateway::config::AuditConfig;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::ProcedureState;
use tonic::Status;
use tonic::transport::Channel;

use super::bench::Bench;
use super::fakes::{PATIENCE, World};

pub struct Gateway {
    /// A client of it.
    pub bench: Bench,
    process: Child,
}

impl Gateway {
    pub async fn start(name: &str, config: &Config, world: &Arc<World>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let config = Config {
            name: name.to_owned(),
            audit: AuditConfig {
                key: Some(folder.path().join("audit-key")),
                heads: Some(folder.path().join("audit-heads")),
                ..AuditConfig::default()
            },
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
    let mut process = Command::new("sh")
        .args(["-c", r#"trap "" XFSZ; exec "$0" "$@""#])
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
