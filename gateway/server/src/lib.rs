//! The gateway: cases from two uploads to an approved plan, and procedures that perform exactly what
//! was approved.
//!
//! It is the only service that calls others. What it promises rests on three things: an approval is
//! bound to the digest of everything that decides where the jaw closes ([`approval`]); a step stands
//! in the journal before it is commanded ([`journal`]); and a procedure is owned by a task of its
//! own, not by the call that started it ([`procedure::sequencer`]).

pub mod approval;
mod aside;
pub mod audit;
mod calendar;
pub mod calibrations;
pub mod cases;
pub mod clients;
pub mod config;
pub mod error;
pub mod error_budget;
pub mod journal;
pub mod procedure;
pub mod recording;
pub mod replay;
pub mod server;
pub mod verification;
mod wall_clock;
pub mod wire;
mod words;

use arthro_bootstrap::{BoxError, Host, Service};
use tonic::service::Routes;

pub use crate::config::Config;

use crate::audit::{Audit, Entry, Kind, Who, refusals};
use crate::calibrations::Calibrations;
use crate::cases::Cases;
use crate::clients::Clients;
use crate::clients::channel::Connector;
use crate::procedure::control::Procedures;
use crate::recording::Recorder;
use crate::wall_clock::now_ms;

/// The gateway as a server of the house.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "gateway";
    const DEFAULT_PORT: u16 = 50050;
    type Config = Config;

    async fn build(config: Config, host: Host) -> Result<Routes, BoxError> {
        let cell = config.cell()?;
        let rules = config.rules()?;
        if cell.is_none() {
            tracing::warn!("the cell is not calibrated: nothing can be planned or performed");
        }
        let (registration, planning) = config.replicas()?;
        let clients = Clients::new(
            &Connector::new(host.credentials.clone()),
            registration,
            planning,
            &config.motion,
            &config.instrument,
        )?;
        let journal = journal::open(&config.journal, &config.holder()?).await?;
        let audit = Audit::open(journal.clone(), config.audit.open(&config.journal)?).await?;
        audit.record(started(&audit)).await?;
        tokio::spawn(refusals::record(audit.clone(), host.refusals()));
        let recorder = match config.recordings()? {
            Some(settings) => Some(Recorder::start(
                settings,
                clients.clone(),
                journal.clone(),
                cell.clone(),
            )?),
            None => None,
        };
        let calibrations = Calibrations::open(journal.clone(), cell, config.calibrations).await?;
        let cases = Cases::new(
            journal.clone(),
            calibrations,
            config.verification.into(),
            config.approval,
            audit.clone(),
        );
        let procedures = Procedures::take_over(
            journal,
            cases.clone(),
            clients.clone(),
            audit.clone(),
            rules,
        )
        .await?;
        if let Some(recorder) = &recorder {
            procedures.recorded_by(recorder.clone());
        }
        let leaving = (procedures.clone(), recorder.clone(), audit.clone());
        let hold = host.drain.hold();
        tokio::spawn(async move {
            host.drain.started().await;
            let (procedures, recorder, audit) = leaving;
            procedures.leave().await;
            if let Some(recorder) = recorder {
                recorder.finish().await;
            }
            let ended = Entry::new(now_ms(), Kind::End, Who::gateway());
            if let Err(error) = audit.record(ended).await {
                tracing::error!(%error, "the end is not in the audit");
            }
            drop(hold);
        });
        Ok(server::routes(
            cases,
            procedures,
            clients,
            config.jaw,
            config.error_budget,
            recorder,
            audit,
        ))
    }
}

fn started(audit: &Audit) -> Entry {
    let key = audit.keys().last().map_or("", |key| key.id().as_str());
    Entry {
        code: env!("CARGO_PKG_VERSION").to_owned(),
        detail: format!("signs with the key {key}"),
        ..Entry::new(now_ms(), Kind::Start, Who::gateway())
    }
}
