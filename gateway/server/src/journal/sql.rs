//! The journal in SQL: one text of every statement, which SQLite and PostgreSQL both understand.
//!
//! [`super::sqlite`] and [`super::postgres`] open it. Every write goes through [`SqlJournal::write`], so that none
//! is made by a gateway that is no longer in command.

mod audit;
mod calibrations;
mod cases;
mod command;
mod migrations;
mod procedures;
mod rows;
mod standing;

use std::fs::File;

use bytes::Bytes;
use sqlx::{Any, AnyPool, Transaction};
use tokio::sync::{Mutex, watch};

use super::{AuditFilter, AuditRow, Blob, Duty, Journal, JournalError, Page};
use crate::approval::Digest;
use crate::audit::entry::{Link, Tail};
use crate::calibrations::record::{Calibration, Kind, Revocation};
use crate::cases::case::Case;
use crate::clients::motion::Standing;
use crate::procedure::Procedure;
use crate::procedure::steps::{BiteOutcome, Step};

pub use audit::AuditFile;
pub(super) use audit::guard;
pub(super) use command::{Take, keep};
pub(super) use migrations::migrate;

/// The open journal.
#[derive(Debug)]
pub struct SqlJournal {
    writer: AnyPool,
    readers: AnyPool,
    /// For the command row alone, so that no long write keeps its lease from being renewed.
    keeper: AnyPool,
    /// Held while the command row is asked for or given up.
    changing: Mutex<Changing>,
    dialect: Dialect,
    duty: watch::Sender<Duty>,
    /// The lock on an SQLite file, kept as long as the journal is open; the system unlocks it when the process dies.
    _lock: Option<File>,
}

/// What the changes of command remember.
#[derive(Debug, Default)]
struct Changing {
    /// Command was given up for good.
    has_left: bool,
}

/// The connections to one database.
#[derive(Debug)]
pub(super) struct Pools {
    /// Write, in transactions.
    pub writer: AnyPool,
    /// Only read.
    pub readers: AnyPool,
    /// Write and read the command row.
    pub keeper: AnyPool,
}

/// Where the two databases need different words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Sqlite,
    Postgres,
}

// === impl SqlJournal ===

impl SqlJournal {
    /// On a database whose tables are up to date. Nothing can be written before command is taken.
    pub(super) fn new(pools: Pools, dialect: Dialect, lock: Option<File>) -> Self {
        Self {
            writer: pools.writer,
            readers: pools.readers,
            keeper: pools.keeper,
            changing: Mutex::default(),
            dialect,
            duty: watch::Sender::new(Duty::nobody()),
            _lock: lock,
        }
    }

    /// A transaction in which this gateway is in command until it ends. Whoever takes command waits for its end, and
    /// whoever has lost command is refused.
    async fn write(&self) -> Result<Transaction<'static, Any>, JournalError> {
        let epoch = match &*self.duty.borrow() {
            Duty::InCommand { epoch } => *epoch,
            Duty::Standby { holder } => {
                return Err(JournalError::NotInCommand {
                    holder: holder.clone(),
                });
            }
        };
        let mut transaction = self.writer.begin_with(self.dialect.begin()).await?;
        if command::hold(&mut transaction, self.dialect, epoch).await? {
            return Ok(transaction);
        }
        // Whatever these two come to, nothing was written and nothing will be. The first gives the connection back.
        transaction.rollback().await.ok();
        let holder = self.lose(epoch).await.unwrap_or_default();
        Err(JournalError::Fenced { epoch, holder })
    }
}

#[tonic::async_trait]
impl Journal for SqlJournal {
    fn duty(&self) -> watch::Receiver<Duty> {
        self.duty.subscribe()
    }

    async fn leave(&self) -> Result<(), JournalError> {
        self.give_command_up().await
    }

