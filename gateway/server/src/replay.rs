//! Recordings shown again: a read-only gateway, and the watching half of motion and instrument, so that any client of a live
//! cell shows a recorded procedure. Every command is refused with REPLAY.
//!
//! [`player`] lets the recorded time pass and tells what stood at each moment; [`server`] answers with that.

mod player;
mod server;

use std::path::PathBuf;

use arthro_bootstrap::{BoxError, Host, Service};
use serde::{Deserialize, Serialize};
use tonic::service::Routes;

use crate::recording::read::ReadError;
use crate::recording::summary::Summary;
use crate::recording::topics::Topic;
use crate::replay::player::Player;

/// Fastest and slowest.
const SPEED: std::ops::RangeInclusive<f64> = 0.01..=1000.0;

/// A replay as a server of the house.
#[derive(Debug)]
pub struct Server;

/// Section `replay`; `arthro replay` fills it in.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The files, in the order in which they are shown.
    pub files: Vec<PathBuf>,
    /// How fast the recorded time passes.
    pub speed: f64,
    /// Where to begin, s after the first line.
    pub from_s: f64,
    /// Whether to begin again at the end.
    pub repeat: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            files: Vec::new(),
            speed: 1.0,
            from_s: 0.0,
            repeat: false,
        }
    }
}

impl Service for Server {
    const NAME: &'static str = "replay";
    const DEFAULT_PORT: u16 = 50050;
    const OFFERS: Option<&'static [&'static str]> = Some(&[
        "arthro.gateway.v1.ProcedureService",
        "arthro.motion.v1.MotionService",
        "arthro.instrument.v1.InstrumentService",
    ]);
    type Config = Config;

    async fn build(config: Config, _host: Host) -> Result<Routes, BoxError> {
        config.check()?;
        let mut begins_ns = None;
        let mut ends_ns = 0;
        for path in &config.files {
            let file = path.clone();
            let summary = tokio::task::spawn_blocking(move || Summary::of(&file)).await??;
            if !summary.lines.contains_key(&Topic::Procedure) {
                return Err(ReadError::NoProcedure { path: path.clone() }.into());
            }
            if let Some((first, last)) = summary.span_ns {
                begins_ns.get_or_insert(first);
                ends_ns = last.max(ends_ns);
            }
            tracing::info!(
                file = %path.display(),
                seconds = summary.seconds(),
                whole = summary.whole,
                "recording"
            );
        }
        let begins_ns = begins_ns.unwrap_or_default();
        let seconds = ends_ns.saturating_sub(begins_ns) as f64 * 1e-9;
        if config.from_s > seconds {
            return Err(format!(
                "replay.from_s is {}; the recording lasts {seconds:.3} s",
                config.from_s
            )
            .into());
        }
        Ok(server::routes(Player::start(config, begins_ns)))
    }
}

impl Config {
    fn check(&self) -> Result<(), BoxError> {
        if self.files.is_empty() {
            return Err("replay.files is empty; give at least one recording".into());
        }
        if !SPEED.contains(&self.speed) {
            return Err(format!(
                "replay.speed is {}; must be within {} .. {}",
                self.speed,
                SPEED.start(),
                SPEED.end()
            )
            .into());
        }
        if !(0.0..=1e9).contains(&self.from_s) {
            return Err(
                format!("replay.from_s is {}; must be within 0 .. 1e9", self.from_s).into(),
            );
        }
        Ok(())
    }
}
