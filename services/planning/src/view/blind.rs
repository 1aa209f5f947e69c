//! Why a bite cannot be seen, and what would show it.

/// Why there is no view plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Blind {
    /// A value of the scene or the optics that cannot be right.
    #[error("{field} {problem}")]
    Invalid {
        /// The value.
        field: &'static str,
        /// What is wrong, with the limit.
        problem: String,
    },
    /// No place for the arthroscope shows a bite.
    #[error("bite {bite} cannot be seen: {reason}")]
    Bite {
        /// Index of the bite.
        bite: usize,
        /// What kept the best place from showing it.
        reason: Reason,
    },
    /// The caller went away.
    #[error("the caller went away")]
    Cancelled,
}

/// What a place for the arthroscope's tip fails on, in the order of the tests.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Tissue everywhere in range of the bite.
    #[error(
        "all places {near_mm:.1} .. {far_mm:.1} mm from it lie in the tissue; a thinner shaft or a longer range of distances may find one"
    )]
    NoRoom {
        /// Nearest distance allowed, mm.
        near_mm: f64,
        /// Farthest distance allowed, mm.
        far_mm: f64,
    },
    /// The portal is too near or too far.
    #[error(
        "the tip would be {depth_mm:.1} mm from its portal, allowed are {low_mm:.1} .. {high_mm:.1} mm; a portal {} by {:.1} mm shows it",
        if depth_mm < low_mm { "farther" } else { "nearer" },
        self.excess()
    )]
    DepthRange {
        /// Insertion of the nearest place, mm.
        depth_mm: f64,
        /// Least insertion, mm.
        low_mm: f64,
        /// Greatest insertion, mm.
        high_mm: f64,
    },
    /// The view does not turn far enough.
    #[error(
        "the jaw reaches {:.1} deg from the optical axis, {:.1} deg are in view; a field of view wider by {:.1} deg, another range of roll or another portal shows it",
        angle_rad.to_degrees(), limit_rad.to_degrees(), 2.0 * self.excess().to_degrees()
    )]
    OutOfView {
        /// Angle between the optical axis and the farthest corner of the jaw.
        angle_rad: f64,
        /// Half the field of view less its margin.
        limit_rad: f64,
    },
    /// The forceps are in the way of the arthroscope.
    #[error(
        "{clearance_mm:.1} mm stay free between the shafts, the least is {limit_mm:.1} mm; shafts thinner by {:.1} mm in diameter together or portals farther apart show it",
        2.0 * self.excess()
    )]
    ShaftsTooClose {
        /// Between the surfaces of the shafts, mm; negative where they overlap.
        clearance_mm: f64,
        /// Least clearance, mm.
        limit_mm: f64,
    },
    /// The meniscus is in the way of the arthroscope.
    #[error(
        "{through_mm:.1} mm of the shaft would lie in the tissue, allowed are {limit_mm:.1} mm; a higher portal or one beside the meniscus shows it"
    )]
    ThroughTissue {
        /// Length in the tissue, mm.
        through_mm: f64,
        /// Greatest length, mm.
        limit_mm: f64,
    },
    /// A bone is in the way of the arthroscope.
    #[error(
        "{clearance_mm:.1} mm stay free between shaft and bone, the least is {limit_mm:.1} mm; a joint opened wider by {:.1} mm or another portal shows it",
        self.excess()
    )]
    ShaftHitsBone {
        /// Between the surfaces of shaft and bone, mm; negative where they overlap.
        clearance_mm: f64,
        /// Least clearance, mm.
        limit_mm: f64,
    },
    /// Tissue or forceps hide the jaw.
    #[error(
        "{percent:.0} % of the jaw are hidden, allowed are {limit_percent:.0} %; a higher portal or one on the other side of the forceps shows it"
    )]
    Occluded {
        /// Share hidden, percent.
        percent: f64,
        /// Greatest share, percent.
        limit_percent: f64,
    },
}

