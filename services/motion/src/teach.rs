//! Portals and shafts from poses of an arm that somebody leads: least squares with covariance, and a
//! refusal that says what is missing when the poses do not carry an answer.
//!
//! Every pose says how far a shaft's line is from a point, in the two directions across the line. Noise is
//! a standard deviation of each of the two, stated or estimated from the residuals; covariances grow by
//! the residuals over a stated noise that is too small, as those of the registration service do.

mod least_squares;
pub mod portal;
pub mod shaft;

use arthro_geometry::nalgebra::Matrix3;

/// Why poses do not carry an answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Lines that are so near to parallel that they do not meet anywhere.
    #[error("the lines differ by at most {spread_rad:.3} rad; must differ by {limit_rad:.3} rad")]
    LinesParallel {
        /// Largest angle between two of them.
        spread_rad: f64,
        /// Least angle.
        limit_rad: f64,
    },
    /// Poses that leave an unknown open.
    #[error(
        "the poses leave {unknown} open: it shows in them by {share:.4} of itself; must by {limit}; {remedy}"
    )]
    Undetermined {
        /// Which.
        unknown: &'static str,
        /// Root mean square change of the residuals by its change.
        share: f64,
        /// Least.
        limit: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// A pose that contradicts the rest.
    #[error(
        "poses[{pose}] contradicts the rest: its line is {distance_mm:.2} mm from the point that the others agree on, {deviations:.1} standard deviations; limit {limit:.1}"
    )]
    Outlier {
        /// Its index.
        pose: usize,
        /// Of its line to the answer without it.
        distance_mm: f64,
        /// The same by the noise of the others.
        deviations: f64,
        /// What noise exceeds once in a thousand.
        limit: f64,
    },
    /// Lines that do not agree.
    #[error("the lines are {rms_mm:.2} mm root mean square from the point; limit {limit_mm} mm")]
    ResidualTooLarge {
        /// Root mean square distance.
        rms_mm: f64,
        /// Limit.
        limit_mm: f64,
    },
    /// An answer that is too uncertain.
    #[error("the expected error of {of} is {value:.4} {unit}; limit {limit} {unit}")]
    UncertaintyTooLarge {
        /// Of what.
        of: &'static str,
        /// Expected error.
        value: f64,
        /// Limit.
        limit: f64,
        /// Of both.
        unit: &'static str,
    },
}

/// How one pose agrees with the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Of its line to the point, mm.
    pub distance_mm: f64,
    /// The same in standard deviations of the noise.
    pub deviations: f64,
    /// Of the tip beyond the point along the shaft, mm.
    pub depth_mm: f64,
}

/// What is known beforehand and what is demanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demands {
    /// Standard deviation of a line's place, each axis across it, mm; `None`: estimated.
    pub line_noise_mm: Option<f64>,
    /// Largest root mean square distance of the lines to the point, mm.
    pub residual_limit_mm: f64,
    /// Largest expected error of the answer: mm of a portal, rad of a shaft's direction.
    pub uncertainty_limit: f64,
}

impl Refusal {
    /// The stable word for programs.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::LinesParallel { .. } => "LINES_PARALLEL",
            Self::Undetermined { .. } => "UNDETERMINED",
            Self::Outlier { .. } => "POSE_CONTRADICTS",
            Self::ResidualTooLarge { .. } => "RESIDUAL_TOO_LARGE",
            Self::UncertaintyTooLarge { .. } => "UNCERTAINTY_TOO_LARGE",
        }
    }

    /// Its numbers by name.
    pub fn metadata(&self) -> Vec<(&'static str, String)> {
        let numbers = |value: f64, limit: f64| {
            vec![("value", value.to_string()), ("limit", limit.to_string())]
        };
        match self {
            Self::LinesParallel {
                spread_rad,
                limit_rad,
            } => numbers(*spread_rad, *limit_rad),
            Self::Undetermined { share, limit, .. } => numbers(*share, *limit),
            Self::Outlier {
                pose,
                deviations,
                limit,
                ..
            } => {
                let mut all = numbers(*deviations, *limit);
                all.push(("pose", pose.to_string()));
                all
            }
            Self::ResidualTooLarge { rms_mm, limit_mm } => numbers(*rms_mm, *limit_mm),
            Self::UncertaintyTooLarge { value, limit, .. } => numbers(*value, *limit),
        }
    }
}

/// Root of the summed variances: the expected distance from the truth, root mean square.
pub fn deviation(covariance: &Matrix3<f64>) -> f64 {
    covariance.trace().max(0.0).sqrt()
}

#[cfg(test)]
mod tests;
