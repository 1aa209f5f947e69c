//! The line of the shaft in the flange. A direction that is off by 0.25 degrees puts the shaft 1 mm beside a portal
//! 240 mm away, so it is calibrated and not taken from the drawing.
//!
//! Either the shaft lies in a bushing and the arm turns about it ([`spin`]), or two points of it are pivoted about,
//! the tip and one higher up ([`of_two_pivots`]).

pub mod spin;

use arthro_geometry::frame::{Flange, Tool};
use arthro_geometry::nalgebra::{Matrix3, Unit};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::gate::{Gates, Reason};
use super::noise;
use super::tool_tip::ToolTip;
use crate::error::Error;

/// Least distance between two points that a direction is taken from, mm.
pub const MIN_BASELINE_MM: f64 = 50.0;

/// A line in the flange.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftAxis {
    /// Along the shaft, out of the tip.
    pub direction_in_flange: Unit<Vector3>,
    /// Covariance of the direction, rad2; nothing along it.
    pub direction_covariance_rad2: Matrix3<f64>,
    /// The point of the line nearest to the flange's origin, mm.
    pub point_in_flange: Point3,
    /// Covariance of that point across the line, mm2.
    pub point_covariance_mm2: Matrix3<f64>,
}

impl ShaftAxis {
    /// Expected error of the direction, root mean square, rad.
    pub fn direction_deviation_rad(&self) -> f64 {
        noise::deviation(&self.direction_covariance_rad2)
    }

    /// Expected error of the line at its point nearest to the flange, root mean square, mm.
    pub fn point_deviation_mm(&self) -> f64 {
        noise::deviation(&self.point_covariance_mm2)
    }

    /// Distance of a point to the line, mm.
    pub fn distance_mm(&self, point_in_flange: &Point3) -> f64 {
        (point_in_flange - self.point_in_flange)
            .cross(&self.direction_in_flange)
            .norm()
    }

    /// The tool with this shaft and tip: x along the shaft, the roll about it as near to the drawing's as it can be.
    /// `None` when the drawing has the shaft the other way round.
    pub fn flange_from_tool(
        &self,
        tip_in_flange: &Point3,
        drawn: &Rigid<Flange, Tool>,
    ) -> Option<Rigid<Flange, Tool>> {
        let along = drawn.direction(&Vector3::x());
        let turned = Rotation::rotation_between(&along, &self.direction_in_flange)?;
        Some(Rigid::new(turned * drawn.rotation(), tip_in_flange.coords))
    }
}

/// The line through the tip and a second point of the shaft, both found by pivoting.
///
/// # Errors
/// When the points are too near to each other or too uncertain for `uncertainty_limit_rad`.
pub fn of_two_pivots(
    tip: &ToolTip,
    higher: &ToolTip,
    uncertainty_limit_rad: f64,
) -> Result<ShaftAxis, Error> {
    let along = tip.tip_in_flange - higher.tip_in_flange;
    let baseline_mm = along.norm();
    let mut gates = Gates::default();
    gates.at_least(
        Reason::BaselineTooShort,
        baseline_mm,
        MIN_BASELINE_MM,
        format!("the two points of the shaft are {baseline_mm:.1} mm apart"),
    );
    gates.passed()?;

    let direction = Unit::new_normalize(along);
    let across = Matrix3::identity() - direction.into_inner() * direction.transpose();
    let (first, second) = (tip.tip_covariance_mm2, higher.tip_covariance_mm2);
    let back_mm = tip.tip_in_flange.coords.dot(&direction);
    let share = back_mm / baseline_mm;
    let point = first * (1.0 - share).powi(2) + second * share.powi(2);
    let axis = ShaftAxis {
        direction_in_flange: direction,
        direction_covariance_rad2: across * (first + second) * across / baseline_mm.powi(2),
        point_in_flange: tip.tip_in_flange - direction.into_inner() * back_mm,
        point_covariance_mm2: across * point * across,
    };
    let mut gates = Gates::default();
    gates.direction(axis.direction_deviation_rad(), uncertainty_limit_rad);
    gates.passed()?;
    Ok(axis)
}

impl Gates {
    pub(super) fn direction(&mut self, deviation_rad: f64, limit_rad: f64) {
        let deg = deviation_rad.to_degrees();
        self.at_most(
            Reason::UncertaintyTooLarge,
            deg,
            limit_rad.to_degrees(),
            format!("the expected error of the shaft's direction is {deg:.3} degrees"),
        );
    }
}
