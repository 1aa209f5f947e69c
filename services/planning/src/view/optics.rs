//! The arthroscope: a straight shaft whose optics look obliquely to it.
//!
//! Turning the optics about the shaft turns the view around it on a cone of half-angle `tilt`; that
//! is how an oblique arthroscope looks around corners.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use arthro_geometry::{Point3, Vector3};

const DEGREE: f64 = PI / 180.0;

/// Shape and limits of an arthroscope. Default: a 4.0 mm arthroscope of 30 deg.
#[derive(Clone, Debug, PartialEq)]
pub struct Optics {
    /// Angle between the shaft and the middle of the image. 25-30 deg are usual
    /// (musculoskeletalkey.com, chapter 49).
    pub tilt_rad: f64,
    /// Full angle of the image: 115 deg for a shaft of 4.0 mm, 90 deg for 2.7 mm, 65 deg for 1.9 mm
    /// (musculoskeletalkey.com, chapter 49).
    pub field_of_view_rad: f64,
    /// What of the image's edge is not used, on every side.
    pub margin_rad: f64,
    /// From the tip to the bite, mm. The middle is aimed at: 20 mm, where the cell holds its tip;
    /// rigid endoscopes of 30 deg are drawn for 25 mm (Acta Optica Sinica 38, 0222002).
    pub distance_mm: RangeInclusive<f64>,
    /// Radius of the shaft, mm.
    pub shaft_radius_mm: f64,
    /// From the portal to the tip, mm.
    pub depth_mm: RangeInclusive<f64>,
    /// Turns of the optics about the shaft: those of the axis `arthroscope_rotation`.
    pub roll_rad: RangeInclusive<f64>,
    /// What must stay free between the surfaces of both shafts, mm.
    pub clearance_min_mm: f64,
    /// What must stay free between the shaft and the bones, mm.
    pub bone_clearance_min_mm: f64,
    /// Share of the jaw's footprint that may be hidden, percent.
    pub occluded_max_percent: f64,
    /// Length of the shaft that may lie in the tissue, which gives way by that much, mm.
    pub through_tissue_max_mm: f64,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            tilt_rad: 30.0 * DEGREE,
            field_of_view_rad: 115.0 * DEGREE,
            margin_rad: 5.0 * DEGREE,
            distance_mm: 10.0..=30.0,
            shaft_radius_mm: 2.0,
            depth_mm: 5.0..=100.0,
            roll_rad: -45.0 * DEGREE..=180.0 * DEGREE,
            clearance_min_mm: 2.0,
            bone_clearance_min_mm: 0.5,
            occluded_max_percent: 25.0,
            through_tissue_max_mm: 2.0,
        }
    }
}

/// Where the optics look after the best turn towards a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Turn of the optics about the shaft.
    pub roll_rad: f64,
    /// Unit direction of the middle of the image.
    pub optical_axis: Vector3,
    /// Angle between it and the point.
    pub offset_rad: f64,
}

impl Optics {
    /// The farthest that anything may be from the optical axis and still be seen.
    pub fn reach_rad(&self) -> f64 {
        0.5 * self.field_of_view_rad - self.margin_rad
    }

    /// The middle of the range of distances, mm.
    pub fn best_distance_mm(&self) -> f64 {
        0.5 * (self.distance_mm.start() + self.distance_mm.end())
    }

    /// Where the optics look when turned by `roll_rad` about a shaft along the unit vector
    /// `approach`: at 0 to the right, at a quarter turn down, at half a turn to the left, for one who
    /// looks along the shaft with `superior` up. `None` if the shaft is along `superior`.
    pub fn axis(&self, approach: &Vector3, superior: &Vector3, roll_rad: f64) -> Option<Vector3> {
        let [right, down] = sides(approach, superior)?;
        let aside = right * roll_rad.cos() + down * roll_rad.sin();
        Some(approach * self.tilt_rad.cos() + aside * self.tilt_rad.sin())
    }

    /// The turn within the range that brings `point` nearest to the middle of the image, seen from
    /// `tip`. `None` if the shaft is along `superior` or the point at the tip.
    pub fn look_at(
        &self,
        tip: &Point3,
        approach: &Vector3,
        superior: &Vector3,
        point: &Point3,
    ) -> Option<Look> {
        let [right, down] = sides(approach, superior)?;
        let towards = (point - tip).try_normalize(1e-6)?;
        let wanted_rad = towards.dot(&down).atan2(towards.dot(&right));
        let roll_rad = nearest_turn(wanted_rad, &self.roll_rad);
        let optical_axis = self.axis(approach, superior, roll_rad)?;
        Some(Look {
            roll_rad,
            optical_axis,
            offset_rad: optical_axis.angle(&towards),
        })
    }

