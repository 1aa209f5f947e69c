//! The journal in one SQLite file: write-ahead log, `synchronous=FULL`, so that a returned write is
//! on the disk; one connection writes, and a lock file beside it keeps a second gateway out.

mod rows;
mod standing;

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use bytes::Bytes;
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Executor, Sqlite};

use super::{Blob, Journal, JournalError};
use crate::cases::case::Case;
use crate::clients::motion::Standing;
use crate::procedure::Procedure;
use crate::procedure::steps::{BiteOutcome, Step};

/// A reader may hold the file for this long before a write gives up.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// Connections that only read.
const READERS: u32 = 4;

const CASE_COLUMNS: &str = "case_id, label, created_at_ms, revision, model_digest, lesion_spacing_mm, scene_digest, \
     scene_point_count, scene_has_normals, registration, accepted_by, plan, plan_jaw_width_mm, \
     plan_jaw_length_mm, plan_jaw_throat_mm, approved_by, approved_digest";

/// The open journal. The file belongs to this gateway until the last clone is dropped.
#[derive(Debug)]
pub struct SqliteJournal {
    writer: SqlitePool,
    readers: SqlitePool,
    /// Locked as long as it is open; the system unlocks it when the process dies.
    _lock: File,
}

impl SqliteJournal {
    /// Opens the file, creates it if it is absent, and brings its tables up to date.
    pub async fn open(path: &Path) -> Result<Self, JournalError> {
        let lock = lock(path)?;
        let unusable = |problem: String| JournalError::Unusable {
            path: path.to_owned(),
            problem,
        };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT);
        let writer = pool(1)
            .connect_with(options.clone())
            .await
            .map_err(|error| unusable(error.to_string()))?;
        let damage: String = sqlx::query_scalar("PRAGMA quick_check(1)")
            .fetch_one(&writer)
            .await
            .map_err(|error| unusable(error.to_string()))?;
        if damage != "ok" {
            return Err(unusable(damage));
        }
        sqlx::migrate!("./migrations")
            .run(&writer)
            .await
            .map_err(|error| unusable(error.to_string()))?;
        let readers = pool(READERS)
            .connect_with(options.read_only(true).create_if_missing(false))
            .await
            .map_err(|error| unusable(error.to_string()))?;
        Ok(Self {
            writer,
            readers,
            _lock: lock,
        })
    }
}

fn pool(connections: u32) -> SqlitePoolOptions {
    SqlitePoolOptions::new()
        .max_connections(connections)
        .idle_timeout(None)
        .max_lifetime(None)
}

/// Takes the file `<journal>.lock`, and so makes sure that the folder can be written.
fn lock(path: &Path) -> Result<File, JournalError> {
    let unwritable = |source| JournalError::Unwritable {
        path: path.to_owned(),
        source,
    };
    let mut lock_path = path.as_os_str().to_owned();
    lock_path.push(".lock");
    let lock = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .open(PathBuf::from(lock_path))
        .map_err(unwritable)?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(JournalError::InUse {
                path: path.to_owned(),
            });
        }
        Err(TryLockError::Error(error)) => return Err(unwritable(error)),
    }
    // SQLite opens a file that it may not write read-only without a word.
    if path.exists() {
        OpenOptions::new()
            .append(true)
            .open(path)
            .map_err(unwritable)?;
    }
    Ok(lock)
}

