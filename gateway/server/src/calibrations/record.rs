//! One calibration as a value: what was measured, how sure it is, how long it holds, and whether somebody revoked it.

use arthro_geometry::frame::{Camera, ForcepsBase};
use arthro_geometry::{Point3, Rigid, Rotation};
use bytes::Bytes;
use nalgebra::{Matrix3, Matrix6};

use crate::approval::Digest;
use crate::calendar::utc;
use crate::words::words;

words! {
    /// What is calibrated.
    Kind {
        /// The camera beside the forceps arm.
        HandEye = "HAND_EYE",
        /// The tip of the forceps in the flange.
        ToolTip = "TOOL_TIP",
    }
}

/// A saved calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Chosen by the gateway.
    pub id: String,
    /// For people to read.
    pub label: String,
    /// Who saved it.
    pub saved_by: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub saved_at_ms: i64,
    /// Milliseconds since 1970-01-01 UTC.
    pub valid_until_ms: i64,
    /// What was measured.
    pub measured: Measured,
    /// The whole result as it came.
    pub encoded: Bytes,
    /// Set once somebody said that it is not to be used any more.
    pub revoked: Option<Revocation>,
}

/// What a calibration measured.
#[expect(
    clippy::large_enum_variant,
    reason = "a few exist at a time, and half of them are the large one"
)]
#[derive(Clone, Debug, PartialEq)]
pub enum Measured {
    /// The camera in the forceps arm's base.
    HandEye {
        /// base_from_camera.
        pose: Rigid<ForcepsBase, Camera>,
        /// Of its error: rotation vector (rad), then displacement (mm), axes of the base.
        covariance: Matrix6<f64>,
    },
    /// The tip in the flange.
    ToolTip {
        /// The tip, mm.
        tip: Point3,
        /// Of its error, axes of the flange, mm2.
        covariance_mm2: Matrix3<f64>,
        /// The tool's axes in the flange, if the shaft was measured too.
        flange_from_tool: Option<Rotation>,
    },
}

/// Who said that a calibration is not to be used any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revocation {
    /// Who.
    pub by: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// Why.
    pub because: String,
}

/// What a calibration in force says of itself; `C` is its covariance.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing<C> {
    /// Which calibration.
    pub id: String,
    /// Of the whole record.
    pub digest: Digest,
    /// How sure it is, if that is known.
    pub covariance: Option<C>,
    /// Milliseconds since 1970-01-01 UTC; `None`: its end is not stated.
    pub valid_until_ms: Option<i64>,
    /// When it was revoked.
    pub revoked_at_ms: Option<i64>,
}

/// The calibrations in force.
#[derive(Clone, Debug, PartialEq)]
pub struct InForce {
    /// Of the camera.
    pub hand_eye: Standing<Matrix6<f64>>,
    /// Of the forceps' tip.
    pub tool_tip: Standing<Matrix3<f64>>,
    /// The tool's axes in the flange: as measured, or x along the flange's z.
    pub flange_from_tool: Rotation,
}

/// A calibration that is not to be used, and since when.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the {} calibration {id} {} at {}", kind.name(), how.text(), utc(*since_ms))]
pub struct Unusable {
    /// Which kind.
    pub kind: Kind,
    /// Which one.
    pub id: String,
    /// Why.
    pub how: How,
    /// Milliseconds since 1970-01-01 UTC.
    pub since_ms: i64,
}

words! {
    /// Why a calibration is not to be used.
    How {
        /// Its time was up.
        Expired = "EXPIRED",
        /// Somebody said so.
        Revoked = "REVOKED",
    }
}

// === impl Kind ===

impl Kind {
    /// The id of the one in the configuration.
    pub const fn configured_id(self) -> &'static str {
        match self {
            Self::HandEye => "configured-hand-eye",
            Self::ToolTip => "configured-tool-tip",
        }
    }

    /// The kind whose configured calibration has this id.
    pub fn of_configured(id: &str) -> Option<Self> {
        Self::ALL
            .iter()
            .copied()
            .find(|kind| kind.configured_id() == id)
    }

    const fn name(self) -> &'static str {
        match self {
            Self::HandEye => "hand-eye",
            Self::ToolTip => "tool tip",
        }
    }
}

