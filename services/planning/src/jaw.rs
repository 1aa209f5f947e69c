//! The jaw of the forceps and what one bite cuts.
//!
//! A straight punch: it cuts the full thickness below a rectangle whose long axis lies along the
//! shaft, which points from the portal to the bite.

use arthro_geometry::frame::Frame;
use arthro_geometry::{Point3, Rigid, Vector3};

/// The cutting rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jaw {
    /// Across the shaft, mm.
    pub width_mm: f64,
    /// Along the shaft, mm. The tool's tip is the middle of the jaw.
    pub length_mm: f64,
}

/// One bite of the jaw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bite {
    /// Middle of the jaw, mm.
    pub center: Point3,
    /// Unit direction along the shaft, out of the tip.
    pub approach: Vector3,
    /// Unit direction in which the jaw opens, at right angles to `approach`.
    pub opening: Vector3,
    /// The point of the contour that the jaw's edge meets, mm.
    pub contour_point: Point3,
}

impl Bite {
    /// The bite at `center` with the shaft through `portal`, the jaw opening towards `superior` as
    /// far as the shaft lets it. `None` if the shaft comes straight from above.
    pub fn through(
        portal: &Point3,
        center: Point3,
        superior: &Vector3,
        contour_point: Point3,
    ) -> Option<Self> {
        let approach = (center - portal).try_normalize(1e-6)?;
        let opening = (superior - approach * superior.dot(&approach)).try_normalize(1e-3)?;
        Some(Self {
            center,
            approach,
            opening,
            contour_point,
        })
    }

    /// The same bite in another frame.
    pub fn carried<A: Frame, B: Frame>(&self, a_from_b: &Rigid<A, B>) -> Self {
        Self {
            center: *a_from_b * self.center,
            approach: a_from_b.direction(&self.approach),
            opening: a_from_b.direction(&self.opening),
            contour_point: *a_from_b * self.contour_point,
        }
    }

    /// The same bite moved.
    pub fn displaced(&self, by: &Vector3) -> Self {
        Self {
            center: self.center + by,
            ..*self
        }
    }

    /// What the bite cuts.
    pub fn cut(&self, jaw: &Jaw) -> Cut {
        Cut {
            center: self.center,
            along: self.approach,
            across: self.opening.cross(&self.approach),
            half_length_mm: 0.5 * jaw.length_mm,
            half_width_mm: 0.5 * jaw.width_mm,
        }
    }
}

/// The prism that one bite cuts, without end along the opening direction.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    center: Point3,
    along: Vector3,
    across: Vector3,
    half_length_mm: f64,
    half_width_mm: f64,
}

impl Cut {
    /// Whether the prism holds a point.
    pub fn contains(&self, point: &Point3) -> bool {
        let offset = point - self.center;
        offset.dot(&self.along).abs() <= self.half_length_mm
            && offset.dot(&self.across).abs() <= self.half_width_mm
    }

    /// How far in the plane (z up) the prism reaches from its center at heights within `height_mm`
    /// of it, mm.
    pub fn reach_mm(&self, height_mm: f64) -> f64 {
        let flat = self.along.xy().norm().max(1e-3);
        self.half_length_mm.hypot(self.half_width_mm) / flat + height_mm * self.along.z.abs() / flat
    }

    /// Half the extent of the rectangle in a direction of the plane, mm.
    pub fn support_mm(&self, direction: &Vector3) -> f64 {
        self.half_length_mm * self.along.dot(direction).abs()
            + self.half_width_mm * self.across.dot(direction).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const JAW: Jaw = Jaw {
        width_mm: 3.0,
        length_mm: 4.5,
    };

    #[test]
    fn the_long_axis_points_from_the_portal_and_the_thickness_is_cut_through() {
        let portal = Point3::new(-50.0, 0.0, 10.0);
        let bite =
            Bite::through(&portal, Point3::origin(), &Vector3::z(), Point3::origin()).unwrap();
        assert!(bite.approach.dot(&bite.opening).abs() < 1e-12);
        let cut = bite.cut(&JAW);
        let at = |along: f64, across: f64, up: f64| {
            Point3::from(bite.approach * along + Vector3::y() * across + bite.opening * up)
        };
        assert!(cut.contains(&at(2.24, 1.49, 9.0)));
        assert!(!cut.contains(&at(2.26, 0.0, 0.0)));
        assert!(!cut.contains(&at(0.0, -1.51, 0.0)));
    }

    #[test]
    fn a_shaft_from_straight_above_has_no_opening_direction() {
        let above = Point3::new(0.0, 0.0, 40.0);
        assert_eq!(
            Bite::through(&above, Point3::origin(), &Vector3::z(), Point3::origin()),
            None
        );
    }
}
