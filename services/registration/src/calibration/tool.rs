//! The whole tool: its tip by pivoting and, if poses for it are given, its shaft.

use std::f64::consts::FRAC_PI_2;

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::{Rigid, Rotation, Vector3};

use super::shaft_axis::{self, ShaftAxis, spin};
use super::tool_tip::{self, ToolTip};
use crate::error::Error;

/// How the shaft's line is measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ShaftPoses {
    /// It is not.
    #[default]
    None,
    /// Poses that turn about the shaft in a bushing.
    Spin(Vec<Rigid<Base, Flange>>),
    /// Poses that turn about a second point of the shaft.
    Higher(Vec<Rigid<Base, Flange>>),
}

/// What is known beforehand and what is demanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Of the tip.
    pub tip: tool_tip::Options,
    /// The tool as drawn: gives the roll about the shaft and which end of it is the tip's.
    pub drawn: Rigid<Flange, Tool>,
    /// Largest expected error of the shaft's direction, rad.
    pub direction_limit_rad: f64,
}

impl Default for Options {
    /// The shaft along the flange's z.
    fn default() -> Self {
        Self {
            tip: tool_tip::Options::default(),
            drawn: Rigid::new(
                Rotation::from_scaled_axis(-Vector3::y() * FRAC_PI_2),
                Vector3::zeros(),
            ),
            direction_limit_rad: spin::Options::default().uncertainty_limit_rad,
        }
    }
}

/// Tip and shaft.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The tip.
    pub tip: ToolTip,
    /// The shaft, if poses for it were given.
    pub shaft: Option<Shaft>,
}

/// The shaft and what follows from it.
#[derive(Clone, Debug, PartialEq)]
pub struct Shaft {
    /// Its line.
    pub axis: ShaftAxis,
    /// Distance of the tip to the line, mm.
    pub tip_off_line_mm: f64,
    /// Tip and shaft together.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// One a pose of a spin; empty after a second pivot.
    pub residuals: Vec<spin::Residual>,
}

/// The tool, from poses base_from_flange.
///
/// # Errors
/// Names every violation of the input, or every gate that was not passed, of the first measurement that has one.
pub fn solve(
    poses: &[Rigid<Base, Flange>],
    shaft: &ShaftPoses,
    options: &Options,
) -> Result<Calibrated, Error> {
    let tip = tool_tip::solve(poses, &options.tip)?;
    let (axis, residuals) = match shaft {
        ShaftPoses::None => return Ok(Calibrated { tip, shaft: None }),
        ShaftPoses::Spin(poses) => {
            let spin_options = spin::Options {
                towards_tip: options.drawn.direction(&Vector3::x()),
                arm_noise: options.tip.arm_noise,
                uncertainty_limit_rad: options.direction_limit_rad,
                ..spin::Options::default()
            };
            let spin = spin::solve(poses, &spin_options).map_err(|error| error.of("spin_poses"))?;
            (spin.axis, spin.residuals)
        }
        ShaftPoses::Higher(poses) => {
            let higher =
                tool_tip::solve(poses, &options.tip).map_err(|error| error.of("higher_poses"))?;
            let axis = shaft_axis::of_two_pivots(&tip, &higher, options.direction_limit_rad)
                .map_err(|error| error.of("higher_poses"))?;
            (axis, Vec::new())
        }
    };
    let flange_from_tool = axis
        .flange_from_tool(&tip.tip_in_flange, &options.drawn)
        .ok_or_else(|| {
            Error::invalid(
                "drawn_flange_from_tool",
                "has the shaft the other way round",
            )
        })?;
    let shaft = Shaft {
        axis,
        tip_off_line_mm: axis.distance_mm(&tip.tip_in_flange),
        flange_from_tool,
        residuals,
    };
    Ok(Calibrated {
        tip,
        shaft: Some(shaft),
    })
}

impl Error {
    /// The same error, of the poses in another field.
    fn of(mut self, field: &str) -> Self {
        match &mut self {
            Self::Invalid(violations) => {
                for violation in violations {
                    if let Some(rest) = violation.field.strip_prefix("poses") {
                        violation.field = format!("{field}{rest}");
                    }
                }
            }
            Self::Refused(refusals) => {
                for refusal in refusals {
                    refusal.detail = format!("{field}: {}", refusal.detail);
                }
            }
            Self::NothingFound | Self::Cancelled => {}
        }
        self
    }

    fn invalid(field: &str, description: &str) -> Self {
        Self::Invalid(vec![crate::error::Violation::new(field, description)])
    }
}