impl How {
    const fn text(self) -> &'static str {
        match self {
            Self::Expired => "expired",
            Self::Revoked => "was revoked",
        }
    }
}

// === impl Calibration ===

impl Calibration {
    /// Which kind.
    pub const fn kind(&self) -> Kind {
        match self.measured {
            Measured::HandEye { .. } => Kind::HandEye,
            Measured::ToolTip { .. } => Kind::ToolTip,
        }
    }

    /// Refuses one that is expired or revoked.
    pub fn usable(&self, now_ms: i64) -> Result<(), Unusable> {
        let revoked_at_ms = self.revoked.as_ref().map(|revoked| revoked.at_ms);
        usable(
            self.kind(),
            &self.id,
            Some(self.valid_until_ms),
            revoked_at_ms,
            now_ms,
        )
    }

    /// What it says of itself once it is in force.
    pub fn standing<C>(&self, digest: Digest, covariance: C) -> Standing<C> {
        Standing {
            id: self.id.clone(),
            digest,
            covariance: Some(covariance),
            valid_until_ms: Some(self.valid_until_ms),
            revoked_at_ms: self.revoked.as_ref().map(|revoked| revoked.at_ms),
        }
    }
}

// === impl InForce ===

impl InForce {
    /// Refuses if either is expired or revoked.
    pub fn usable(&self, now_ms: i64) -> Result<(), Unusable> {
        let (eye, tip) = (&self.hand_eye, &self.tool_tip);
        usable(
            Kind::HandEye,
            &eye.id,
            eye.valid_until_ms,
            eye.revoked_at_ms,
            now_ms,
        )?;
        usable(
            Kind::ToolTip,
            &tip.id,
            tip.valid_until_ms,
            tip.revoked_at_ms,
            now_ms,
        )
    }

    /// Refuses if either is revoked: what runs out in the middle of a procedure that was begun in time does not end it.
    pub fn not_revoked(&self) -> Result<(), Unusable> {
        let (eye, tip) = (&self.hand_eye, &self.tool_tip);
        usable(Kind::HandEye, &eye.id, None, eye.revoked_at_ms, 0)?;
        usable(Kind::ToolTip, &tip.id, None, tip.revoked_at_ms, 0)
    }
}

fn usable(
    kind: Kind,
    id: &str,
    valid_until_ms: Option<i64>,
    revoked_at_ms: Option<i64>,
    now_ms: i64,
) -> Result<(), Unusable> {
    let expired = valid_until_ms.filter(|until_ms| *until_ms < now_ms);
    let (how, since_ms) = match (revoked_at_ms, expired) {
        (Some(at_ms), _) => (How::Revoked, at_ms),
        (None, Some(until_ms)) => (How::Expired, until_ms),
        (None, None) => return Ok(()),
    };
    Err(Unusable {
        kind,
        id: id.to_owned(),
        how,
        since_ms,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        Calibration {
            id: "c".to_owned(),
            label: "camera on its stand".to_owned(),
            saved_by: "engineer".to_owned(),
            saved_at_ms: 0,
            valid_until_ms: 1_000,
            measured: Measured::HandEye {
                pose: Rigid::identity(),
                covariance: Matrix6::identity(),
            },
            encoded: Bytes::new(),
            revoked: None,
        }
    }

    #[test]
    fn a_calibration_holds_to_its_last_millisecond() {
        let calibration = calibration();
        assert_eq!(calibration.usable(1_000), Ok(()));
        let refusal = calibration.usable(1_001).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "the hand-eye calibration c expired at 1970-01-01T00:00:01Z"
        );
    }

    #[test]
    fn a_revoked_calibration_is_not_used_though_its_time_is_not_up() {
        let mut calibration = calibration();
        calibration.revoked = Some(Revocation {
            by: "engineer".to_owned(),
            at_ms: 500,
            because: "the stand was bumped".to_owned(),
        });
        let refusal = calibration.usable(600).unwrap_err();
        assert_eq!((refusal.how, refusal.since_ms), (How::Revoked, 500));
    }
}
