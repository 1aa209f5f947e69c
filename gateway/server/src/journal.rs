//! What survives a crash: cases, procedures, and every step before and after it is commanded.
//!
//! [`Journal`] is the contract that the sequencer builds on: when a method returns `Ok`, what it
//! wrote is on the disk, whole; when it returns an error or never returns, the caller acts as if
//! nothing were written. So a step's intention that was not returned `Ok` is never commanded.
//!
//! One gateway is in command at a time. Its epoch is a fencing token: a write by a gateway of an older epoch is
//! refused by the database, whatever that gateway believes.

mod place;
pub mod postgres;
pub mod sql;
pub mod sqlite;

use std::path::PathBuf;
use std::sync::Arc;

use bytes::Bytes;
use tokio::sync::watch;

pub use crate::journal::place::Place;

use crate::approval::Digest;
use crate::audit::entry::{self, Link, Tail};
use crate::calibrations::record::{Calibration, Kind, Revocation};
use crate::cases::case::Case;
use crate::clients::motion::Standing;
use crate::procedure::Procedure;
use crate::procedure::steps::{BiteOutcome, Step};
use crate::words::words;

/// Opens the journal at `place`, brings its tables up to date, and takes command of it if nobody else has it. A file
/// that another gateway has is refused; a database that another gateway commands is read until it can be taken over.
pub async fn open(place: &Place, name: &str) -> Result<Arc<dyn Journal>, JournalError> {
    Ok(match place {
        Place::File(path) => Arc::new(sqlite::open(path, name).await?),
        Place::Postgres(server) => postgres::open(server, name).await?,
    })
}

/// A part of a list that begins with the newest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// Begins after the one of this id; with the newest if unset. After an id that is not there, there is nothing.
    pub after: Option<String>,
    /// At most so many.
    pub limit: u32,
}

/// The durable store of the gateway.
#[tonic::async_trait]
pub trait Journal: Send + Sync + 'static {
    /// Whether this gateway is in command, as it changes.
    fn duty(&self) -> watch::Receiver<Duty>;
    /// Gives command up, so that another gateway can take it at once. Nothing can be written after that.
    async fn leave(&self) -> Result<(), JournalError>;

    /// Writes a new case.
    async fn create_case(&self, case: &Case) -> Result<(), JournalError>;
    /// Replaces a case and the given blobs together; the other blobs stay.
    async fn save_case(&self, case: &Case, blobs: &[(Blob, Bytes)]) -> Result<(), JournalError>;
    /// One case without its blobs.
    async fn case(&self, case_id: &str) -> Result<Option<Case>, JournalError>;
    /// Cases without their blobs, newest first.
    async fn cases(&self, page: &Page) -> Result<Vec<Case>, JournalError>;
    /// One blob of a case; empty if it was never written.
    async fn blob(&self, case_id: &str, blob: Blob) -> Result<Bytes, JournalError>;

    /// Writes a new procedure; fails while another one is open.
    async fn create_procedure(&self, procedure: &Procedure) -> Result<(), JournalError>;
    /// Replaces a procedure's row.
    async fn save_procedure(&self, procedure: &Procedure) -> Result<(), JournalError>;
    /// Makes this gateway answer for every procedure that is not over and that an earlier one answered for: these, with
    /// their latest steps.
    async fn claim_open(&self) -> Result<Vec<Procedure>, JournalError>;
    /// One procedure with its latest step.
    async fn procedure(&self, procedure_id: &str) -> Result<Option<Procedure>, JournalError>;
    /// Procedures with their latest steps, newest first.
    async fn procedures(&self, page: &Page) -> Result<Vec<Procedure>, JournalError>;

    /// Writes that a step is about to be commanded.
    async fn intend(&self, procedure_id: &str, step: &Step) -> Result<(), JournalError>;
    /// Writes a step's end, what the jaw did in it, and where the procedure then stands, all together.
    async fn end_step(
        &self,
        procedure: &Procedure,
        step: &Step,
        outcome: Option<&BiteOutcome>,
    ) -> Result<(), JournalError>;
    /// Writes where the arms stand after a step, unless that was written before: the first look after a halt is the one that
    /// counts, and no later one makes a moved arm the rule.
    async fn record_standing(
        &self,
        procedure_id: &str,
        sequence: u32,
        standing: &Standing,
    ) -> Result<(), JournalError>;
    /// Where the arms stood after a step, if somebody saw it.
    async fn standing(
        &self,
        procedure_id: &str,
        sequence: u32,
    ) -> Result<Option<Standing>, JournalError>;
    /// All steps of a procedure in order.
    async fn steps(&self, procedure_id: &str) -> Result<Vec<Step>, JournalError>;
    /// What the jaw did, in order.
    async fn bite_outcomes(&self, procedure_id: &str) -> Result<Vec<BiteOutcome>, JournalError>;

    /// Appends to the audit what `link` makes of its end, all or nothing; nobody else writes to it meanwhile. Not fenced:
    /// what a gateway that is not in command refuses, and every stop, is recorded too.
    async fn append_audit(
        &self,
        link: &(dyn Fn(Tail) -> Vec<Link> + Sync),
    ) -> Result<(), JournalError>;
    /// The hash of one entry of the audit.
    async fn audit_hash(&self, sequence: u64) -> Result<Option<Digest>, JournalError>;
    /// At most `limit` entries of the audit.
    async fn audit(&self, filter: &AuditFilter, limit: u32) -> Result<Vec<AuditRow>, JournalError>;
    /// Writes a new calibration.
    async fn create_calibration(&self, calibration: &Calibration) -> Result<(), JournalError>;
    /// Writes that a calibration is not to be used any more.
    async fn revoke_calibration(
        &self,
        calibration_id: &str,
        revocation: &Revocation,
    ) -> Result<(), JournalError>;
    /// Writes which calibration of a kind is in force; none: the configured one.
    async fn put_in_force(
        &self,
        kind: Kind,
        calibration_id: Option<&str>,
        operator: &str,
        at_ms: i64,
    ) -> Result<(), JournalError>;
    /// One calibration.
    async fn calibration(&self, calibration_id: &str) -> Result<Option<Calibration>, JournalError>;
    /// All saved calibrations, newest first.
    async fn calibrations(&self) -> Result<Vec<Calibration>, JournalError>;
    /// The saved calibrations that are in force, at most one of a kind.
    async fn calibrations_in_force(&self) -> Result<Vec<Calibration>, JournalError>;
}

