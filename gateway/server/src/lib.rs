//! The gateway: cases from two uploads to an approved plan, and procedures that perform exactly what
//! was approved.
//!
//! It is the only service that calls others. What it promises rests on three things: an approval is
//! bound to the digest of everything that decides where the jaw closes ([`approval`]); a step stands
//! in the journal before it is commanded ([`journal`]); and a procedure is owned by a task of its
//! own, not by the call that started it ([`procedure::sequencer`]).

pub mod approval;
pub mod cases;
pub mod clients;
pub mod config;
pub mod error;
pub mod journal;
pub mod procedure;
pub mod server;
mod wall_clock;
pub mod wire;
mod words;

use arthro_bootstrap::{BoxError, Drain, Service};
use tonic::service::Routes;

pub use crate::config::Config;

use crate::cases::Cases;
use crate::clients::Clients;
use crate::procedure::control::Procedures;

/// The gateway as a server of the house.
#[derive(Debug)]
pub struct Server;

impl Service for Server {
    const NAME: &'static str = "gateway";
    const DEFAULT_PORT: u16 = 50050;
    type Config = Config;

    async fn build(config: Config, drain: Drain) -> Result<Routes, BoxError> {
        let cell = config.cell()?;
        let rules = config.rules()?;
        if cell.is_none() {
            tracing::warn!("the cell is not calibrated: nothing can be planned or performed");
        }
        let clients = Clients::new(
            &config.registration,
            &config.planning,
            &config.motion,
            &config.instrument,
        )?;
        let journal = journal::open(&config.journal, &config.holder()?).await?;
        let cases = Cases::new(journal.clone(), cell);
        let procedures =
            Procedures::take_over(journal, cases.clone(), clients.clone(), rules).await?;
        let leaving = procedures.clone();
        tokio::spawn(async move {
            drain.started().await;
            leaving.leave().await;
        });
        Ok(server::routes(cases, procedures, clients, config.jaw))
    }
}
