//! Whether the evidence supports a pose: Eq. 15 alone does not tell a right pose from a turned one.

use crate::evidence::Evidence;

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

/// One figure held to two limits: beyond the first a person must look, beyond the second the pose is refused.
struct Rule {
    reason: &'static str,
    figure: fn(&Evidence) -> f64,
    review: f64,
    reject: f64,
    side: Side,
}

/// On which side of its limits a figure must be.
enum Side {
    Below,
    Above,
}

/// Limits as seen on some thousand rendered views of menisci, whole and cut, right ones, wrong ones and mirrored ones.
const RULES: [Rule; 7] = [
    Rule {
        reason: "RESIDUAL_TOO_LARGE",
        figure: |evidence| evidence.misfit,
        review: 1.8,
        reject: 3.5,
        side: Side::Below,
    },
    Rule {
        reason: "TOO_FEW_INLIERS",
        figure: |evidence| evidence.inlier_share,
        review: 0.8,
        reject: 0.6,
        side: Side::Above,
    },
    Rule {
        reason: "OVERLAP_TOO_SMALL",
        figure: |evidence| evidence.overlap,
        review: 0.2,
        reject: 0.08,
        side: Side::Above,
    },
    Rule {
        reason: "FREE_SPACE_VIOLATED",
        figure: |evidence| evidence.violation_share,
        review: 0.02,
        reject: 0.1,
        side: Side::Below,
    },
    Rule {
        reason: "RIVAL_TOO_CLOSE",
        figure: |evidence| evidence.ambiguity,
        review: 0.85,
        reject: 0.98,
        side: Side::Below,
    },
    Rule {
        reason: "MIRROR_FITS",
        figure: |evidence| evidence.mirror,
        review: 0.85,
        reject: 1.05,
        side: Side::Below,
    },
    Rule {
        reason: "TARGET_ERROR_TOO_LARGE",
        figure: |evidence| evidence.tre_predicted_mm / evidence.unit_mm,
        review: 0.35,
        reject: 3.0,
        side: Side::Below,
    },
];

/// The verdict, and why it is not ACCEPT: stable words with value and limit.
pub fn judge(evidence: &Evidence) -> (Verdict, Vec<String>) {
    let mut verdict = Verdict::Accept;
    let mut reasons = Vec::new();
    for rule in &RULES {
        let value = (rule.figure)(evidence);
        // A figure that is no number supports nothing.
        let misses = |limit: f64| match rule.side {
            Side::Below => value.is_nan() || value > limit,
            Side::Above => value.is_nan() || value < limit,
        };
        let (found, limit) = if misses(rule.reject) {
            (Verdict::Reject, rule.reject)
        } else if misses(rule.review) {
            (Verdict::Review, rule.review)
        } else {
            continue;
        };
        verdict = verdict.max(found);
        reasons.push(format!("{}: {value:.3}, limit {limit}", rule.reason));
    }
    let (low, high) = (evidence.allowed.low, evidence.allowed.high);
    // The clamp held: the data ask for a scale that the sensors exclude.
    if high > low && !(evidence.scale > low * (1.0 + 1e-9) && evidence.scale < high * (1.0 - 1e-9))
    {
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
    use crate::scale::ScaleRange;

    const GOOD: Evidence = Evidence {
        scale: 1.001,
        scale_deviation: 0.002,
        allowed: ScaleRange {
            low: 0.98,
            high: 1.02,
        },
        misfit: 0.9,
        inlier_share: 0.97,
        overlap: 0.5,
        violation_share: 0.0,
        ambiguity: 0.4,
        mirror: 0.5,
        tre_predicted_mm: 0.1,
        unit_mm: 0.9,
    };

    #[test]
    fn good_evidence_is_accepted_without_reasons() {
        assert_eq!(judge(&GOOD), (Verdict::Accept, vec![]));
    }

    #[test]
    fn each_weak_figure_asks_for_review_and_each_bad_one_refuses() {
        let weak = [
            Evidence {
                misfit: 2.0,
                ..GOOD
            },
            Evidence {
                inlier_share: 0.7,
                ..GOOD
            },
            Evidence {
                overlap: 0.15,
                ..GOOD
            },
            Evidence {
                violation_share: 0.05,
                ..GOOD
            },
            Evidence {
                ambiguity: 0.9,
                ..GOOD
            },
            Evidence {
                mirror: 0.9,
                ..GOOD
            },
            Evidence {
                tre_predicted_mm: 0.5,
                ..GOOD
            },
            Evidence {
                scale: 1.02,
                ..GOOD
            },
        ];
        let bad = [
            Evidence {
                misfit: 4.0,
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
                ambiguity: 1.0,
                ..GOOD
            },
            Evidence {
                mirror: 1.4,
                ..GOOD
            },
            Evidence {
                tre_predicted_mm: f64::INFINITY,
                ..GOOD
            },
            Evidence {
                misfit: f64::NAN,
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
