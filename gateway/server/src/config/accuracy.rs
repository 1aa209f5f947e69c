//! The sections that say how accurate is accurate enough: `gateway.verification`, `gateway.calibrations` and
//! `gateway.error_budget`; and how a covariance is read.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::ConfigError;
use crate::verification::Limits;

/// Section `gateway.verification`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Verification {
    /// Largest target registration error over the touched landmarks, root mean square, mm.
    pub limit_mm: f64,
    /// Whether approval asks for a passed verification.
    pub required: bool,
    /// Fewest landmarks.
    pub touches_min: usize,
}

/// Section `gateway.calibrations`: how long a saved calibration holds when whoever saves it says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Validity {
    /// Of the camera on its stand, days.
    pub hand_eye_days: f64,
    /// Of the tip of an instrument that is taken off for cleaning, days.
    pub tool_tip_days: f64,
}

/// Section `gateway.error_budget`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ErrorBudget {
    /// How far the tip is from where the arm says it is, root mean square, mm: its kinematics' accuracy, not its
    /// repeatability.
    pub arm_accuracy_mm: f64,
    /// Bites that are expected to be farther off are flagged, mm.
    pub bite_limit_mm: f64,
}

impl Default for Verification {
    fn default() -> Self {
        Self {
            limit_mm: 1.5,
            required: false,
            touches_min: 3,
        }
    }
}

impl From<Verification> for Limits {
    fn from(section: Verification) -> Self {
        Self {
            limit_mm: section.limit_mm,
            touches_min: section.touches_min,
            required: section.required,
        }
    }
}

impl Default for Validity {
    fn default() -> Self {
        Self {
            hand_eye_days: 90.0,
            tool_tip_days: 7.0,
        }
    }
}

impl Default for ErrorBudget {
    fn default() -> Self {
        Self {
            arm_accuracy_mm: 0.5,
            bite_limit_mm: 1.5,
        }
    }
}

pub(super) fn covariance<const N: usize>(
    field: &'static str,
    rows: Option<&[f64]>,
) -> Result<Option<SMatrix<f64, N, N>>, ConfigError> {
    let Some(rows) = rows else {
        return Ok(None);
    };
    let checked = checked_covariance(rows);
    checked
        .map(Some)
        .map_err(|problem| ConfigError { field, problem })
}

/// A covariance row by row; the error says what is wrong with it.
pub(crate) fn checked_covariance<const N: usize>(
    rows: &[f64],
) -> Result<SMatrix<f64, N, N>, String> {
    if rows.len() != N * N {
        return Err(format!("holds {} numbers; must hold {}", rows.len(), N * N));
    }
    let matrix = SMatrix::<f64, N, N>::from_row_slice(rows);
    if let Some(number) = rows.iter().find(|number| !number.is_finite()) {
        return Err(format!("holds {number}; must hold finite numbers"));
    }
    for row in 0..N {
        let variance = matrix[(row, row)];
        if variance < 0.0 {
            return Err(format!(
                "has the variance {variance} in row {row}; must be 0 or more"
            ));
        }
        for column in 0..row {
            let (one, other) = (matrix[(row, column)], matrix[(column, row)]);
            let largest = (variance * matrix[(column, column)]).sqrt();
            // What rounds on the way here, against what no two quantities can share.
            if (one - other).abs() > 1e-6 * largest {
                return Err(format!(
                    "is not symmetric: {one} and {other} in row and column {row} and {column}"
                ));
            }
            if one.abs() > largest * (1.0 + 1e-6) {
                return Err(format!(
                    "has the covariance {one} in row {row}, column {column}; must be at most {largest}"
                ));
            }
        }
    }
    Ok(matrix)
}