impl Reason {
    /// The stable word for it.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NoRoom { .. } => "NO_ROOM_FOR_TIP",
            Self::DepthRange { .. } => "DEPTH_RANGE",
            Self::OutOfView { .. } => "OUT_OF_VIEW",
            Self::ShaftsTooClose { .. } => "SHAFTS_TOO_CLOSE",
            Self::ThroughTissue { .. } => "SHAFT_THROUGH_TISSUE",
            Self::ShaftHitsBone { .. } => "SHAFT_HITS_BONE",
            Self::Occluded { .. } => "OCCLUDED",
        }
    }

    /// Its figures with their limits, by name.
    pub fn figures(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Self::NoRoom { near_mm, far_mm } => {
                vec![("distance_min_mm", near_mm), ("distance_max_mm", far_mm)]
            }
            Self::DepthRange {
                depth_mm,
                low_mm,
                high_mm,
            } => vec![
                ("depth_mm", depth_mm),
                ("depth_min_mm", low_mm),
                ("depth_max_mm", high_mm),
            ],
            Self::OutOfView {
                angle_rad,
                limit_rad,
            } => vec![("angle_rad", angle_rad), ("limit_rad", limit_rad)],
            Self::ShaftsTooClose {
                clearance_mm,
                limit_mm,
            }
            | Self::ShaftHitsBone {
                clearance_mm,
                limit_mm,
            } => vec![("clearance_mm", clearance_mm), ("limit_mm", limit_mm)],
            Self::ThroughTissue {
                through_mm,
                limit_mm,
            } => vec![("through_mm", through_mm), ("limit_mm", limit_mm)],
            Self::Occluded {
                percent,
                limit_percent,
            } => vec![("percent", percent), ("limit_percent", limit_percent)],
        }
    }

    /// The reason of the place that came closer to showing the bite: it failed a later test, or the
    /// same by less.
    pub(super) fn of_the_closer_place(self, other: Self) -> Self {
        match other.stage().cmp(&self.stage()) {
            std::cmp::Ordering::Greater => other,
            std::cmp::Ordering::Equal if other.excess() < self.excess() => other,
            _ => self,
        }
    }

    fn stage(&self) -> u8 {
        match self {
            Self::NoRoom { .. } => 0,
            Self::DepthRange { .. } => 1,
            Self::OutOfView { .. } => 2,
            Self::ShaftsTooClose { .. } => 3,
            Self::ThroughTissue { .. } => 4,
            Self::ShaftHitsBone { .. } => 5,
            Self::Occluded { .. } => 6,
        }
    }

    /// By how much the figure is beyond its limit, in its unit.
    fn excess(&self) -> f64 {
        match *self {
            Self::NoRoom { .. } => 0.0,
            Self::DepthRange {
                depth_mm,
                low_mm,
                high_mm,
            } => (low_mm - depth_mm).max(depth_mm - high_mm),
            Self::OutOfView {
                angle_rad,
                limit_rad,
            } => angle_rad - limit_rad,
            Self::ShaftsTooClose {
                clearance_mm,
                limit_mm,
            }
            | Self::ShaftHitsBone {
                clearance_mm,
                limit_mm,
            } => limit_mm - clearance_mm,
            Self::ThroughTissue {
                through_mm,
                limit_mm,
            } => through_mm - limit_mm,
            Self::Occluded {
                percent,
                limit_percent,
            } => percent - limit_percent,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_that_passed_more_tests_or_missed_by_less_is_the_closer_one() {
        let close = |clearance_mm| Reason::ShaftsTooClose {
            clearance_mm,
            limit_mm: 2.0,
        };
        let hidden = Reason::Occluded {
            percent: 90.0,
            limit_percent: 25.0,
        };
        assert_eq!(close(0.5).of_the_closer_place(close(1.5)), close(1.5));
        assert_eq!(close(1.5).of_the_closer_place(close(0.5)), close(1.5));
        assert_eq!(close(1.9).of_the_closer_place(hidden), hidden);
        assert_eq!(hidden.of_the_closer_place(close(1.9)), hidden);
    }

    #[test]
    fn a_refusal_tells_bite_figure_limit_and_remedy() {
        let blind = Blind::Bite {
            bite: 3,
            reason: Reason::ShaftsTooClose {
                clearance_mm: 0.75,
                limit_mm: 2.0,
            },
        };
        assert_eq!(
            blind.to_string(),
            "bite 3 cannot be seen: 0.8 mm stay free between the shafts, the least is 2.0 mm; shafts \
             thinner by 2.5 mm in diameter together or portals farther apart show it"
        );
    }
}
