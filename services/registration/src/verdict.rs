//! Whether the evidence supports a pose: Eq. 15 alone does not tell a right pose from a turned one.

use crate::scaled_icp::ScaleRange;

/// What speaks for and against a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Scale of camera_from_ct.
    pub scale: f64,
    /// The scales that were allowed.
    pub scale_range: ScaleRange,
    /// Root mean square distance to the model's surface of the nearest nine tenths of the view, mm.
    pub trimmed_rms_mm: f64,
    /// Share of view points near the model, 0..1.
    pub inlier_share: f64,
    /// Share of the model's surface that the view covers, 0..1.
    pub overlap: f64,
    /// Share of model points that would have hidden what was seen, 0..1.
    pub violation_share: f64,
    /// Score margin to the best clearly different pose, 0..1.
    pub rival_margin: f64,
}

/// The judgement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// The evidence supports the pose.
    Accept,
    /// A person must look before it is used.
    Review,
    /// Not to be used.
    Reject,
}

/// Limits of one figure: beyond the first a person must look, beyond the second the pose is refused.
struct Limits {
    reason: &'static str,
    review: f64,
    reject: f64,
}

const RESIDUAL: Limits = Limits {
    reason: "RESIDUAL_TOO_LARGE",
    review: 0.6,
    reject: 1.2,
};
const INLIERS: Limits = Limits {
    reason: "TOO_FEW_INLIERS",
    review: 0.85,
    reject: 0.6,
};
const OVERLAP: Limits = Limits {
    reason: "OVERLAP_TOO_SMALL",
    review: 0.25,
    reject: 0.1,
};
const FREE_SPACE: Limits = Limits {
    reason: "FREE_SPACE_VIOLATED",
    review: 0.03,
    reject: 0.15,
};
const RIVAL: Limits = Limits {
    reason: "RIVAL_TOO_CLOSE",
    review: 0.25,
    reject: 0.03,
};

/// The verdict, and why it is not ACCEPT: stable words with value and limit.
pub fn judge(evidence: &Evidence) -> (Verdict, Vec<String>) {
    let mut verdict = Verdict::Accept;
    let mut reasons = Vec::new();
    let mut no_more_than = |value: f64, limits: Limits| {
        let (found, limit) = match value {
            _ if value > limits.reject => (Verdict::Reject, limits.reject),
            _ if value > limits.review => (Verdict::Review, limits.review),
            _ => return,
        };
        verdict = verdict.max(found);
        reasons.push(format!("{}: {value:.3}, limit {limit}", limits.reason));
    };
    no_more_than(evidence.trimmed_rms_mm, RESIDUAL);
    no_more_than(evidence.violation_share, FREE_SPACE);
    let mut no_less_than = |value: f64, limits: Limits| {
        let (found, limit) = match value {
            _ if value < limits.reject => (Verdict::Reject, limits.reject),
            _ if value < limits.review => (Verdict::Review, limits.review),
            _ => return,
        };
        verdict = verdict.max(found);
        reasons.push(format!("{}: {value:.3}, limit {limit}", limits.reason));
    };
    no_less_than(evidence.inlier_share, INLIERS);
    no_less_than(evidence.overlap, OVERLAP);
    no_less_than(evidence.rival_margin, RIVAL);

    let ScaleRange { low, high } = evidence.scale_range;
    // The clamp held: the data ask for a scale that the sensors exclude.
    if high > low && !(evidence.scale > low && evidence.scale < high) {
        verdict = verdict.max(Verdict::Review);
        reasons.push(format!(
            "SCALE_AT_LIMIT: {:.4}, allowed {low:.4} to {high:.4}",
            evidence.scale
        ));
    }
    (verdict, reasons)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Evidence = Evidence {
        scale: 1.001,
        scale_range: ScaleRange {
            low: 0.98,
            high: 1.02,
        },
        trimmed_rms_mm: 0.2,
        inlier_share: 0.97,
        overlap: 0.5,
        violation_share: 0.0,
        rival_margin: 0.6,
    };

    #[test]
    fn good_evidence_is_accepted_without_reasons() {
        assert_eq!(judge(&GOOD), (Verdict::Accept, vec![]));
    }

    #[test]
    fn each_weak_figure_asks_for_review_and_each_bad_one_refuses() {
        let weak = [
            Evidence {
                trimmed_rms_mm: 0.7,
                ..GOOD
            },
            Evidence {
                inlier_share: 0.7,
                ..GOOD
            },
            Evidence {
                overlap: 0.2,
                ..GOOD
            },
            Evidence {
                violation_share: 0.1,
                ..GOOD
            },
            Evidence {
                rival_margin: 0.1,
                ..GOOD
            },
            Evidence {
                scale: 1.02,
                ..GOOD
            },
        ];
        let bad = [
            Evidence {
                trimmed_rms_mm: 2.0,
                ..GOOD
            },
            Evidence {
                inlier_share: 0.3,
                ..GOOD
            },
            Evidence {
                overlap: 0.05,
                ..GOOD
            },
            Evidence {
                violation_share: 0.4,
                ..GOOD
            },
            Evidence {
                rival_margin: 0.0,
                ..GOOD
            },
        ];
        for (cases, expected) in [(&weak[..], Verdict::Review), (&bad[..], Verdict::Reject)] {
            for evidence in cases {
                let (verdict, reasons) = judge(evidence);
                assert_eq!(
                    (verdict, reasons.len()),
                    (expected, 1),
                    "{evidence:?} {reasons:?}"
                );
            }
        }
    }
}
