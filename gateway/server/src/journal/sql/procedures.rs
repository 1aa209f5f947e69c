//! Procedures, their steps, and what the jaw did.

use sqlx::{Any, AnyPool, AssertSqlSafe, Row as _, Transaction};

use super::{Dialect, rows};
use crate::journal::{JournalError, Page};
use crate::procedure::steps::{BiteOutcome, Step};
use crate::procedure::{Procedure, State};

/// Writes a new procedure; this gateway answers for it.
pub async fn create(
    transaction: &mut Transaction<'_, Any>,
    procedure: &Procedure,
) -> Result<(), JournalError> {
    sqlx::query(
        "INSERT INTO procedures (procedure_id, case_id, operator, state, plan_digest, bites_planned, next_bite, \
         bites_done, reason, detail, started_at_ms, ended_at_ms, robot_seconds, rcm_deviation_max_mm, epoch) \
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, (SELECT epoch FROM command))",
    )
    .bind(&procedure.id)
    .bind(&procedure.case_id)
    .bind(&procedure.operator)
    .bind(procedure.state.as_str())
    .bind(procedure.plan_digest.to_string())
    .bind(i64::from(procedure.bites_planned))
    .bind(i64::from(procedure.next_bite))
    .bind(i64::from(procedure.bites_done))
    .bind(&procedure.reason)
    .bind(&procedure.detail)
    .bind(procedure.started_at_ms)
    .bind(procedure.ended_at_ms)
    .bind(procedure.robot_seconds)
    .bind(procedure.rcm_deviation_max_mm)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Replaces what changes in a procedure's row.
pub async fn save(
    transaction: &mut Transaction<'_, Any>,
    procedure: &Procedure,
) -> Result<(), JournalError> {
    sqlx::query(
        "UPDATE procedures SET state = $1, next_bite = $2, bites_done = $3, reason = $4, detail = $5, \
         ended_at_ms = $6, robot_seconds = $7, rcm_deviation_max_mm = $8 WHERE procedure_id = $9",
    )
    .bind(procedure.state.as_str())
    .bind(i64::from(procedure.next_bite))
    .bind(i64::from(procedure.bites_done))
    .bind(&procedure.reason)
    .bind(&procedure.detail)
    .bind(procedure.ended_at_ms)
    .bind(procedure.robot_seconds)
    .bind(procedure.rcm_deviation_max_mm)
    .bind(&procedure.id)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Makes this gateway answer for every procedure that is not over and that an earlier one answered for; their ids. A
/// row that another transaction holds is left out.
pub async fn claim(
    transaction: &mut Transaction<'_, Any>,
    dialect: Dialect,
) -> Result<Vec<String>, JournalError> {
    let open: Vec<_> = State::ALL
        .iter()
        .filter(|state| !state.is_over())
        .map(|state| format!("'{state}'"))
        .collect();
    let query = AssertSqlSafe(format!(
        "UPDATE procedures SET epoch = (SELECT epoch FROM command) WHERE procedure_id IN \
         (SELECT procedure_id FROM procedures WHERE state IN ({}) AND epoch < (SELECT epoch FROM command){}) \
         RETURNING procedure_id",
        open.join(", "),
        dialect.skip_locked(),
    ));
    sqlx::query(query)
        .fetch_all(&mut **transaction)
        .await?
        .iter()
        .map(|row| Ok(row.try_get("procedure_id")?))
        .collect()
}

/// One procedure with its latest step.
pub async fn one(pool: &AnyPool, procedure_id: &str) -> Result<Option<Procedure>, JournalError> {
    let row = sqlx::query("SELECT * FROM procedures WHERE procedure_id = $1")
        .bind(procedure_id)
        .fetch_optional(pool)
        .await?;
    let Some(row) = row else {
        return Ok(None);
    };
    let mut procedure = rows::procedure(&row)?;
    procedure.step = latest_step(pool, procedure_id).await?;
    Ok(Some(procedure))
}

/// Procedures with their latest steps, newest first.
pub async fn page(pool: &AnyPool, page: &Page) -> Result<Vec<Procedure>, JournalError> {
    let rows = sqlx::query(
        "SELECT * FROM procedures WHERE $1 = '' OR (started_at_ms, procedure_id) < \
         (SELECT started_at_ms, procedure_id FROM procedures WHERE procedure_id = $1) \
         ORDER BY started_at_ms DESC, procedure_id DESC LIMIT $2",
    )
    .bind(page.after.as_deref().unwrap_or_default())
    .bind(i64::from(page.limit))
    .fetch_all(pool)
    .await?;
    let mut procedures = Vec::with_capacity(rows.len());
    for row in &rows {
        let mut procedure = rows::procedure(row)?;
        procedure.step = latest_step(pool, &procedure.id).await?;
        procedures.push(procedure);
    }
    Ok(procedures)
}

/// Writes that a step is about to be commanded.
pub async fn intend(
    transaction: &mut Transaction<'_, Any>,
    procedure_id: &str,
    step: &Step,
) -> Result<(), JournalError> {
    sqlx::query(
        "INSERT INTO steps (procedure_id, sequence, kind, effect, state, bite, operation_id, intended_at_ms, \
         ended_at_ms, started_controller_s, ended_controller_s, detail) \
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12)",
    )
    .bind(procedure_id)
    .bind(i64::from(step.sequence))
    .bind(step.planned.kind.as_str())
    .bind(step.planned.kind.effect().as_str())
    .bind(step.state.as_str())
    .bind(step.planned.bite.map(i64::from))
    .bind(&step.operation_id)
    .bind(step.intended_at_ms)
    .bind(step.ended_at_ms)
    .bind(step.started_controller_s)
    .bind(step.ended_controller_s)
    .bind(&step.detail)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Writes a step's end, what the jaw did in it, and where the procedure then stands.
pub async fn end_step(
    transaction: &mut Transaction<'_, Any>,
    procedure: &Procedure,
    step: &Step,
    outcome: Option<&BiteOutcome>,
) -> Result<(), JournalError> {
    sqlx::query(
        "UPDATE steps SET state = $1, ended_at_ms = $2, ended_controller_s = $3, detail = $4 \
         WHERE procedure_id = $5 AND sequence = $6",
    )
    .bind(step.state.as_str())
    .bind(step.ended_at_ms)
    .bind(step.ended_controller_s)
    .bind(&step.detail)
    .bind(&procedure.id)
    .bind(i64::from(step.sequence))
    .execute(&mut **transaction)
    .await?;
    if let Some(outcome) = outcome {
        sqlx::query(
            "INSERT INTO bite_outcomes (procedure_id, sequence, bite, tip_x_mm, tip_y_mm, tip_z_mm, jaw, \
             peak_current_ma) VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
        )
        .bind(&procedure.id)
        .bind(i64::from(step.sequence))
        .bind(i64::from(outcome.bite))
        .bind(outcome.tip.x)
        .bind(outcome.tip.y)
        .bind(outcome.tip.z)
        .bind(&outcome.jaw)
        .bind(outcome.peak_current_ma)
        .execute(&mut **transaction)
        .await?;
    }
    save(transaction, procedure).await
}

/// All steps of a procedure in order.
pub async fn steps(pool: &AnyPool, procedure_id: &str) -> Result<Vec<Step>, JournalError> {
    sqlx::query("SELECT * FROM steps WHERE procedure_id = $1 ORDER BY sequence")
        .bind(procedure_id)
        .fetch_all(pool)
        .await?
        .iter()
        .map(rows::step)
        .collect()
}

/// What the jaw did, in order.
pub async fn bite_outcomes(
    pool: &AnyPool,
    procedure_id: &str,
) -> Result<Vec<BiteOutcome>, JournalError> {
    sqlx::query("SELECT * FROM bite_outcomes WHERE procedure_id = $1 ORDER BY sequence")
        .bind(procedure_id)
        .fetch_all(pool)
        .await?
        .iter()
        .map(rows::bite_outcome)
        .collect()
}

async fn latest_step(pool: &AnyPool, procedure_id: &str) -> Result<Option<Step>, JournalError> {
    sqlx::query("SELECT * FROM steps WHERE procedure_id = $1 ORDER BY sequence DESC LIMIT 1")
        .bind(procedure_id)
        .fetch_optional(pool)
        .await?
        .as_ref()
        .map(rows::step)
        .transpose()
}
