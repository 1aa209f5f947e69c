//! The curvature cost of a path, Eq. 8-10: as printed, and put right.

use arthro_geometry::{Point3, Vector3};

use super::guide::Guide;
use crate::contour::Spline;

/// Newest way over which the corrected cost is averaged, mm: a kink costs its angle over this way,
/// whatever the step.
const WINDOW_MM: f64 = 2.0;
/// Corrected cost of a millimetre off the reference, 1/mm for each mm.
const DISTANCE_WEIGHT: f64 = 0.5;

/// Which cost a path has to keep below the limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cost {
    /// The turn per length as a vector against the curvature vector of the reference, and the
    /// distance to the reference, averaged over the newest way.
    #[default]
    Corrected,
    /// Eq. 8-10 as printed: `|sin(turn)|` (Eq. 9) against the curvature of the reference at its
    /// nearest point in 1/mm (Eq. 10), averaged over the whole path (Eq. 8). The first segment turns
    /// nowhere and is free.
    AsPrinted,
}

/// Where a segment leaves the one before.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    /// Unit direction of the segment before; at the start the tangent of the reference.
    pub(super) before: Vector3,
    /// Length of the segment before, mm; 0 at the start.
    pub(super) before_mm: f64,
    /// Unit direction of the segment.
    pub(super) after: Vector3,
    /// Length of the segment, mm.
    pub(super) after_mm: f64,
    /// Curvature vector of the reference nearest to the corner, 1/mm.
    pub(super) bend_per_mm: Vector3,
    /// Distance of the segment's end to the reference, mm.
    pub(super) off_mm: f64,
}

/// One term of Eq. 8.
#[derive(Clone, Copy, Debug)]
pub(super) struct Term {
    /// Cost of the corner, 1/mm.
    cost_per_mm: f64,
    /// Way over which the corner turns, mm.
    way_mm: f64,
}

impl Cost {
    /// The least limit that lets a path pass: the highest cost of all its beginnings, 1/mm.
    pub fn highest_per_mm(self, path: &[Point3], reference: &Spline) -> f64 {
        let guide = Guide::of(reference);
        let (mut before, mut before_mm) = (guide.start_tangent(), 0.0);
        let mut terms: Vec<Term> = Vec::with_capacity(path.len());
        let mut highest_per_mm: f64 = 0.0;
        for pair in path.windows(2) {
            let segment = pair[1] - pair[0];
            let after_mm = segment.norm();
            let after = segment / after_mm.max(1e-9);
            terms.extend(self.term(&Corner {
                before,
                before_mm,
                after,
                after_mm,
                bend_per_mm: guide.foot(&pair[0]).bend_per_mm,
                off_mm: guide.foot(&pair[1]).off_mm,
            }));
            highest_per_mm = highest_per_mm.max(self.mean_per_mm(terms.iter().rev().copied()));
            (before, before_mm) = (after, after_mm);
        }
        highest_per_mm
    }

    /// What a corner adds to Eq. 8; `None` if it is no corner to this cost.
    pub(super) fn term(self, corner: &Corner) -> Option<Term> {
        let way_mm = corner.way_mm();
        match self {
            Self::Corrected => {
                // On a circle the chord between two unit directions over the way between the
                // segments' middles is exactly its curvature, whatever the step.
                let turn_per_mm = (corner.after - corner.before) / way_mm.max(1e-9);
                let turned_wrong = (turn_per_mm - corner.bend_per_mm).norm();
                let cost_per_mm = turned_wrong + DISTANCE_WEIGHT * corner.off_mm;
                Some(Term {
                    cost_per_mm,
                    way_mm,
                })
            }
            Self::AsPrinted => (corner.before_mm > 0.0).then(|| {
                let sine = corner.before.cross(&corner.after).norm();
                Term {
                    cost_per_mm: (sine - corner.bend_per_mm.norm()).abs(),
                    way_mm,
                }
            }),
        }
    }