#[tonic::async_trait]
impl Journal for SqliteJournal {
    async fn create_case(&self, case: &Case) -> Result<(), JournalError> {
        sqlx::query(
            "INSERT INTO cases (case_id, label, created_at_ms, revision) VALUES (?, ?, ?, ?)",
        )
        .bind(&case.id)
        .bind(&case.label)
        .bind(case.created_at_ms)
        .bind(rows::integer(case.revision))
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn save_case(&self, case: &Case, blobs: &[(Blob, Bytes)]) -> Result<(), JournalError> {
        let mut transaction = self.writer.begin().await?;
        let model = case.model.as_ref();
        let scene = case.scene.as_ref();
        let registration = case.registration.as_ref();
        let plan = case.plan.as_ref();
        let approval = case.approval.as_ref();
        sqlx::query(
            "UPDATE cases SET revision = ?, model_digest = ?, lesion_spacing_mm = ?, scene_digest = ?, \
             scene_point_count = ?, scene_has_normals = ?, registration = ?, accepted_by = ?, plan = ?, \
             plan_jaw_width_mm = ?, plan_jaw_length_mm = ?, plan_jaw_throat_mm = ?, approved_by = ?, \
             approved_digest = ? \
             WHERE case_id = ?",
        )
        .bind(rows::integer(case.revision))
        .bind(model.map(|model| model.digest.to_string()))
        .bind(model.map(|model| model.lesion_spacing_mm))
        .bind(scene.map(|scene| scene.digest.to_string()))
        .bind(scene.map(|scene| scene.point_count))
        .bind(scene.map(|scene| scene.has_normals))
        .bind(registration.map(|registration| registration.encoded.as_ref()))
        .bind(&case.accepted_by)
        .bind(plan.map(|plan| plan.encoded.as_ref()))
        .bind(plan.map(|plan| plan.jaw.width_mm))
        .bind(plan.map(|plan| plan.jaw.length_mm))
        .bind(plan.map(|plan| plan.jaw.throat_mm))
        .bind(approval.map(|approval| &approval.surgeon))
        .bind(approval.map(|approval| approval.digest.to_string()))
        .bind(&case.id)
        .execute(&mut *transaction)
        .await?;
        for (blob, bytes) in blobs {
            sqlx::query(
                "INSERT OR REPLACE INTO case_blobs (case_id, kind, bytes) VALUES (?, ?, ?)",
            )
            .bind(&case.id)
            .bind(blob.as_str())
            .bind(bytes.as_ref())
            .execute(&mut *transaction)
            .await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    async fn case(&self, case_id: &str) -> Result<Option<Case>, JournalError> {
        let query = sqlx::AssertSqlSafe(format!(
            "SELECT {CASE_COLUMNS} FROM cases WHERE case_id = ?"
        ));
        sqlx::query(query)
            .bind(case_id)
            .fetch_optional(&self.readers)
            .await?
            .as_ref()
            .map(rows::case)
            .transpose()
    }

    async fn cases(&self) -> Result<Vec<Case>, JournalError> {
        let query = sqlx::AssertSqlSafe(format!(
            "SELECT {CASE_COLUMNS} FROM cases ORDER BY created_at_ms DESC, case_id DESC"
        ));
        sqlx::query(query)
            .fetch_all(&self.readers)
            .await?
            .iter()
            .map(rows::case)
            .collect()
    }

    async fn blob(&self, case_id: &str, blob: Blob) -> Result<Bytes, JournalError> {
        let bytes: Option<Vec<u8>> =
            sqlx::query_scalar("SELECT bytes FROM case_blobs WHERE case_id = ? AND kind = ?")
                .bind(case_id)
                .bind(blob.as_str())
                .fetch_optional(&self.readers)
                .await?;
        Ok(bytes.unwrap_or_default().into())
    }

    async fn create_procedure(&self, procedure: &Procedure) -> Result<(), JournalError> {
        sqlx::query(
            "INSERT INTO procedures (procedure_id, case_id, operator, state, plan_digest, bites_planned, next_bite, \
             bites_done, reason, detail, started_at_ms, ended_at_ms, robot_seconds, rcm_deviation_max_mm) \
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(&procedure.id)
        .bind(&procedure.case_id)
        .bind(&procedure.operator)
        .bind(procedure.state.as_str())
        .bind(procedure.plan_digest.to_string())
        .bind(procedure.bites_planned)
        .bind(procedure.next_bite)
        .bind(procedure.bites_done)
        .bind(&procedure.reason)
        .bind(&procedure.detail)
        .bind(procedure.started_at_ms)
        .bind(procedure.ended_at_ms)
        .bind(procedure.robot_seconds)
        .bind(procedure.rcm_deviation_max_mm)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn save_procedure(&self, procedure: &Procedure) -> Result<(), JournalError> {
        update_procedure(&self.writer, procedure).await
    }

    async fn procedure(&self, procedure_id: &str) -> Result<Option<Procedure>, JournalError> {
        let row = sqlx::query("SELECT * FROM procedures WHERE procedure_id = ?")
            .bind(procedure_id)
            .fetch_optional(&self.readers)
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let mut procedure = rows::procedure(&row)?;
        procedure.step = self.latest_step(procedure_id).await?;
        Ok(Some(procedure))
    }

    async fn procedures(&self) -> Result<Vec<Procedure>, JournalError> {
        let rows =
            sqlx::query("SELECT * FROM procedures ORDER BY started_at_ms DESC, procedure_id DESC")
                .fetch_all(&self.readers)
                .await?;
        let mut procedures = Vec::with_capacity(rows.len());
        for row in &rows {
            let mut procedure = rows::procedure(row)?;
            procedure.step = self.latest_step(&procedure.id).await?;
            procedures.push(procedure);
        }
        Ok(procedures)
    }

    async fn intend(&self, procedure_id: &str, step: &Step) -> Result<(), JournalError> {
        sqlx::query(
            "INSERT INTO steps (procedure_id, sequence, kind, effect, state, bite, operation_id, intended_at_ms, \
             ended_at_ms, started_controller_s, ended_controller_s, detail) \
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(procedure_id)
        .bind(step.sequence)
        .bind(step.planned.kind.as_str())
        .bind(step.planned.kind.effect().as_str())
        .bind(step.state.as_str())
        .bind(step.planned.bite)
        .bind(&step.operation_id)
        .bind(step.intended_at_ms)
        .bind(step.ended_at_ms)
        .bind(step.started_controller_s)
        .bind(step.ended_controller_s)
        .bind(&step.detail)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn end_step(
        &self,
        procedure: &Procedure,
        step: &Step,
        outcome: Option<&BiteOutcome>,
    ) -> Result<(), JournalError> {
        let mut transaction = self.writer.begin().await?;
        sqlx::query(
            "UPDATE steps SET state = ?, ended_at_ms = ?, ended_controller_s = ?, detail = ? \
             WHERE procedure_id = ? AND sequence = ?",
        )
        .bind(step.state.as_str())
        .bind(step.ended_at_ms)
        .bind(step.ended_controller_s)
        .bind(&step.detail)
        .bind(&procedure.id)
        .bind(step.sequence)
        .execute(&mut *transaction)
        .await?;
        if let Some(outcome) = outcome {
            sqlx::query(
                "INSERT INTO bite_outcomes (procedure_id, sequence, bite, tip_x_mm, tip_y_mm, tip_z_mm, jaw, \
                 peak_current_ma) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            )
            .bind(&procedure.id)
            .bind(step.sequence)
            .bind(outcome.bite)
            .bind(outcome.tip.x)
            .bind(outcome.tip.y)
            .bind(outcome.tip.z)
            .bind(&outcome.jaw)
            .bind(outcome.peak_current_ma)
            .execute(&mut *transaction)
            .await?;
        }
        update_procedure(&mut *transaction, procedure).await?;
        transaction.commit().await?;
        Ok(())
    }

    async fn record_standing(
        &self,
        procedure_id: &str,
        sequence: u32,
        standing: &Standing,
    ) -> Result<(), JournalError> {
        standing::record(&self.writer, procedure_id, sequence, standing).await
    }

    async fn standing(
        &self,
        procedure_id: &str,
        sequence: u32,
    ) -> Result<Option<Standing>, JournalError> {
        standing::read(&self.readers, procedure_id, sequence).await
    }

    async fn steps(&self, procedure_id: &str) -> Result<Vec<Step>, JournalError> {
        sqlx::query("SELECT * FROM steps WHERE procedure_id = ? ORDER BY sequence")
            .bind(procedure_id)
            .fetch_all(&self.readers)
            .await?
            .iter()
            .map(rows::step)
            .collect()
    }

    async fn bite_outcomes(&self, procedure_id: &str) -> Result<Vec<BiteOutcome>, JournalError> {
        sqlx::query("SELECT * FROM bite_outcomes WHERE procedure_id = ? ORDER BY sequence")
            .bind(procedure_id)
            .fetch_all(&self.readers)
            .await?
            .iter()
            .map(rows::bite_outcome)
            .collect()
    }
}

impl SqliteJournal {
    async fn latest_step(&self, procedure_id: &str) -> Result<Option<Step>, JournalError> {
        sqlx::query("SELECT * FROM steps WHERE procedure_id = ? ORDER BY sequence DESC LIMIT 1")
            .bind(procedure_id)
            .fetch_optional(&self.readers)
            .await?
            .as_ref()
            .map(rows::step)
            .transpose()
    }
}

async fn update_procedure(
    executor: impl Executor<'_, Database = Sqlite>,
    procedure: &Procedure,
) -> Result<(), JournalError> {
    sqlx::query(
        "UPDATE procedures SET state = ?, next_bite = ?, bites_done = ?, reason = ?, detail = ?, ended_at_ms = ?, \
         robot_seconds = ?, rcm_deviation_max_mm = ? WHERE procedure_id = ?",
    )
    .bind(procedure.state.as_str())
    .bind(procedure.next_bite)
    .bind(procedure.bites_done)
    .bind(&procedure.reason)
    .bind(&procedure.detail)
    .bind(procedure.ended_at_ms)
    .bind(procedure.robot_seconds)
    .bind(procedure.rcm_deviation_max_mm)
    .bind(&procedure.id)
    .execute(executor)
    .await?;
    Ok(())
}