/// Which entries of the audit.
#[derive(Clone, Debug)]
pub struct AuditFilter {
    /// From this number on.
    pub first: u64,
    /// Up to this number.
    pub last: u64,
    /// Of this kind; any if unset.
    pub kind: Option<entry::Kind>,
    /// By this person, certified or stated; anybody if empty.
    pub name: String,
    /// Of this case; any if empty.
    pub case_id: String,
    /// Of this procedure; any if empty.
    pub procedure_id: String,
    /// Not before, milliseconds since 1970-01-01 UTC.
    pub from_ms: i64,
    /// Not after.
    pub to_ms: i64,
    /// The newest of them, in falling order, instead of the oldest in rising order.
    pub newest_first: bool,
}

/// A row of the audit, which may be damaged.
#[derive(Clone, Debug)]
pub struct AuditRow {
    /// Its number.
    pub sequence: u64,
    /// What it says, or why it cannot be read.
    pub link: Result<Link, String>,
}

impl Default for AuditFilter {
    fn default() -> Self {
        Self {
            first: 0,
            last: i64::MAX.unsigned_abs(),
            kind: None,
            name: String::new(),
            case_id: String::new(),
            procedure_id: String::new(),
            from_ms: i64::MIN,
            to_ms: i64::MAX,
            newest_first: false,
        }
    }
}

/// Whether a gateway is the one that commands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Duty {
    /// It is. Its writes bear this epoch, which grows with every change of command.
    InCommand {
        /// From 1.
        epoch: i64,
    },
    /// It reads only.
    Standby {
        /// The name of the one that commands; empty when that is not known.
        holder: String,
    },
}

impl Duty {
    /// Standby while it is not known who commands.
    pub const fn nobody() -> Self {
        Self::Standby {
            holder: String::new(),
        }
    }
}

words! {
    /// The large parts of a case.
    Blob {
        /// Packed vertices of the model.
        Vertices = "VERTICES",
        /// Packed triangles of the model.
        Triangles = "TRIANGLES",
        /// Packed points of the damaged tissue.
        Lesion = "LESION",
        /// Packed points of the view.
        Scene = "SCENE",
        /// Residual of each point of the view, as the registration service sent them.
        Residuals = "RESIDUALS",
    }
}

/// Why the journal cannot be opened, read or written.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// Another gateway has it.
    #[error("journal {path} is in use by another gateway")]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The file or its folder cannot be written.
    #[error("journal {path} cannot be written")]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        #[source]
        source: std::io::Error,
    },
    /// The file is no journal of this gateway, or damaged.
    #[error("journal {path} cannot be opened: {problem}")]
    Unusable {
        /// The file.
        path: PathBuf,
        /// What the database says.
        problem: String,
    },
    /// Another gateway is in command.
    #[error("this gateway is not in command; in command is {holder:?}")]
    NotInCommand {
        /// The other's name.
        holder: String,
    },
    /// Another gateway has taken command meanwhile.
    #[error("command of epoch {epoch} was lost; in command is {holder:?}")]
    Fenced {
        /// What this gateway's write bore.
        epoch: i64,
        /// The other's name.
        holder: String,
    },
    /// The database server cannot be used.
    #[error("journal {place} cannot be used: {problem}")]
    Server {
        /// Its address, without a password.
        place: String,
        /// What it says or lacks.
        problem: String,
    },
    /// A read or write failed.
    #[error("the database failed")]
    Database(#[from] sqlx::Error),
    /// A row holds what this gateway never wrote.
    #[error("{table}.{column} of {id} is damaged: {value:?}")]
    Damaged {
        /// The table.
        table: &'static str,
        /// The column.
        column: &'static str,
        /// The row's key.
        id: String,
        /// What stands there.
        value: String,
    },
}