    /// Eq. 8 over the terms of a path, the newest first, 1/mm; 0 if there is none.
    pub(super) fn mean_per_mm(self, terms: impl Iterator<Item = Term>) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for term in terms {
            let weight = match self {
                Self::Corrected if weights >= WINDOW_MM => break,
                // The oldest corner counts as far as it lies in the window.
                Self::Corrected => term.way_mm.min(WINDOW_MM - weights),
                Self::AsPrinted => 1.0,
            };
            sum += weight * term.cost_per_mm;
            weights += weight;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }
}

impl Corner {
    /// Way from the middle of the segment before to the middle of this one, mm.
    fn way_mm(&self) -> f64 {
        0.5 * (self.before_mm + self.after_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The mean radius of the paper's contour on the phantom.
    const RADIUS_MM: f64 = 13.3;
    /// The limit of the search by default.
    const LIMIT_PER_MM: f64 = 0.4;

    fn on_arc(way_mm: f64) -> Point3 {
        let (sin, cos) = (way_mm / RADIUS_MM).sin_cos();
        Point3::new(RADIUS_MM * cos, RADIUS_MM * sin, 0.0)
    }

    fn reference() -> Spline {
        let points: Vec<Point3> = (0..=80).map(|step| on_arc(f64::from(step) * 0.5)).collect();
        Spline::fit(&points, 30).unwrap()
    }

    fn costs(path: &[Point3]) -> (f64, f64) {
        let reference = reference();
        (
            Cost::Corrected.highest_per_mm(path, &reference),
            Cost::AsPrinted.highest_per_mm(path, &reference),
        )
    }

    /// Points whose chords are `step_mm` long.
    fn along_reference(step_mm: f64, steps: u32) -> Vec<Point3> {
        let way_mm = 2.0 * RADIUS_MM * (0.5 * step_mm / RADIUS_MM).asin();
        (0..=steps)
            .map(|step| on_arc(f64::from(step) * way_mm))
            .collect()
    }

    /// A path in the plane from the start of the reference, each step turned by `turn_rad(step)`.
    fn turning(step_mm: f64, steps: u32, turn_rad: impl Fn(u32) -> f64) -> Vec<Point3> {
        let mut path = vec![on_arc(0.0)];
        let mut heading_rad = std::f64::consts::FRAC_PI_2;
        for step in 0..steps {
            heading_rad += turn_rad(step);
            let (sin, cos) = heading_rad.sin_cos();
            path.push(path[path.len() - 1] + Vector3::new(cos, sin, 0.0) * step_mm);
        }
        path
    }

    #[test]
    fn following_the_reference_costs_nothing_whatever_the_step() {
        for step_mm in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let (corrected, _) = costs(&along_reference(step_mm, (36.0 / step_mm) as u32));
            assert!(
                corrected < 0.01,
                "{corrected} /mm at a step of {step_mm} mm"
            );
        }
    }

    #[test]
    fn as_printed_the_reference_itself_costs_what_the_step_makes_of_it() {
        // |sin(turn)| is 1/r times the step: right at 1 mm only.
        for (step_mm, sine) in [(0.25, 0.0188), (0.5, 0.0376), (2.0, 0.1498), (4.0, 0.2962)] {
            let (_, printed) = costs(&along_reference(step_mm, (36.0 / step_mm) as u32));
            let expected = (sine - 1.0 / RADIUS_MM).abs();
            assert!(
                (printed - expected).abs() < 2e-3,
                "{printed} at {step_mm} mm"
            );
        }
        assert!(costs(&along_reference(1.0, 36)).1 < 2e-3);
    }

    #[test]
    fn a_reversal_is_refused_and_as_printed_it_passes_for_a_straight_line() {
        let forth_and_back: Vec<Point3> = (0..12).map(|step| on_arc(f64::from(step % 2))).collect();
        let (corrected, printed) = costs(&forth_and_back);
        assert!(corrected > LIMIT_PER_MM);
        assert!((printed - 1.0 / RADIUS_MM).abs() < 2e-3, "{printed}");
    }

    #[test]
    fn a_straight_line_is_refused_and_as_printed_it_passes() {
        let (corrected, printed) = costs(&turning(1.0, 12, |_| 0.0));
        assert!(corrected > LIMIT_PER_MM);
        assert!((printed - 1.0 / RADIUS_MM).abs() < 2e-3, "{printed}");
    }

    #[test]
    fn an_arc_bent_the_wrong_way_is_refused_and_as_printed_it_is_the_best_of_all() {
        let (corrected, printed) = costs(&turning(1.0, 12, |_| -1.0 / RADIUS_MM));
        assert!(corrected > LIMIT_PER_MM);
        assert!(printed < 2e-3, "{printed}");
    }

    #[test]
    fn a_zig_zag_is_refused_and_as_printed_it_is_the_best_of_all() {
        let zig_zag = |step: u32| if step.is_multiple_of(2) { 1.0 } else { -1.0 } / RADIUS_MM;
        let (corrected, printed) = costs(&turning(1.0, 12, zig_zag));
        assert!(corrected > LIMIT_PER_MM);
        assert!(printed < 2e-3, "{printed}");
    }

    #[test]
    fn a_late_kink_is_refused_and_as_printed_a_long_path_hides_it() {
        let mut path = along_reference(1.0, 30);
        let ahead = path[30] - path[29];
        // A right angle out of the plane of the reference, back towards it.
        path.push(path[30] + Vector3::z() * ahead.norm());
        let (corrected, printed) = costs(&path);
        assert!(corrected > LIMIT_PER_MM, "{corrected}");
        assert!(printed < 0.05, "{printed}");
    }

    #[test]
    fn a_path_beside_the_reference_is_refused_and_as_printed_it_passes() {
        let beside: Vec<Point3> = along_reference(1.0, 30)
            .iter()
            .map(|point| point + Vector3::z() * 3.0)
            .collect();
        let (corrected, printed) = costs(&beside);
        assert!(corrected > LIMIT_PER_MM);
        assert!(printed < 2e-3, "{printed}");
    }

    proptest! {
        #[test]
        fn a_sharper_corner_costs_more_whatever_the_step(
            step_mm in 0.25..4.0f64,
            turn_rad in 0.1..3.0f64,
            sharper_rad in 0.05..0.1415f64,
        ) {
            let begin = along_reference(step_mm, 2);
            let cost = |turn_rad: f64| {
                let corner = Corner {
                    before: (begin[1] - begin[0]).normalize(),
                    before_mm: step_mm,
                    after: arthro_geometry::Rotation::new(Vector3::z() * -turn_rad)
                        * (begin[1] - begin[0]).normalize(),
                    after_mm: step_mm,
                    bend_per_mm: Vector3::zeros(),
                    off_mm: 0.0,
                };
                Cost::Corrected.term(&corner).unwrap().cost_per_mm
            };
            prop_assert!(cost(turn_rad + sharper_rad) > cost(turn_rad));
        }

        #[test]
        fn the_cost_of_a_circle_is_its_distance_from_the_references_curvature(
            step_mm in 0.25..4.0f64,
            radius_mm in 5.0..40.0f64,
        ) {
            let turn_rad = 2.0 * (0.5 * step_mm / radius_mm).asin();
            let (sin, cos) = turn_rad.sin_cos();
            let corner = Corner {
                before: Vector3::x(),
                before_mm: step_mm,
                after: Vector3::new(cos, sin, 0.0),
                after_mm: step_mm,
                bend_per_mm: Vector3::new(-(0.5 * turn_rad).sin(), (0.5 * turn_rad).cos(), 0.0)
                    / RADIUS_MM,
                off_mm: 0.0,
            };
            let expected = (1.0 / radius_mm - 1.0 / RADIUS_MM).abs();
            let term = Cost::Corrected.term(&corner).unwrap().cost_per_mm;
            prop_assert!((term - expected).abs() < 1e-12);
        }
    }
}
