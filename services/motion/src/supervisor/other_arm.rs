//! What a watch knows of the other arm: where it was last, how long ago, and how near.
//!
//! The other controller's clock is another clock. How old its last state is is counted on this arm's
//! own, from the first cycle in which that state was seen. Within the limit the other arm may be anywhere
//! that its last speed has brought it; beyond, nobody knows, and that is a fault.

use super::rules::breach;
use super::{Breach, Regime};
use crate::bodies::Bodies;
use crate::cell::{Berth, Other};
use crate::clearance::{Keep, Nearest};

#[derive(Clone, Debug)]
pub(super) struct OtherArm {
    /// As the limits have it.
    limit: Keep,
    /// The same, or less once arms that were too near were acknowledged.
    keep: Keep,
    sight: Sight,
    /// The newest state seen: its number, and this arm's time when it was new.
    newest: Option<(u64, f64)>,
}

#[derive(Clone, Copy, Debug)]
enum Sight {
    /// No other arm within reach.
    Apart,
    /// No link, or nobody has stated where it stands.
    Unknown(&'static str),
    Seen {
        /// Less what the other arm may have moved since.
        nearest: Nearest,
        age_s: f64,
    },
}

impl OtherArm {
    pub(super) fn new(limit: Keep) -> Self {
        Self {
            limit,
            keep: limit,
            sight: Sight::Unknown("nothing was looked at yet"),
            newest: None,
        }
    }

    pub(super) fn keep(&self) -> Keep {
        self.keep
    }

    /// `own` in the common frame; `time_s` on this arm's clock.
    pub(super) fn look(&mut self, berth: &Berth, own: &Bodies, time_s: f64) {
        self.sight = match berth.other() {
            Other::Apart => Sight::Apart,
            Other::Unstated => Sight::Unknown("nobody has stated where it stands"),
            Other::Unknown => Sight::Unknown("its controller is not connected"),
            Other::Here(present) => {
                let since_s = match self.newest {
                    Some((number, since_s)) if number == present.number => since_s,
                    _ => time_s,
                };
                self.newest = Some((present.number, since_s));
                let age_s = time_s - since_s;
                let nearest = own
                    .nearest(&present.bodies)
                    .less(present.speed_mm_s * age_s);
                Sight::Seen { nearest, age_s }
            }
        };
        if let Sight::Seen { nearest, .. } = &self.sight
            && self.limit.missed(nearest).is_none()
        {
            self.keep = self.limit;
        }
    }

    pub(super) fn acknowledge(&mut self, slack_mm: f64) {
        if let Sight::Seen { nearest, .. } = &self.sight {
            self.keep = match self.limit.missed(nearest) {
                Some(_) => self.limit.eased(nearest, slack_mm),
                None => self.limit,
            };
        }
    }

    pub(super) fn forget_time(&mut self) {
        self.newest = None;
    }

    /// A retraction along the shaft does not wait for news of the other arm: it must always be open.
    pub(super) fn check(&self, regime: Regime, stale_s: f64) -> Result<(), Breach> {
        match &self.sight {
            Sight::Apart => Ok(()),
            Sight::Unknown(_) if regime == Regime::Outward => Ok(()),
            Sight::Unknown(why) => Err(Breach {
                reason: "OTHER_ARM_UNKNOWN",
                detail: format!("nobody knows where the other arm is: {why}"),
            }),
            Sight::Seen { age_s, .. }
                if regime != Regime::Outward && !(0.0..=stale_s).contains(age_s) =>
            {
                Err(breach(
                    "OTHER_ARM_UNKNOWN",
                    "age of the other arm's last state",
                    *age_s,
                    stale_s,
                    "s",
                ))
            }
            Sight::Seen { nearest, .. } => match self.keep.missed(nearest) {
                Some((distance, limit_mm)) => {
                    let [own, others] = distance.bodies.map(|body| body.as_str());
                    let what = format!("room between the {own} and the other arm's {others}");
                    Err(breach("ARMS_TOO_NEAR", &what, distance.mm, limit_mm, "mm"))
                }
                None => Ok(()),
            },
        }
    }
}
