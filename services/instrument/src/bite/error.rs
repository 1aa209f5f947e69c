//! Why a bite did not close the jaw, or is not known to have closed it.

use std::time::Duration;

use epos4_link::cia402::Statusword;

use super::BiteEnd;

/// Why the jaw is not known to be closed.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum BiteError {
    /// The drive does not obey any more.
    #[error("the drive left operation at {position_mm:.3} mm, statusword {statusword}")]
    LeftOperation {
        /// Where.
        position_mm: f64,
        /// What it reports.
        statusword: Statusword,
    },
    /// The position does not refer to the home point any more.
    #[error("the reference was lost at {position_mm:.3} mm, statusword {statusword}")]
    ReferenceLost {
        /// Where.
        position_mm: f64,
        /// What it reports.
        statusword: Statusword,
    },
    /// A bite begins with an open jaw.
    #[error("the jaw stands at {position_mm:.3} mm; a bite begins at or behind {open_mm} mm")]
    NotOpen {
        /// Where.
        position_mm: f64,
        /// Where it should be at most.
        open_mm: f64,
    },
    /// Stopped by the limit on the way.
    #[error(
        "stopped at {:.3} mm by the current limit of {limit_ma:.0} mA; the jaw is closed from {closed_from_mm} mm on",
        .end.position_mm
    )]
    NotClosed {
        /// As far as it came.
        end: BiteEnd,
        /// Of this bite.
        limit_ma: f64,
        /// Where it would count as closed.
        closed_from_mm: f64,
    },
    /// The current went to the limit and the encoder shows no movement at all.
    #[error(
        "at the current limit of {limit_ma:.0} mA and never left {:.3} mm: the jaw is blocked, or its encoder stands still",
        .end.position_mm
    )]
    NeverMoved {
        /// Where it stands.
        end: BiteEnd,
        /// Of this bite.
        limit_ma: f64,
    },
    /// It stands, and not because of the limit.
    #[error(
        "stands at {:.3} mm short of {target_mm} mm with {current_ma:.0} mA, below the limit of {limit_ma:.0} mA",
        .end.position_mm
    )]
    Stalled {
        /// As far as it came.
        end: BiteEnd,
        /// Where it should be.
        target_mm: f64,
        /// At the end.
        current_ma: f64,
        /// Of this bite.
        limit_ma: f64,
    },
    /// It is where it counts as closed, and its end is not as stiff as blade on blade.
    #[error(
        "at {:.3} mm after a rise of {rise_ma:.0} mA over the last 0.2 mm, but blade on blade rises by {needed_ma:.0} mA: \
         the encoder and the jaw do not go together, or the jaw is not closed",
        .end.position_mm
    )]
    BladesNotFelt {
        /// Where it stands.
        end: BiteEnd,
        /// Of the current.
        rise_ma: f64,
        /// What it should be.
        needed_ma: f64,
    },
    /// It creeps.
    #[error("at {:.3} mm after {} s and still not closed", .end.position_mm, .limit.as_secs_f64())]
    TooSlow {
        /// As far as it came.
        end: BiteEnd,
        /// The time it had.
        limit: Duration,
    },
}

impl BiteError {
    /// What the bite came to, where it came to something.
    pub fn end(&self) -> Option<BiteEnd> {
        match self {
            Self::LeftOperation { .. } | Self::ReferenceLost { .. } | Self::NotOpen { .. } => None,
            Self::NotClosed { end, .. }
            | Self::NeverMoved { end, .. }
            | Self::Stalled { end, .. }
            | Self::BladesNotFelt { end, .. }
            | Self::TooSlow { end, .. } => Some(*end),
        }
    }
}
