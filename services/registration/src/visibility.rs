//! What the camera would have seen: a pose that puts the model in front of observed surface is wrong.
//!
//! The view is a depth map seen from the viewpoint; each cell keeps the nearest depth seen there. A model point that a
//! pose places clearly nearer in an occupied cell would have hidden what was seen: a free-space violation. What the
//! camera did not see is no evidence: the rest of the model may be hidden or cut off.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};

use crate::model::Model;
use crate::sampling;
use crate::view::View;

/// How much nearer than the observed surface a model point must be to count: units, and deviations of the view's noise.
const CLEARANCE_UNITS: f64 = 1.0;
const CLEARANCE_DEVIATIONS: f64 = 2.0;
/// Cells of the depth map along the longer side, at most.
const MAX_CELLS: f64 = 256.0;
/// A cell this many spacings wide leaves no hole inside an observed surface.
const CELL_SPACINGS: f64 = 2.0;
/// Points of the model that are tested.
const TESTED_POINTS: usize = 600;

/// The view as a depth map, and the model's points that are held against it.
#[derive(Clone, Debug)]
pub struct Visibility {
    viewpoint: Point3,
    /// Turns directions of the view's frame so that z points at the view.
    looking: Rotation,
    low: [f64; 2],
    cells_per_tangent: f64,
    size: [usize; 2],
    nearest_depth_mm: Vec<f64>,
    noise_mm: f64,
    clearance_ct_mm: f64,
    tested: Vec<Point3>,
}

impl Visibility {
    /// `None` if the viewpoint is unknown or lies among what is seen.
    pub fn new(model: &Model, view: &View) -> Option<Self> {
        let viewpoint = view.viewpoint?;
        let toward = -viewpoint.coords;
        if toward.norm() < 0.5 * view.extent_mm {
            return None;
        }
        let looking = Rotation::rotation_between(&toward, &Vector3::z())
            .unwrap_or_else(|| Rotation::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let mut visibility = Self {
            viewpoint,
            looking,
            low: [f64::INFINITY; 2],
            cells_per_tangent: 0.0,
            size: [0; 2],
            nearest_depth_mm: Vec::new(),
            noise_mm: view.noise_mm,
            clearance_ct_mm: CLEARANCE_UNITS * model.unit_mm,
            tested: sampling::spread(&model.points, TESTED_POINTS),
        };
        let rays: Vec<[f64; 3]> = view
            .dense
            .points
            .iter()
            .filter_map(|p| visibility.ray(p))
            .collect();
        let mut high = [f64::NEG_INFINITY; 2];
        for ray in &rays {
            for side in 0..2 {
                visibility.low[side] = visibility.low[side].min(ray[side]);
                high[side] = high[side].max(ray[side]);
            }
        }
        let widest = (high[0] - visibility.low[0]).max(high[1] - visibility.low[1]);
        let cell = (CELL_SPACINGS * view.spacing_mm / toward.norm()).max(widest / MAX_CELLS);
        if !(cell > 0.0 && cell.is_finite()) {
            return None;
        }
        visibility.cells_per_tangent = 1.0 / cell;
        visibility.size =
            [0, 1].map(|side| ((high[side] - visibility.low[side]) / cell) as usize + 1);
        visibility.nearest_depth_mm = vec![f64::NAN; visibility.size[0] * visibility.size[1]];
        for ray in rays {
            if let Some(place) = visibility.place(&ray) {
                let nearest = &mut visibility.nearest_depth_mm[place];
                *nearest = nearest.min(ray[2]);
            }
        }
        Some(visibility)
    }

    /// Share of the model's points that the pose puts in front of what was seen, 0..1.
    pub fn violation_share(&self, ct_from_view: &Similarity<Ct, Camera>) -> f64 {
        let view_from_ct = ct_from_view.inverse();
        let clearance =
            self.clearance_ct_mm * view_from_ct.scale + CLEARANCE_DEVIATIONS * self.noise_mm;
        let violations = self
            .tested
            .iter()
            .filter_map(|point| self.ray(&(view_from_ct * *point)))
            // A cell that saw nothing holds NaN, which is in front of nothing.
            .filter(|ray| {
                self.place(ray)
                    .is_some_and(|place| self.nearest_depth_mm[place] - ray[2] > clearance)
            })
            .count();
        violations as f64 / self.tested.len().max(1) as f64
    }

    /// Tangents of the direction and depth; `None` behind the viewpoint.
    fn ray(&self, point: &Point3) -> Option<[f64; 3]> {
        let seen = self.looking * (point - self.viewpoint);
        (seen.z > 0.0).then(|| [seen.x / seen.z, seen.y / seen.z, seen.z])
    }

    fn place(&self, ray: &[f64; 3]) -> Option<usize> {
        let cell =
            [0, 1].map(|side| ((ray[side] - self.low[side]) * self.cells_per_tangent).floor());
        let is_inside = (0..2).all(|side| cell[side] >= 0.0 && cell[side] < self.size[side] as f64);
        is_inside.then(|| cell[1] as usize * self.size[0] + cell[0] as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::Cloud;

    fn sheet() -> Vec<Point3> {
        (-15..=15)
            .flat_map(|i| (-15..=15).map(move |j| Point3::new(f64::from(i), f64::from(j), 0.0)))
            .collect()
    }

    fn lifted(z: f64) -> Similarity<Ct, Camera> {
        Similarity::new(1.0, Rotation::identity(), Vector3::new(0.0, 0.0, z))
    }

    #[test]
    fn a_model_in_front_of_the_view_violates_free_space_and_one_behind_does_not() {
        let cloud = Cloud::new(sheet());
        let model = Model::new(&cloud);
        for (eye, towards) in [(-100.0, 1.0), (300.0, -1.0)] {
            let view = View::new(&cloud, Some(Point3::new(0.0, 0.0, eye)));
            let visibility = Visibility::new(&model, &view).unwrap();
            assert_eq!(visibility.violation_share(&lifted(0.0)), 0.0);
            // The view lifted away from the camera leaves the model in front of it.
            assert!(visibility.violation_share(&lifted(5.0 * towards)) > 0.7);
            assert_eq!(visibility.violation_share(&lifted(-10.0 * towards)), 0.0);
        }
    }

    #[test]
    fn a_viewpoint_among_what_is_seen_tells_nothing() {
        let cloud = Cloud::new(sheet());
        let view = View::new(&cloud, Some(Point3::new(1.0, 0.0, 3.0)));
        assert!(Visibility::new(&Model::new(&cloud), &view).is_none());
    }
}
