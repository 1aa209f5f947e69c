//! `movec`: a circular arc of the tool through three points.

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};

use super::{between, profile};
use crate::ur5::profile::Trapezoid;

/// Shortest triangle side and smallest sine of its angle of which a circle is made, m and 1.
const DEGENERATE: f64 = 1e-9;

/// What the orientation of the tool does on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// Mode 0: from that of the start to that of the goal.
    Interpolated,
    /// Mode 1: fixed to the tangent of the arc.
    Tangential,
}

/// An arc under way.
#[derive(Clone, Debug)]
pub struct Arc {
    from: Isometry3<f64>,
    to: Isometry3<f64>,
    centre_m: Vector3<f64>,
    axis: Unit<Vector3<f64>>,
    angle_rad: f64,
    orientation: Orientation,
    profile: Trapezoid,
    length_m: f64,
    at_s: f64,
}

impl Arc {
    /// From one pose through another to a third.
    ///
    /// # Errors
    /// Three points that lie on a line.
    pub fn through(
        from: Isometry3<f64>,
        via: &Isometry3<f64>,
        to: &Isometry3<f64>,
        orientation: Orientation,
        speed: f64,
        accel: f64,
    ) -> Result<Self, String> {
        let (a, b, c) = (
            from.translation.vector,
            via.translation.vector,
            to.translation.vector,
        );
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(&ac);
        let straight = DEGENERATE.max(DEGENERATE * ab.norm() * ac.norm());
        if normal.norm() <= straight * 1e-3 {
            return Err("start, via and goal lie on a line".to_owned());
        }
        // Circumcentre of a triangle with one corner in the origin.
        let centre_m = a
            + (ac.norm_squared() * normal.cross(&ab) - ab.norm_squared() * normal.cross(&ac))
                / (2.0 * normal.norm_squared());
        let axis = Unit::new_normalize(normal);
        let (first, last) = (a - centre_m, c - centre_m);
        let angle_rad = first
            .cross(&last)
            .dot(&axis)
            .atan2(first.dot(&last))
            .rem_euclid(std::f64::consts::TAU);
        let length_m = first.norm() * angle_rad;
        Ok(Self {
            from,
            to: *to,
            centre_m,
            axis,
            angle_rad,
            orientation,
            profile: profile(length_m, speed, accel, 0.0),
            length_m,
            at_s: 0.0,
        })
    }

    /// Goes on for so long; the pose then, and whether that is the goal.
    pub fn advance(&mut self, dt: f64) -> (Isometry3<f64>, bool) {
        self.at_s += dt;
        let reached = self.at_s >= self.profile.duration_s();
        let share = if reached {
            1.0
        } else {
            self.profile.at(self.at_s) / self.length_m
        };
        (self.pose(share), reached)
    }

    /// Where it ends.
    pub fn goal(&self) -> Isometry3<f64> {
        self.pose(1.0)
    }

    fn pose(&self, share: f64) -> Isometry3<f64> {
        let turned = UnitQuaternion::from_axis_angle(&self.axis, self.angle_rad * share);
        let arm = self.from.translation.vector - self.centre_m;
        let rotation = match self.orientation {
            Orientation::Interpolated => between(&self.from, &self.to, share).rotation,
            Orientation::Tangential => turned * self.from.rotation,
        };
        Isometry3::from_parts(Translation3::from(self.centre_m + turned * arm), rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arc_passes_through_its_three_points_and_keeps_its_radius() {
        let at = |x: f64, y: f64| Isometry3::translation(x, y, 0.3);
        let mut arc = Arc::through(
            at(0.5, 0.0),
            &at(0.4, 0.1),
            &at(0.3, 0.0),
            Orientation::Interpolated,
            0.1,
            0.5,
        )
        .unwrap();
        let (mut nearest, mut end) = (f64::MAX, (Isometry3::identity(), false));
        while !end.1 {
            end = arc.advance(0.002);
            let position = end.0.translation.vector;
            assert!(((position - Vector3::new(0.4, 0.0, 0.3)).norm() - 0.1).abs() < 1e-9);
            nearest = nearest.min((position - at(0.4, 0.1).translation.vector).norm());
        }
        assert!(nearest < 2e-4, "{nearest}");
        assert!((end.0.translation.vector - at(0.3, 0.0).translation.vector).norm() < 1e-9);
    }

    #[test]
    fn points_on_a_line_are_no_arc() {
        let at = |x: f64| Isometry3::translation(x, 0.1, 0.3);
        let refused = Arc::through(
            at(0.1),
            &at(0.2),
            &at(0.3),
            Orientation::Tangential,
            0.1,
            1.0,
        );
        assert!(refused.is_err());
    }
}
