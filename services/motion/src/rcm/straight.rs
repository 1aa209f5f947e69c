//! The controller's own straight line (MoveL): the tip moves along a line while the tool turns about one
//! fixed axis. Between two poses whose shafts pass the portal it leaves the portal whenever it turns
//! and inserts at once.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid};

use super::Placement;

/// A straight line, over s = 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Straight {
    /// At s = 0.
    pub from: Rigid<Base, Tool>,
    /// At s = 1.
    pub to: Rigid<Base, Tool>,
}

impl Straight {
    /// The pose at `s`.
    pub fn pose(&self, s: f64) -> Rigid<Base, Tool> {
        let (from, to) = (self.from.isometry().rotation, self.to.isometry().rotation);
        let between = (from.inverse() * to).scaled_axis() * s;
        Rigid::new(
            from * arthro_geometry::Rotation::from_scaled_axis(between),
            self.from
                .translation_mm()
                .lerp(&self.to.translation_mm(), s),
        )
    }

    /// Of the tip's way, mm.
    pub fn length_mm(&self) -> f64 {
        (self.to.origin() - self.from.origin()).norm()
    }

    /// The whole turn, rad.
    pub fn turn_rad(&self) -> f64 {
        let (from, to) = (self.from.rotation(), self.to.rotation());
        from.angle_to(&to)
    }

    /// Largest distance of the shaft to the portal at `steps` + 1 places along it, mm.
    pub fn deviation_mm(&self, portal: &Point3, steps: u32) -> f64 {
        (0..=steps)
            .map(|step| self.pose(f64::from(step) / f64::from(steps.max(1))))
            .map(|pose| Placement::of(&pose, portal).deviation_mm())
            .fold(0.0, f64::max)
    }
}