    /// Every value that cannot be right, as field and problem.
    pub fn problems(&self) -> Vec<(&'static str, String)> {
        let mut problems = Vec::new();
        let mut within = |field, value: f64, range: RangeInclusive<f64>| {
            // NaN is in no range.
            if !range.contains(&value) {
                let (low, high) = (range.start(), range.end());
                problems.push((field, format!("is {value}; must be {low:.4} .. {high:.4}")));
            }
        };
        within("tilt_rad", self.tilt_rad, 0.0..=0.5 * PI);
        within("field_of_view_rad", self.field_of_view_rad, 0.1..=PI);
        within(
            "margin_rad",
            self.margin_rad,
            0.0..=0.49 * self.field_of_view_rad,
        );
        within("shaft_radius_mm", self.shaft_radius_mm, 0.25..=5.0);
        within("clearance_min_mm", self.clearance_min_mm, 0.0..=50.0);
        within(
            "bone_clearance_min_mm",
            self.bone_clearance_min_mm,
            0.0..=50.0,
        );
        within(
            "occluded_max_percent",
            self.occluded_max_percent,
            0.0..=100.0,
        );
        within(
            "through_tissue_max_mm",
            self.through_tissue_max_mm,
            0.0..=50.0,
        );
        let mut ordered = |low, high, range: &RangeInclusive<f64>, limits: RangeInclusive<f64>| {
            within(low, *range.start(), limits.clone());
            within(high, *range.end(), *range.start()..=*limits.end());
        };
        ordered(
            "distance_min_mm",
            "distance_max_mm",
            &self.distance_mm,
            1.0..=100.0,
        );
        ordered("depth_min_mm", "depth_max_mm", &self.depth_mm, 0.0..=500.0);
        ordered("roll_min_rad", "roll_max_rad", &self.roll_rad, -TAU..=TAU);
        problems
    }
}

/// Right and down for one who looks along the shaft with `superior` up.
fn sides(approach: &Vector3, superior: &Vector3) -> Option<[Vector3; 2]> {
    let right = approach.cross(superior).try_normalize(1e-3)?;
    Some([right, approach.cross(&right)])
}

/// The turn of the range that is nearest to `wanted_rad` on the circle.
fn nearest_turn(wanted_rad: f64, range: &RangeInclusive<f64>) -> f64 {
    let (low, high) = (*range.start(), *range.end());
    let turn = low + (wanted_rad - low).rem_euclid(TAU);
    if turn <= high {
        return turn;
    }
    let (past_high, before_low) = (turn - high, low + TAU - turn);
    if past_high <= before_low { high } else { low }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit() -> impl Strategy<Value = Vector3> {
        (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
            .prop_map(|(x, y, z)| Vector3::new(x, y, z))
            .prop_filter_map("has a direction beside superior", |vector| {
                let unit = vector.try_normalize(0.1)?;
                (unit.z.abs() < 0.99).then_some(unit)
            })
    }

    proptest! {
        #[test]
        fn a_turn_about_the_shaft_keeps_the_tilt_and_the_length(
            approach in unit(), roll_rad in -7.0..7.0f64, tilt_rad in 0.0..1.5f64
        ) {
            let optics = Optics { tilt_rad, ..Optics::default() };
            let axis = optics.axis(&approach, &Vector3::z(), roll_rad).unwrap();
            prop_assert!((axis.norm() - 1.0).abs() < 1e-12);
            prop_assert!((axis.dot(&approach) - tilt_rad.cos()).abs() < 1e-12);
        }

        #[test]
        fn what_lies_on_the_cone_of_view_within_the_turns_comes_to_the_middle_of_the_image(
            approach in unit(), share in 0.0..1.0f64, distance_mm in 1.0..40.0f64
        ) {
            let optics = Optics::default();
            let (low, high) = (optics.roll_rad.start(), optics.roll_rad.end());
            let roll_rad = low + share * (high - low);
            let axis = optics.axis(&approach, &Vector3::z(), roll_rad).unwrap();
            let tip = Point3::new(3.0, -2.0, 1.0);
            let point = tip + axis * distance_mm;
            let look = optics.look_at(&tip, &approach, &Vector3::z(), &point).unwrap();
            prop_assert!(look.offset_rad < 1e-6, "{look:?}");
            prop_assert!((look.roll_rad - roll_rad).abs() < 1e-6, "{look:?}");
        }

        #[test]
        fn no_turn_of_the_range_brings_a_point_nearer_to_the_middle(
            approach in unit(), towards in unit(), share in 0.0..1.0f64
        ) {
            let optics = Optics::default();
            let (tip, superior) = (Point3::origin(), Vector3::z());
            let point = tip + towards * 15.0;
            let look = optics.look_at(&tip, &approach, &superior, &point).unwrap();
            prop_assert!(optics.roll_rad.contains(&look.roll_rad));
            let (low, high) = (optics.roll_rad.start(), optics.roll_rad.end());
            let other = optics.axis(&approach, &superior, low + share * (high - low)).unwrap();
            prop_assert!(look.offset_rad <= other.angle(&towards) + 1e-9);
        }
    }

    #[test]
    fn a_quarter_turn_looks_down_and_none_to_the_right() {
        let optics = Optics::default();
        let look = |roll_rad| optics.axis(&Vector3::x(), &Vector3::z(), roll_rad).unwrap();
        assert!(look(0.0).dot(&-Vector3::y()) > 0.49);
        assert!(look(0.5 * PI).dot(&-Vector3::z()) > 0.49);
        assert_eq!(optics.axis(&-Vector3::z(), &Vector3::z(), 0.0), None);
    }

    #[test]
    fn every_value_that_cannot_be_right_is_named() {
        assert_eq!(Optics::default().problems(), []);
        let wrong = Optics {
            tilt_rad: f64::NAN,
            field_of_view_rad: 4.0,
            distance_mm: 30.0..=10.0,
            roll_rad: 0.0..=f64::INFINITY,
            ..Optics::default()
        };
        let named: Vec<&str> = wrong.problems().iter().map(|(field, _)| *field).collect();
        assert_eq!(
            named,
            [
                "tilt_rad",
                "field_of_view_rad",
                "distance_max_mm",
                "roll_max_rad"
            ]
        );
    }
}
