//! One service as a process that may be killed and started again.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use arthro_tests::cell::arthro;
use tokio::io::{AsyncBufReadExt as _, BufReader};
use tokio::process::{Child, ChildStdin, Command};

use crate::Result;
use crate::strike::AtWrite;

/// Starts before what a killed process held (its port, its journal) must be free again.
const STARTS: usize = 100;
/// How long a start may take, wall time.
const START_LIMIT: Duration = Duration::from_secs(60);

/// A running service. It ends when it is dropped, and when this program ends.
pub struct Service {
    name: &'static str,
    config: PathBuf,
    logs: PathBuf,
    child: Option<(Child, ChildStdin)>,
}

/// How a start ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Started {
    Up,
    /// The blow that was waiting for it came before it listened.
    Struck,
}

impl Service {
    /// Not yet started.
    pub fn new(name: &'static str, config: &Path, logs: &Path) -> Self {
        Self {
            name,
            config: config.to_owned(),
            logs: logs.to_owned(),
            child: None,
        }
    }

    /// Starts it and waits until it listens.
    pub async fn start(&mut self) -> Result<()> {
        for _ in 0..STARTS {
            if self.try_start(None).await? {
                return Ok(());
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        let log = std::fs::read_to_string(self.log()).unwrap_or_default();
        let end: Vec<_> = log.lines().rev().take(3).collect();
        Err(format!("{} did not start in {STARTS} tries: {end:?}", self.name).into())
    }

    /// Starts it in the hands of strace, which kills it at this call.
    pub async fn start_to_die(&mut self, at: AtWrite) -> Result<Started> {
        Ok(match self.try_start(Some(at)).await? {
            true => Started::Up,
            false => Started::Struck,
        })
    }

    /// Whether it listens; if not, it has ended.
    async fn try_start(&mut self, at: Option<AtWrite>) -> Result<bool> {
        let mut command = match at {
            None => Command::new(arthro()),
            Some(at) => {
                let mut strace = Command::new("strace");
                strace
                    .args(["-f", "-o", "/dev/null"])
                    .arg(format!("--trace={}", at.call.name()))
                    .arg(format!(
                        "--inject={}:signal=KILL:when={}",
                        at.call.name(),
                        at.number
                    ))
                    .arg(arthro());
                strace
            }
        };
        let log = File::options().create(true).append(true).open(self.log())?;
        let mut child = command
            .args(["serve", self.name, "--until-stdin-closes", "--config"])
            .arg(&self.config)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(log)
            .kill_on_drop(true)
            .spawn()?;
        let stdin = child.stdin.take().ok_or("standard input is piped")?;
        let stdout = child.stdout.take().ok_or("standard output is piped")?;
        let mut line = String::new();
        let mut lines = BufReader::new(stdout);
        tokio::time::timeout(START_LIMIT, lines.read_line(&mut line)).await??;
        if line.is_empty() {
            child.wait().await?;
            return Ok(false);
        }
        self.child = Some((child, stdin));
        Ok(true)
    }

    /// SIGKILL; resolves when it is gone.
    pub async fn kill(&mut self) -> Result<()> {
        if let Some((mut child, _)) = self.child.take() {
            child.kill().await?;
        }
        Ok(())
    }

    /// Waits for the blow that strace was told of.
    pub async fn died(&mut self) -> Result<()> {
        if let Some((mut child, _)) = self.child.take() {
            tokio::time::timeout(START_LIMIT, child.wait()).await??;
        }
        Ok(())
    }

    /// Lets it drain.
    pub async fn end(&mut self) -> Result<()> {
        if let Some((mut child, stdin)) = self.child.take() {
            drop(stdin);
            tokio::time::timeout(START_LIMIT, child.wait()).await??;
        }
        Ok(())
    }

    fn log(&self) -> PathBuf {
        self.logs.join(format!("campaign-{}.log", self.name))
    }
}
