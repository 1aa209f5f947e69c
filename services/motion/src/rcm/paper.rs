//! The paper's way to a target (Eq. 11 to 14), kept for comparison: the tip goes to the portal, the tool
//! turns there until the shaft points at the target, and then goes in along the shaft; both as
//! controller moves (MoveL).
//!
//! Eq. 12 takes `V = x1 x x2`, whose length is the sine of the angle, for the axis of Eq. 14, which is a
//! rotation for a unit axis only. [`Formula::AsPrinted`] keeps that; [`Formula::Corrected`] divides by
//! the length.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::straight::Straight;
use super::{Turn, shaft};

/// Which form of Eq. 12 to 14.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Formula {
    /// With the axis `V` as long as the sine of the angle.
    AsPrinted,
    /// With the axis made a unit vector.
    Corrected,
}

impl Formula {
    /// Eq. 12 to 14: the matrix that shall take the unit direction `x1` onto `x2`.
    pub fn matrix(self, x1: &Vector3, x2: &Vector3) -> Matrix3<f64> {
        let Turn { axis, angle_rad } = Turn::between(x1, x2);
        let axis = match self {
            Self::AsPrinted => x1.cross(x2),
            Self::Corrected => axis.into_inner(),
        };
        let (sine, cosine) = angle_rad.sin_cos();
        Matrix3::identity() * cosine
            + axis * axis.transpose() * (1.0 - cosine)
            + axis.cross_matrix() * sine
    }

    /// The paper's two moves from a tool whose tip is brought to the portal to the target `p2` of Eq. 11.
    /// `None` when the target is the portal.
    ///
    /// What is no rotation is made the nearest one.
    pub fn moves(
        self,
        base_from_tool: &Rigid<Base, Tool>,
        portal: &Point3,
        target: &Point3,
    ) -> Option<[Straight; 2]> {
        let x1 = shaft(base_from_tool);
        let x2 = (target - portal).try_normalize(1e-6)?;
        let turned = self.rotation(&x1, &x2)? * base_from_tool.rotation();
        let at_portal = Rigid::new(base_from_tool.rotation(), portal.coords);
        let aimed = Rigid::new(turned, portal.coords);
        let inserted = Rigid::new(turned, target.coords);
        Some([
            Straight {
                from: at_portal,
                to: aimed,
            },
            Straight {
                from: aimed,
                to: inserted,
            },
        ])
    }

    /// Across `V` the matrix of Eq. 14 is a turn about it, longer or shorter than one: the nearest rotation
    /// is the turn onto where it puts the shaft.
    fn rotation(self, x1: &Vector3, x2: &Vector3) -> Option<Rotation> {
        let led = (self.matrix(x1, x2) * x1).try_normalize(f64::EPSILON)?;
        Some(Turn::between(x1, &led).part(1.0))
    }
}

#[cfg(test)]
mod tests;
