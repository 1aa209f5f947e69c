//! Where the arms stood after a step, one row an arm.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::{Quaternion, UnitQuaternion};
use arthro_geometry::{Rigid, Vector3};
use sqlx::any::AnyRow;
use sqlx::{Any, AnyPool, Row as _, Transaction};

use crate::clients::motion::{Arm, Standing};
use crate::journal::JournalError;

/// Both arms together; what stands there already stays.
pub async fn record(
    transaction: &mut Transaction<'_, Any>,
    procedure_id: &str,
    sequence: u32,
    standing: &Standing,
) -> Result<(), JournalError> {
    for arm in Arm::ALL {
        let pose = standing.get(*arm);
        let (rotation, tip) = (pose.rotation(), pose.origin());
        sqlx::query(
            "INSERT INTO standings (procedure_id, sequence, arm, recorded_at_ms, rotation_w, rotation_x, rotation_y, \
             rotation_z, tip_x_mm, tip_y_mm, tip_z_mm) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11) \
             ON CONFLICT (procedure_id, sequence, arm) DO NOTHING",
        )
        .bind(procedure_id)
        .bind(i64::from(sequence))
        .bind(arm.as_str())
        .bind(standing.at_ms)
        .bind(rotation.w)
        .bind(rotation.i)
        .bind(rotation.j)
        .bind(rotation.k)
        .bind(tip.x)
        .bind(tip.y)
        .bind(tip.z)
        .execute(&mut **transaction)
        .await?;
    }
    Ok(())
}

/// Both arms, or none where not both were seen.
pub async fn read(
    readers: &AnyPool,
    procedure_id: &str,
    sequence: u32,
) -> Result<Option<Standing>, JournalError> {
    let rows = sqlx::query("SELECT * FROM standings WHERE procedure_id = $1 AND sequence = $2")
        .bind(procedure_id)
        .bind(i64::from(sequence))
        .fetch_all(readers)
        .await?;
    let mut forceps = None;
    let mut arthroscope = None;
    let mut at_ms = 0;
    for row in &rows {
        at_ms = row.try_get("recorded_at_ms")?;
        let arm: String = row.try_get("arm")?;
        let pose = Some(pose(row)?);
        match Arm::parse(&arm) {
            Some(Arm::Forceps) => forceps = pose,
            Some(Arm::Arthroscope) => arthroscope = pose,
            None => {
                return Err(JournalError::Damaged {
                    table: "standings",
                    column: "arm",
                    id: procedure_id.to_owned(),
                    value: arm,
                });
            }
        }
    }
    Ok(forceps
        .zip(arthroscope)
        .map(|(forceps, arthroscope)| Standing {
            at_ms,
            forceps,
            arthroscope,
        }))
}

fn pose(row: &AnyRow) -> Result<Rigid<Base, Tool>, JournalError> {
    // As they were written: of norm 1, which must not be divided by once more.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(
        row.try_get("rotation_w")?,
        row.try_get("rotation_x")?,
        row.try_get("rotation_y")?,
        row.try_get("rotation_z")?,
    ));
    let tip = Vector3::new(
        row.try_get("tip_x_mm")?,
        row.try_get("tip_y_mm")?,
        row.try_get("tip_z_mm")?,
    );
    Ok(Rigid::new(rotation, tip))
}
