//! Rows as the domain's types. A value that this gateway never writes is damage, named by table,
//! column and key.

use arthro_geometry::Point3;
use arthro_proto::planning::v1::ResectionPlan;
use arthro_proto::registration::v1::RegistrationResult;
use prost::Message as _;
use sqlx::Row as _;
use sqlx::any::AnyRow;

use crate::approval::{Approval, Digest};
use crate::cases::case::{Case, ModelInfo, Plan, Registration, SceneInfo};
use crate::config::Jaw;
use crate::journal::JournalError;
use crate::procedure::steps::{BiteOutcome, Kind, Planned, Step, StepState};
use crate::procedure::{Procedure, State};
use crate::wire;

/// The databases' integers are signed.
pub fn integer(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// A row of `cases`.
pub fn case(row: &AnyRow) -> Result<Case, JournalError> {
    let key = Key::new("cases", row.try_get("case_id")?);
    let model = match row.try_get::<Option<String>, _>("model_digest")? {
        None => None,
        Some(digest) => Some(ModelInfo {
            digest: key.parsed("model_digest", &digest, Digest::parse)?,
            lesion_spacing_mm: row.try_get("lesion_spacing_mm")?,
        }),
    };
    let scene = match row.try_get::<Option<String>, _>("scene_digest")? {
        None => None,
        Some(digest) => Some(SceneInfo {
            digest: key.parsed("scene_digest", &digest, Digest::parse)?,
            point_count: key.count(row, "scene_point_count")?,
            has_normals: row.try_get::<i64, _>("scene_has_normals")? != 0,
        }),
    };
    let registration = match row.try_get::<Option<Vec<u8>>, _>("registration")? {
        None => None,
        Some(encoded) => Some(registration(&key, &encoded)?),
    };
    let plan = match row.try_get::<Option<Vec<u8>>, _>("plan")? {
        None => None,
        Some(encoded) => Some(plan(&key, row, &encoded)?),
    };
    let approval = match row.try_get::<Option<String>, _>("approved_digest")? {
        None => None,
        Some(digest) => Some(Approval {
            surgeon: row.try_get("approved_by")?,
            digest: key.parsed("approved_digest", &digest, Digest::parse)?,
        }),
    };
    Ok(Case {
        id: key.id,
        label: row.try_get("label")?,
        created_at_ms: row.try_get("created_at_ms")?,
        revision: row.try_get::<i64, _>("revision")?.unsigned_abs(),
        model,
        scene,
        registration,
        accepted_by: row.try_get("accepted_by")?,
        plan,
        approval,
    })
}

fn registration(key: &Key, encoded: &[u8]) -> Result<Registration, JournalError> {
    let result = RegistrationResult::decode(encoded)
        .map_err(|error| key.damaged("registration", error.to_string()))?;
    wire::registration(result).map_err(|violation| {
        key.damaged(
            "registration",
            format!("{} {}", violation.field, violation.description),
        )
    })
}

fn plan(key: &Key, row: &AnyRow, encoded: &[u8]) -> Result<Plan, JournalError> {
    let message =
        ResectionPlan::decode(encoded).map_err(|error| key.damaged("plan", error.to_string()))?;
    let jaw = Jaw {
        width_mm: row.try_get("plan_jaw_width_mm")?,
        length_mm: row.try_get("plan_jaw_length_mm")?,
        throat_mm: row.try_get("plan_jaw_throat_mm")?,
    };
    wire::plan(&message, jaw).map_err(|violation| {
        key.damaged(
            "plan",
            format!("{} {}", violation.field, violation.description),
        )
    })
}

/// A row of `procedures`, without its latest step.
pub fn procedure(row: &AnyRow) -> Result<Procedure, JournalError> {
    let key = Key::new("procedures", row.try_get("procedure_id")?);
    Ok(Procedure {
        case_id: row.try_get("case_id")?,
        operator: row.try_get("operator")?,
        state: key.parsed("state", row.try_get("state")?, State::parse)?,
        plan_digest: key.parsed("plan_digest", row.try_get("plan_digest")?, Digest::parse)?,
        bites_planned: key.count(row, "bites_planned")?,
        next_bite: key.count(row, "next_bite")?,
        bites_done: key.count(row, "bites_done")?,
        step: None,
        reason: row.try_get("reason")?,
        detail: row.try_get("detail")?,
        started_at_ms: row.try_get("started_at_ms")?,
        ended_at_ms: row.try_get("ended_at_ms")?,
        robot_seconds: row.try_get("robot_seconds")?,
        rcm_deviation_max_mm: row.try_get("rcm_deviation_max_mm")?,
        id: key.id,
    })
}

/// A row of `steps`.
pub fn step(row: &AnyRow) -> Result<Step, JournalError> {
    let key = Key::new("steps", row.try_get("operation_id")?);
    Ok(Step {
        sequence: key.count(row, "sequence")?,
        planned: Planned {
            kind: key.parsed("kind", row.try_get("kind")?, Kind::parse)?,
            bite: key.optional_count(row, "bite")?,
        },
        state: key.parsed("state", row.try_get("state")?, StepState::parse)?,
        intended_at_ms: row.try_get("intended_at_ms")?,
        ended_at_ms: row.try_get("ended_at_ms")?,
        started_controller_s: row.try_get("started_controller_s")?,
        ended_controller_s: row.try_get("ended_controller_s")?,
        detail: row.try_get("detail")?,
        operation_id: key.id,
    })
}

/// A row of `bite_outcomes`.
pub fn bite_outcome(row: &AnyRow) -> Result<BiteOutcome, JournalError> {
    let key = Key::new("bite_outcomes", row.try_get("procedure_id")?);
    Ok(BiteOutcome {
        bite: key.count(row, "bite")?,
        tip: Point3::new(
            row.try_get("tip_x_mm")?,
            row.try_get("tip_y_mm")?,
            row.try_get("tip_z_mm")?,
        ),
        jaw: row.try_get("jaw")?,
        peak_current_ma: row.try_get("peak_current_ma")?,
    })
}

/// Which row is being read, for naming damage.
struct Key {
    table: &'static str,
    id: String,
}

impl Key {
    fn new(table: &'static str, id: String) -> Self {
        Self { table, id }
    }

    fn parsed<T>(
        &self,
        column: &'static str,
        text: &str,
        parse: fn(&str) -> Option<T>,
    ) -> Result<T, JournalError> {
        parse(text).ok_or_else(|| self.damaged(column, text.to_owned()))
    }

    /// A count or index.
    fn count(&self, row: &AnyRow, column: &'static str) -> Result<u32, JournalError> {
        self.natural(column, row.try_get(column)?)
    }

    /// A count or index that may be absent.
    fn optional_count(
        &self,
        row: &AnyRow,
        column: &'static str,
    ) -> Result<Option<u32>, JournalError> {
        row.try_get::<Option<i64>, _>(column)?
            .map(|value| self.natural(column, value))
            .transpose()
    }

    fn natural(&self, column: &'static str, value: i64) -> Result<u32, JournalError> {
        u32::try_from(value).map_err(|_| self.damaged(column, value.to_string()))
    }

    fn damaged(&self, column: &'static str, value: String) -> JournalError {
        JournalError::Damaged {
            table: self.table,
            column,
            id: self.id.clone(),
            value,
        }
    }
}
