//! The reference contour as the search needs it: where on it a point is, how far off, how it bends.

use arthro_geometry::{Point3, Vector3};

use crate::contour::Spline;

/// Distance between the samples of the reference, mm.
const SPACING_MM: f64 = 0.25;

/// Samples of the reference from start to goal.
pub(super) struct Guide {
    points: Vec<Point3>,
    /// Curvature vector at each point, 1/mm.
    bends: Vec<Vector3>,
    start_tangent: Vector3,
    goal_tangent: Vector3,
    length_mm: f64,
}

/// The place on the reference that is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// Distance of the point to the reference, mm.
    pub(super) off_mm: f64,
    /// Curvature vector of the reference there, 1/mm.
    pub(super) bend_per_mm: Vector3,
}

impl Guide {
    pub(super) fn of(reference: &Spline) -> Self {
        let parameters = reference.parameters_every(SPACING_MM);
        let bend = |&at: &f64| {
            let (first, second) = reference.derivatives(at);
            let squared = first.norm_squared().max(1e-12);
            let across = second - first * (second.dot(&first) / squared);
            across / squared
        };
        Self {
            points: parameters.iter().map(|&at| reference.point(at)).collect(),
            bends: parameters.iter().map(bend).collect(),
            start_tangent: reference.tangent(0.0),
            goal_tangent: reference.tangent(1.0),
            length_mm: reference.length_mm(),
        }
    }

    pub(super) fn length_mm(&self) -> f64 {
        self.length_mm
    }

    /// The sample nearest to a way from the start; beyond the goal straight on.
    pub(super) fn at(&self, way_mm: f64) -> Point3 {
        if way_mm > self.length_mm {
            return self.goal() + self.goal_tangent * (way_mm - self.length_mm);
        }
        let last = self.points.len() - 1;
        let index = (way_mm / self.length_mm.max(1e-9) * last as f64).round();
        self.points[(index as usize).min(last)]
    }

    pub(super) fn start(&self) -> Point3 {
        self.points[0]
    }

    pub(super) fn goal(&self) -> Point3 {
        self.points[self.points.len() - 1]
    }

    pub(super) fn start_tangent(&self) -> Vector3 {
        self.start_tangent
    }

    pub(super) fn foot(&self, point: &Point3) -> Foot {
        let mut best = (f64::INFINITY, 0);
        for (index, sample) in self.points.iter().enumerate() {
            let squared = (point - sample).norm_squared();
            if squared < best.0 {
                best = (squared, index);
            }
        }
        let (squared, index) = best;
        // Between two samples the distance is the one to their chord: to a sample alone it would be
        // up to half a spacing on the curve itself.
        let chord = |from: usize| {
            let (Some(a), Some(b)) = (self.points.get(from), self.points.get(from + 1)) else {
                return f64::INFINITY;
            };
            let way = b - a;
            let share = (point - a).dot(&way) / way.norm_squared().max(1e-12);
            (point - (a + way * share.clamp(0.0, 1.0))).norm_squared()
        };
        let squared = squared
            .min(chord(index))
            .min(chord(index.saturating_sub(1)));
        Foot {
            off_mm: squared.sqrt(),
            bend_per_mm: self.bends[index],
        }
    }
}
