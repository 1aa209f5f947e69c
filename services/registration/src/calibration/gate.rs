//! What a calibration must show before it is handed out. A small residual alone is no evidence: it does not fall with
//! the number of poses, the true error does. So poses, span and uncertainty are gated too.

use std::fmt;

use super::span::Span;
use crate::error::Error;

/// Fewest poses, given and after the rejection of outliers.
pub const MIN_POSES: usize = 10;
/// Most poses.
pub const MAX_POSES: usize = 500;
/// Least turn between the two poses that differ most, degrees.
pub const MIN_SPAN_DEG: f64 = 30.0;
/// Least part of a turn across the main axis, degrees: turns about one axis leave the offset along it free.
pub const MIN_ACROSS_DEG: f64 = 15.0;
/// Largest share of poses that may be rejected.
pub const MAX_OUTLIER_SHARE: f64 = 0.3;

/// A gate that was not passed.
#[derive(Clone, Debug, PartialEq)]
pub struct Refusal {
    /// Which.
    pub reason: Reason,
    /// What was found.
    pub value: f64,
    /// What would have passed.
    pub limit: f64,
    /// Both, for a person.
    pub detail: String,
}

/// The gates by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// Fewer poses than [`MIN_POSES`], given or left.
    TooFewPoses,
    /// The poses turn less than [`MIN_SPAN_DEG`].
    SpanTooSmall,
    /// All turns share nearly one axis.
    AxesParallel,
    /// More than [`MAX_OUTLIER_SHARE`] of the poses contradict the rest.
    TooManyOutliers,
    /// The poses contradict each other.
    ResidualTooLarge,
    /// The poses agree but do not determine the answer well enough.
    UncertaintyTooLarge,
    /// The poses leave part of the answer free.
    Undetermined,
    /// Two points of a shaft that are too near to each other.
    BaselineTooShort,
}

impl Reason {
    /// The stable word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::TooFewPoses => "TOO_FEW_POSES",
            Self::SpanTooSmall => "SPAN_TOO_SMALL",
            Self::AxesParallel => "AXES_PARALLEL",
            Self::TooManyOutliers => "TOO_MANY_OUTLIERS",
            Self::ResidualTooLarge => "RESIDUAL_TOO_LARGE",
            Self::UncertaintyTooLarge => "UNCERTAINTY_TOO_LARGE",
            Self::Undetermined => "UNDETERMINED",
            Self::BaselineTooShort => "BASELINE_TOO_SHORT",
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: {}", self.reason.as_str(), self.detail)
    }
}

/// The poses turn, and still no start or no covariance follows from them.
pub(super) fn undetermined(count: usize) -> Error {
    Error::Refused(vec![Refusal {
        reason: Reason::Undetermined,
        value: count as f64,
        limit: MIN_POSES as f64,
        detail: format!("the {count} poses leave part of the answer free"),
    }])
}

/// The refusals so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Gates(Vec<Refusal>);

impl Gates {
    /// Passes when `value` is at least `limit`.
    pub fn at_least(&mut self, reason: Reason, value: f64, limit: f64, what: impl fmt::Display) {
        if value < limit {
            let detail = format!("{what}, must be at least {limit}");
            self.refuse(reason, value, limit, detail);
        }
    }

    /// Passes when `value` is at most `limit`; not a number does not.
    pub fn at_most(&mut self, reason: Reason, value: f64, limit: f64, what: impl fmt::Display) {
        if value.is_nan() || value > limit {
            let detail = format!("{what}, must be at most {limit}");
            self.refuse(reason, value, limit, detail);
        }
    }

    /// Enough poses, `whose` says which.
    pub fn poses(&mut self, count: usize, whose: &str) {
        let what = format!("{count} poses {whose}");
        self.at_least(Reason::TooFewPoses, count as f64, MIN_POSES as f64, what);
    }

    /// They turn far enough.
    pub fn span(&mut self, span: &Span, whose: &str) {
        let widest_deg = span.widest_rad.to_degrees();
        let what = format!("the poses {whose} span {widest_deg:.1} degrees");
        self.at_least(Reason::SpanTooSmall, widest_deg, MIN_SPAN_DEG, what);
    }

    /// They turn about more than one axis.
    pub fn axes(&mut self, span: &Span, whose: &str) {
        let across_deg = span.across_rad.to_degrees();
        let what = format!("the poses {whose} turn {across_deg:.1} degrees across their main axis");
        self.at_least(Reason::AxesParallel, across_deg, MIN_ACROSS_DEG, what);
    }

    /// Not too many poses contradict the rest.
    pub fn outliers(&mut self, rejected: &[usize], count: usize) {
        let share = rejected.len() as f64 / count as f64;
        let named: Vec<String> = rejected
            .iter()
            .map(|index| format!("poses[{index}]"))
            .collect();
        let what = format!(
            "{:.0} % of the poses contradict the rest ({})",
            100.0 * share,
            named.join(", ")
        );
        self.at_most(Reason::TooManyOutliers, share, MAX_OUTLIER_SHARE, what);
    }

    /// Whether all were passed.
    pub fn passed(self) -> Result<(), Error> {
        if self.0.is_empty() {
            Ok(())
        } else {
            Err(Error::Refused(self.0))
        }
    }

    fn refuse(&mut self, reason: Reason, value: f64, limit: f64, detail: String) {
        self.0.push(Refusal {
            reason,
            value,
            limit,
            detail,
        });
    }
}
