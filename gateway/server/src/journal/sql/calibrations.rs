//! Saved calibrations, and which of them are in force.

use sqlx::{Any, AnyPool, Transaction};

use super::rows;
use crate::calibrations::record::{Calibration, Kind, Revocation};
use crate::journal::JournalError;

/// Writes a new calibration.
pub async fn create(
    transaction: &mut Transaction<'_, Any>,
    calibration: &Calibration,
) -> Result<(), JournalError> {
    sqlx::query(
        "INSERT INTO calibrations (calibration_id, kind, label, saved_by, saved_at_ms, valid_until_ms, result) \
         VALUES ($1, $2, $3, $4, $5, $6, $7)",
    )
    .bind(&calibration.id)
    .bind(calibration.kind().as_str())
    .bind(&calibration.label)
    .bind(&calibration.saved_by)
    .bind(calibration.saved_at_ms)
    .bind(calibration.valid_until_ms)
    .bind(calibration.encoded.as_ref())
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Writes that a calibration is not to be used any more.
pub async fn revoke(
    transaction: &mut Transaction<'_, Any>,
    calibration_id: &str,
    revocation: &Revocation,
) -> Result<(), JournalError> {
    sqlx::query(
        "UPDATE calibrations SET revoked_by = $1, revoked_at_ms = $2, revoked_because = $3 \
         WHERE calibration_id = $4",
    )
    .bind(&revocation.by)
    .bind(revocation.at_ms)
    .bind(&revocation.because)
    .bind(calibration_id)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Writes which calibration of a kind is in force; none: the configured one.
pub async fn put_in_force(
    transaction: &mut Transaction<'_, Any>,
    kind: Kind,
    calibration_id: Option<&str>,
    operator: &str,
    at_ms: i64,
) -> Result<(), JournalError> {
    sqlx::query("DELETE FROM calibrations_in_force WHERE kind = $1")
        .bind(kind.as_str())
        .execute(&mut **transaction)
        .await?;
    let Some(calibration_id) = calibration_id else {
        return Ok(());
    };
    sqlx::query(
        "INSERT INTO calibrations_in_force (kind, calibration_id, activated_by, activated_at_ms) \
         VALUES ($1, $2, $3, $4)",
    )
    .bind(kind.as_str())
    .bind(calibration_id)
    .bind(operator)
    .bind(at_ms)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// One calibration.
pub async fn one(
    pool: &AnyPool,
    calibration_id: &str,
) -> Result<Option<Calibration>, JournalError> {
    sqlx::query("SELECT * FROM calibrations WHERE calibration_id = $1")
        .bind(calibration_id)
        .fetch_optional(pool)
        .await?
        .as_ref()
        .map(rows::calibration)
        .transpose()
}

/// All calibrations, newest first.
pub async fn all(pool: &AnyPool) -> Result<Vec<Calibration>, JournalError> {
    sqlx::query("SELECT * FROM calibrations ORDER BY saved_at_ms DESC, calibration_id DESC")
        .fetch_all(pool)
        .await?
        .iter()
        .map(rows::calibration)
        .collect()
}

/// Those that are in force.
pub async fn in_force(pool: &AnyPool) -> Result<Vec<Calibration>, JournalError> {
    sqlx::query(
        "SELECT calibrations.* FROM calibrations \
         JOIN calibrations_in_force ON calibrations_in_force.calibration_id = calibrations.calibration_id \
         ORDER BY calibrations.kind",
    )
    .fetch_all(pool)
    .await?
    .iter()
    .map(rows::calibration)
    .collect()
}
