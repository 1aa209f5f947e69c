//! The jaw of the forceps and what one bite cuts.
//!
//! A straight punch: it cuts the full thickness below a rectangle whose long axis lies along the
//! shaft, which points from the portal to the bite. Behind the rectangle, towards the portal, is the
//! hinge: what stands in this throat keeps the jaw from closing around the tissue.

use arthro_geometry::frame::Frame;
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::error::Error;

/// How far behind the jaw its hinge needs room, mm: an assumption, no maker states it.
pub const DEFAULT_THROAT_MM: f64 = 1.0;

/// The cutting rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jaw {
    /// Across the shaft, mm.
    pub width_mm: f64,
    /// Along the shaft, mm. The tool's tip is the middle of the jaw.
    pub length_mm: f64,
    /// How far behind the cutting rectangle, towards the portal, the hinge needs room, mm.
    pub throat_mm: f64,
}

impl Jaw {
    /// A jaw with the default throat.
    pub fn new(width_mm: f64, length_mm: f64) -> Self {
        Self {
            width_mm,
            length_mm,
            throat_mm: DEFAULT_THROAT_MM,
        }
    }
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

    /// A bite of which only the middle of the jaw and its long axis are known: `axis` points out of
    /// the portal into the joint, the jaw opens towards `superior` as far as the axis lets it. An axis
    /// that is not finite or parallel to `superior` within 1 mrad is refused.
    pub fn of_axis(center: Point3, axis: &Vector3, superior: &Vector3) -> Result<Self, Error> {
        let refused = |problem: String| Error::invalid("bites.axis", problem);
        let approach = axis
            .try_normalize(1e-6)
            .filter(|approach| approach.iter().all(|value| value.is_finite()))
            .ok_or_else(|| refused(format!("has length {}; must be above 1e-6", axis.norm())))?;
        let opening = (superior - approach * superior.dot(&approach))
            .try_normalize(1e-3)
            .ok_or_else(|| refused("is parallel to superior; must be 1 mrad or more off".into()))?;
        Ok(Self {
            center,
            approach,
            opening,
            contour_point: center,
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

    /// Where the jaw's hinge needs room for this bite.
    pub fn throat(&self, jaw: &Jaw) -> Throat {
        let behind_mm = 0.5 * (jaw.length_mm + jaw.throat_mm);
        Throat {
            center: self.center - self.approach * behind_mm,
            along: self.approach,
            across: self.opening.cross(&self.approach),
            opening: self.opening,
            length_mm: jaw.throat_mm,
            width_mm: jaw.width_mm,
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

    /// Whether the prism may hold something of the upright line through a point at heights within
    /// `height_mm` of its center; never false if it does.
    pub fn may_meet(&self, on_line: &Point3, height_mm: f64) -> bool {
        let offset = (on_line - self.center).xy();
        let is_near = |axis: &Vector3, half_mm: f64| {
            let off_mm = offset.dot(&axis.xy()).abs();
            off_mm <= half_mm + height_mm * axis.z.abs()
        };
        is_near(&self.along, self.half_length_mm) && is_near(&self.across, self.half_width_mm)
    }

    /// The middle of the jaw, mm.
    pub fn center(&self) -> &Point3 {
        &self.center
    }

    /// How far in the plane (z up) the prism reaches from its center at heights within `height_mm`
    /// of it, mm.
    pub fn reach_mm(&self, height_mm: f64) -> f64 {
        // A plane across z cuts the prism in a parallelogram that is stretched by the tilt of its
        // edges and moves along them with the height.
        let opening = self.along.cross(&self.across);
        let upright = opening.z.abs().max(1e-3);
        let corner_mm = self.half_length_mm.hypot(self.half_width_mm);
        (corner_mm + height_mm * opening.xy().norm()) / upright
    }

    /// Half the extent of the rectangle in a direction of the plane, mm.
    pub fn support_mm(&self, direction: &Vector3) -> f64 {
        self.half_length_mm * self.along.dot(direction).abs()
            + self.half_width_mm * self.across.dot(direction).abs()
    }
}

/// The rectangle behind the jaw that its hinge needs, without end along the opening direction.
#[derive(Clone, Copy, Debug)]
pub struct Throat {
    center: Point3,
    along: Vector3,
    across: Vector3,
    /// Unit direction along which the throat has no end.
    pub opening: Vector3,
    length_mm: f64,
    width_mm: f64,
}

impl Throat {
    /// The middles of equal cells of the footprint, none longer or wider than `spacing_mm`.
    pub fn footprint(&self, spacing_mm: f64) -> impl Iterator<Item = Point3> + '_ {
        let cells = |extent_mm: f64| ((extent_mm / spacing_mm).ceil() as usize).max(1);
        let (rows, columns) = (cells(self.length_mm), cells(self.width_mm));
        let middle = |cell: usize, cells: usize| (cell as f64 + 0.5) / cells as f64 - 0.5;
        (0..rows * columns).map(move |cell| {
            let back_mm = self.length_mm * middle(cell / columns, rows);
            let side_mm = self.width_mm * middle(cell % columns, columns);
            self.center + self.along * back_mm + self.across * side_mm
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const JAW: Jaw = Jaw {
        width_mm: 3.0,
        length_mm: 4.5,
        throat_mm: 1.0,
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

    #[test]
    fn a_bite_of_an_axis_is_the_bite_through_a_portal_on_it() {
        let portal = Point3::new(-50.0, 20.0, 10.0);
        let center = Point3::new(1.0, 2.0, 3.0);
        let through = Bite::through(&portal, center, &Vector3::z(), center).unwrap();
        let of_axis = Bite::of_axis(center, &((center - portal) * 7.0), &Vector3::z()).unwrap();
        assert!((through.approach - of_axis.approach).norm() < 1e-12);
        assert!((through.opening - of_axis.opening).norm() < 1e-12);
    }

    #[test]
    fn an_axis_that_shows_no_opening_is_refused() {
        for axis in [
            Vector3::z(),
            -Vector3::z(),
            Vector3::zeros(),
            Vector3::new(f64::NAN, 1.0, 0.0),
            Vector3::new(f64::INFINITY, 1.0, 0.0),
        ] {
            let refused = Bite::of_axis(Point3::origin(), &axis, &Vector3::z());
            assert!(matches!(refused, Err(Error::Invalid { .. })), "{axis}");
        }
    }

    #[test]
    fn the_throat_begins_where_the_cut_ends_towards_the_portal() {
        let portal = Point3::new(-50.0, 0.0, 10.0);
        let bite =
            Bite::through(&portal, Point3::origin(), &Vector3::z(), Point3::origin()).unwrap();
        let cut = bite.cut(&JAW);
        let footprint: Vec<Point3> = bite.throat(&JAW).footprint(0.3).collect();
        assert_eq!(footprint.len(), 40);
        for point in footprint {
            let back_mm = -(point - bite.center).dot(&bite.approach);
            assert!((2.25..=3.25).contains(&back_mm), "{back_mm} mm");
            assert!(!cut.contains(&point));
            assert!(cut.contains(&(point + bite.approach)));
        }
    }

    #[test]
    fn nothing_the_prism_holds_is_beyond_its_reach() {
        let bite = Bite::of_axis(
            Point3::origin(),
            &Vector3::new(2.0, 1.0, -1.0),
            &Vector3::z(),
        );
        let bite = bite.unwrap();
        let cut = bite.cut(&JAW);
        let reach_mm = cut.reach_mm(4.0);
        let mut farthest_mm = 0f64;
        for step in 0..200_000 {
            let at = |stride: usize, extent_mm: f64| {
                (step * stride % 20_011) as f64 / 20_011.0 * 2.0 * extent_mm - extent_mm
            };
            let point = Point3::new(at(7, 9.0), at(1009, 9.0), at(12_007, 4.0));
            if cut.contains(&point) {
                farthest_mm = farthest_mm.max(point.xy().coords.norm());
            }
        }
        assert!(farthest_mm <= reach_mm && farthest_mm > 0.7 * reach_mm);
    }
}
