//! Records where the arms stand once a procedure is halted, as soon as the devices answer.
//!
//! The record belongs to the latest step: arms move in steps alone, so that until the next one is
//! intended nothing of ours can make it wrong, and whatever does was somebody else.

use std::sync::Arc;
use std::time::Duration;

use crate::clients::Clients;
use crate::clients::motion::{Arms, Standing};
use crate::error::{Error, Result};
use crate::journal::Journal;
use crate::procedure::Procedure;
use crate::wall_clock::now_ms;

/// Between two looks at arms that move or do not answer.
const LOOK_PERIOD: Duration = Duration::from_millis(500);

/// What the record belongs to.
pub fn sequence(procedure: &Procedure) -> u32 {
    procedure.step.as_ref().map_or(0, |step| step.sequence)
}

/// Where the arms stood, recorded now if nobody did before. Refused with POSE_UNKNOWN while an arm moves or is out of
/// sight.
pub async fn recorded(
    journal: &Arc<dyn Journal>,
    procedure: &Procedure,
    arms: &Arms,
) -> Result<Standing> {
    let sequence = sequence(procedure);
    if let Some(standing) = journal.standing(&procedure.id, sequence).await? {
        return Ok(standing);
    }
    let standing = arms.standing(now_ms()).ok_or_else(|| Error::PoseUnknown {
        problem: "an arm moves, or is not connected".to_owned(),
    })?;
    journal
        .record_standing(&procedure.id, sequence, &standing)
        .await?;
    // Somebody else may have been first, and the first counts.
    let first = journal.standing(&procedure.id, sequence).await?;
    Ok(first.unwrap_or(standing))
}

/// Looks until the arms stand in sight, and records that. `halted` tells whether it is still of use.
pub async fn record_when_seen(
    journal: Arc<dyn Journal>,
    clients: Clients,
    procedure: Procedure,
    halted: impl Fn() -> bool,
) {
    while halted() {
        let looked = match clients.motion.arms().await {
            Ok(arms) => recorded(&journal, &procedure, &arms).await.map(drop),
            Err(failure) => Err(failure.into()),
        };
        match looked {
            Ok(()) => return,
            Err(error) => {
                tracing::debug!(%error, procedure_id = procedure.id, "the arms' pose is not recorded yet");
            }
        }
        tokio::time::sleep(LOOK_PERIOD).await;
    }
}
