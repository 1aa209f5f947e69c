//! Cases and their large parts.

use bytes::Bytes;
use sqlx::{Any, AnyPool, AssertSqlSafe, Transaction};

use super::rows;
use crate::cases::case::Case;
use crate::journal::{Blob, JournalError};

const COLUMNS: &str = "case_id, label, created_at_ms, revision, model_digest, lesion_spacing_mm, scene_digest, \
     scene_point_count, scene_has_normals, registration, accepted_by, plan, plan_jaw_width_mm, \
     plan_jaw_length_mm, plan_jaw_throat_mm, approved_by, approved_digest";

/// Writes a new case.
pub async fn create(
    transaction: &mut Transaction<'_, Any>,
    case: &Case,
) -> Result<(), JournalError> {
    sqlx::query(
        "INSERT INTO cases (case_id, label, created_at_ms, revision) VALUES ($1, $2, $3, $4)",
    )
    .bind(&case.id)
    .bind(&case.label)
    .bind(case.created_at_ms)
    .bind(rows::integer(case.revision))
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// Replaces a case and the given blobs.
pub async fn save(
    transaction: &mut Transaction<'_, Any>,
    case: &Case,
    blobs: &[(Blob, Bytes)],
) -> Result<(), JournalError> {
    let model = case.model.as_ref();
    let scene = case.scene.as_ref();
    let registration = case.registration.as_ref();
    let plan = case.plan.as_ref();
    let approval = case.approval.as_ref();
    sqlx::query(
        "UPDATE cases SET revision = $1, model_digest = $2, lesion_spacing_mm = $3, scene_digest = $4, \
         scene_point_count = $5, scene_has_normals = $6, registration = $7, accepted_by = $8, plan = $9, \
         plan_jaw_width_mm = $10, plan_jaw_length_mm = $11, plan_jaw_throat_mm = $12, approved_by = $13, \
         approved_digest = $14 WHERE case_id = $15",
    )
    .bind(rows::integer(case.revision))
    .bind(model.map(|model| model.digest.to_string()))
    .bind(model.map(|model| model.lesion_spacing_mm))
    .bind(scene.map(|scene| scene.digest.to_string()))
    .bind(scene.map(|scene| i64::from(scene.point_count)))
    .bind(scene.map(|scene| i64::from(scene.has_normals)))
    .bind(registration.map(|registration| registration.encoded.as_ref()))
    .bind(case.accepted_by.as_deref())
    .bind(plan.map(|plan| plan.encoded.as_ref()))
    .bind(plan.map(|plan| plan.jaw.width_mm))
    .bind(plan.map(|plan| plan.jaw.length_mm))
    .bind(plan.map(|plan| plan.jaw.throat_mm))
    .bind(approval.map(|approval| approval.surgeon.as_str()))
    .bind(approval.map(|approval| approval.digest.to_string()))
    .bind(&case.id)
    .execute(&mut **transaction)
    .await?;
    for (blob, bytes) in blobs {
        sqlx::query(
            "INSERT INTO case_blobs (case_id, kind, bytes) VALUES ($1, $2, $3) \
             ON CONFLICT (case_id, kind) DO UPDATE SET bytes = excluded.bytes",
        )
        .bind(&case.id)
        .bind(blob.as_str())
        .bind(bytes.as_ref())
        .execute(&mut **transaction)
        .await?;
    }
    Ok(())
}

/// One case without its blobs.
pub async fn one(pool: &AnyPool, case_id: &str) -> Result<Option<Case>, JournalError> {
    let query = AssertSqlSafe(format!("SELECT {COLUMNS} FROM cases WHERE case_id = $1"));
    sqlx::query(query)
        .bind(case_id)
        .fetch_optional(pool)
        .await?
        .as_ref()
        .map(rows::case)
        .transpose()
}

/// All cases without their blobs, newest first.
pub async fn all(pool: &AnyPool) -> Result<Vec<Case>, JournalError> {
    let query = AssertSqlSafe(format!(
        "SELECT {COLUMNS} FROM cases ORDER BY created_at_ms DESC, case_id DESC"
    ));
    sqlx::query(query)
        .fetch_all(pool)
        .await?
        .iter()
        .map(rows::case)
        .collect()
}

/// One blob; empty if it was never written.
pub async fn blob(pool: &AnyPool, case_id: &str, blob: Blob) -> Result<Bytes, JournalError> {
    let bytes: Option<Vec<u8>> =
        sqlx::query_scalar("SELECT bytes FROM case_blobs WHERE case_id = $1 AND kind = $2")
            .bind(case_id)
            .bind(blob.as_str())
            .fetch_optional(pool)
            .await?;
    Ok(bytes.unwrap_or_default().into())
}
