//! Cases and their large parts.

use bytes::Bytes;
use sqlx::{Any, AnyPool, AssertSqlSafe, Transaction};

use super::rows;
use crate::cases::case::Case;
use crate::journal::{Blob, JournalError, Page};

const COLUMNS: &str = "case_id, label, created_at_ms, revision, model_digest, lesion_spacing_mm, scene_digest, \
     scene_point_count, scene_has_normals, registration, accepted_by, plan, plan_jaw_width_mm, \
     plan_jaw_length_mm, plan_jaw_throat_mm, approved_by, approved_digest, \
     approved_role, approved_at_ms, countersigned_by, countersigned_role, countersigned_at_ms, \
     accepted_as, accepted_at_ms, verification_basis, touches";

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
    let second = approval.and_then(|approval| approval.second.as_ref());
    let acceptance = case.acceptance.as_ref();
    let verification = case.verification.as_ref();
    sqlx::query(
        "UPDATE cases SET revision = $1, model_digest = $2, lesion_spacing_mm = $3, scene_digest = $4, \
         scene_point_count = $5, scene_has_normals = $6, registration = $7, accepted_by = $8, plan = $9, \
         plan_jaw_width_mm = $10, plan_jaw_length_mm = $11, plan_jaw_throat_mm = $12, approved_by = $13, \
         approved_digest = $14, approved_role = $15, approved_at_ms = $16, countersigned_by = $17, \
         countersigned_role = $18, countersigned_at_ms = $19, accepted_as = $20, accepted_at_ms = $21, \
         verification_basis = $22, touches = $23 WHERE case_id = $24",
    )
    .bind(rows::integer(case.revision))
    .bind(model.map(|model| model.digest.to_string()))
    .bind(model.map(|model| model.lesion_spacing_mm))
    .bind(scene.map(|scene| scene.digest.to_string()))
    .bind(scene.map(|scene| i64::from(scene.point_count)))
    .bind(scene.map(|scene| i64::from(scene.has_normals)))
    .bind(registration.map(|registration| registration.encoded.as_ref()))
    .bind(acceptance.map(|acceptance| acceptance.by.as_str()))
    .bind(plan.map(|plan| plan.encoded.as_ref()))
    .bind(plan.map(|plan| plan.jaw.width_mm))
    .bind(plan.map(|plan| plan.jaw.length_mm))
    .bind(plan.map(|plan| plan.jaw.throat_mm))
    .bind(approval.map(|approval| approval.surgeon.name.as_str()))
    .bind(approval.map(|approval| approval.digest.to_string()))
    .bind(approval.map(|approval| approval.surgeon.role.as_str()))
    .bind(approval.map(|approval| approval.surgeon.at_ms))
    .bind(second.map(|second| second.name.as_str()))
    .bind(second.map(|second| second.role.as_str()))
    .bind(second.map(|second| second.at_ms))
    .bind(acceptance.map(|acceptance| acceptance.role.as_str()))
    .bind(acceptance.map(|acceptance| acceptance.at_ms))
    .bind(verification.map(|verification| verification.basis.to_string()))
    .bind(verification.map(|verification| rows::packed_touches(&verification.touches)))
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

/// Cases without their blobs, newest first.
pub async fn page(pool: &AnyPool, page: &Page) -> Result<Vec<Case>, JournalError> {
    let query = AssertSqlSafe(format!(
        "SELECT {COLUMNS} FROM cases WHERE $1 = '' OR (created_at_ms, case_id) < \
         (SELECT created_at_ms, case_id FROM cases WHERE case_id = $1) \
         ORDER BY created_at_ms DESC, case_id DESC LIMIT $2"
    ));
    sqlx::query(query)
        .bind(page.after.as_deref().unwrap_or_default())
        .bind(i64::from(page.limit))
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