    async fn create_case(&self, case: &Case) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        cases::create(&mut transaction, case).await?;
        Ok(transaction.commit().await?)
    }

    async fn save_case(&self, case: &Case, blobs: &[(Blob, Bytes)]) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        cases::save(&mut transaction, case, blobs).await?;
        Ok(transaction.commit().await?)
    }

    async fn case(&self, case_id: &str) -> Result<Option<Case>, JournalError> {
        cases::one(&self.readers, case_id).await
    }

    async fn cases(&self, page: &Page) -> Result<Vec<Case>, JournalError> {
        cases::page(&self.readers, page).await
    }

    async fn blob(&self, case_id: &str, blob: Blob) -> Result<Bytes, JournalError> {
        cases::blob(&self.readers, case_id, blob).await
    }

    async fn create_procedure(&self, procedure: &Procedure) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        procedures::create(&mut transaction, procedure).await?;
        Ok(transaction.commit().await?)
    }

    async fn save_procedure(&self, procedure: &Procedure) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        procedures::save(&mut transaction, procedure).await?;
        Ok(transaction.commit().await?)
    }

    async fn claim_open(&self) -> Result<Vec<Procedure>, JournalError> {
        let mut transaction = self.write().await?;
        let claimed = procedures::claim(&mut transaction, self.dialect).await?;
        transaction.commit().await?;
        let mut procedures = Vec::with_capacity(claimed.len());
        for procedure_id in claimed {
            procedures.extend(procedures::one(&self.readers, &procedure_id).await?);
        }
        Ok(procedures)
    }

    async fn procedure(&self, procedure_id: &str) -> Result<Option<Procedure>, JournalError> {
        procedures::one(&self.readers, procedure_id).await
    }

    async fn procedures(&self, page: &Page) -> Result<Vec<Procedure>, JournalError> {
        procedures::page(&self.readers, page).await
    }

    async fn intend(&self, procedure_id: &str, step: &Step) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        procedures::intend(&mut transaction, procedure_id, step).await?;
        Ok(transaction.commit().await?)
    }

    async fn end_step(
        &self,
        procedure: &Procedure,
        step: &Step,
        outcome: Option<&BiteOutcome>,
    ) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        procedures::end_step(&mut transaction, procedure, step, outcome).await?;
        Ok(transaction.commit().await?)
    }

    async fn record_standing(
        &self,
        procedure_id: &str,
        sequence: u32,
        standing: &Standing,
    ) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        standing::record(&mut transaction, procedure_id, sequence, standing).await?;
        Ok(transaction.commit().await?)
    }

    async fn standing(
        &self,
        procedure_id: &str,
        sequence: u32,
    ) -> Result<Option<Standing>, JournalError> {
        standing::read(&self.readers, procedure_id, sequence).await
    }

    async fn steps(&self, procedure_id: &str) -> Result<Vec<Step>, JournalError> {
        procedures::steps(&self.readers, procedure_id).await
    }

    async fn bite_outcomes(&self, procedure_id: &str) -> Result<Vec<BiteOutcome>, JournalError> {
        procedures::bite_outcomes(&self.readers, procedure_id).await
    }

    async fn append_audit(
        &self,
        link: &(dyn Fn(Tail) -> Vec<Link> + Sync),
    ) -> Result<(), JournalError> {
        audit::append(&self.writer, self.dialect, link).await
    }

    async fn audit_hash(&self, sequence: u64) -> Result<Option<Digest>, JournalError> {
        audit::hash(&self.readers, sequence).await
    }

    async fn audit(&self, filter: &AuditFilter, limit: u32) -> Result<Vec<AuditRow>, JournalError> {
        audit::select(&self.readers, filter, limit).await
    }

    async fn create_calibration(&self, calibration: &Calibration) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        calibrations::create(&mut transaction, calibration).await?;
        Ok(transaction.commit().await?)
    }

    async fn revoke_calibration(
        &self,
        calibration_id: &str,
        revocation: &Revocation,
    ) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        calibrations::revoke(&mut transaction, calibration_id, revocation).await?;
        Ok(transaction.commit().await?)
    }

    async fn put_in_force(
        &self,
        kind: Kind,
        calibration_id: Option<&str>,
        operator: &str,
        at_ms: i64,
    ) -> Result<(), JournalError> {
        let mut transaction = self.write().await?;
        calibrations::put_in_force(&mut transaction, kind, calibration_id, operator, at_ms).await?;
        Ok(transaction.commit().await?)
    }

    async fn calibration(&self, calibration_id: &str) -> Result<Option<Calibration>, JournalError> {
        calibrations::one(&self.readers, calibration_id).await
    }

    async fn calibrations(&self) -> Result<Vec<Calibration>, JournalError> {
        calibrations::all(&self.readers).await
    }

    async fn calibrations_in_force(&self) -> Result<Vec<Calibration>, JournalError> {
        calibrations::in_force(&self.readers).await
    }
}
