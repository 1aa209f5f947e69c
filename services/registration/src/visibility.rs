//! What the camera would have seen: a pose that puts the model in front of observed surface is wrong.
//!
//! The view is binned by direction from the viewpoint; each bin keeps the nearest depth seen there. A model point
//! that a pose places clearly nearer in an occupied bin would have hidden what was seen (a free-space violation).

use std::collections::HashMap;

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};

use crate::neighbours::Neighbours;
use crate::sampling;

/// How much nearer than the observed surface a model point must be to count, mm: above depth noise and slopes.
const CLEARANCE_MM: f64 = 1.2;

/// The view as a depth map seen from the viewpoint.
#[derive(Clone, Debug)]
pub struct Visibility {
    viewpoint: Point3,
    /// Turns camera-frame directions so that z points at the view.
    looking: Rotation,
    bin_tangent: f64,
    nearest_depth_mm: HashMap<(i32, i32), f64>,
}

impl Visibility {
    /// Bins `view` as seen from `viewpoint`; `None` if the viewpoint lies within the view's own surroundings.
    pub fn new(view: &[Point3], viewpoint: Point3) -> Option<Self> {
        let (low, high) = arthro_geometry::cloud::bounds(view)?;
        let toward = low + (high - low) / 2.0 - viewpoint;
        if toward.norm() < 0.5 * (high - low).norm() {
            return None;
        }
        let looking = Rotation::rotation_between(&toward, &Vector3::z())
            .unwrap_or_else(|| Rotation::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let tree = Neighbours::new(view);
        // Twice the spacing leaves no hole inside an observed surface.
        let bin_tangent = 2.0 * sampling::spacing_mm(view, &tree).max(0.1) / toward.norm();
        let mut visibility = Self {
            viewpoint,
            looking,
            bin_tangent,
            nearest_depth_mm: HashMap::new(),
        };
        for point in view {
            if let Some((bin, depth_mm)) = visibility.bin(point) {
                let nearest = visibility.nearest_depth_mm.entry(bin).or_insert(depth_mm);
                *nearest = nearest.min(depth_mm);
            }
        }
        Some(visibility)
    }

    /// Share of `model` points that the pose puts in front of what was seen, 0..1.
    pub fn violation_share(
        &self,
        model: &[Point3],
        camera_from_ct: &Similarity<Camera, Ct>,
    ) -> f64 {
        let violations = model
            .iter()
            .filter(|point| {
                self.bin(&(*camera_from_ct * **point))
                    .and_then(|(bin, depth)| Some(self.nearest_depth_mm.get(&bin)? - depth))
                    .is_some_and(|in_front_mm| in_front_mm > CLEARANCE_MM * camera_from_ct.scale)
            })
            .count();
        violations as f64 / model.len().max(1) as f64
    }

    /// Direction bin and depth of a camera-frame point; `None` behind the viewpoint.
    fn bin(&self, point: &Point3) -> Option<((i32, i32), f64)> {
        let seen = self.looking * (point - self.viewpoint);
        if seen.z <= 0.0 {
            return None;
        }
        let cell = |c: f64| (c / seen.z / self.bin_tangent).floor() as i32;
        Some(((cell(seen.x), cell(seen.y)), seen.z))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(z: f64) -> Vec<Point3> {
        (-10..=10)
            .flat_map(|i| (-10..=10).map(move |j| Point3::new(i as f64, j as f64, z)))
            .collect()
    }

    #[test]
    fn a_model_in_front_of_the_view_violates_free_space_and_one_behind_does_not() {
        let visibility = Visibility::new(&sheet(100.0), Point3::origin()).unwrap();
        let identity = Similarity::identity();
        assert_eq!(visibility.violation_share(&sheet(100.0), &identity), 0.0);
        assert_eq!(visibility.violation_share(&sheet(110.0), &identity), 0.0);
        assert!(visibility.violation_share(&sheet(95.0), &identity) > 0.9);
    }

    #[test]
    fn the_viewpoint_may_stand_anywhere_outside_the_view() {
        let behind = Visibility::new(&sheet(100.0), Point3::new(0.0, 0.0, 300.0)).unwrap();
        assert!(behind.violation_share(&sheet(105.0), &Similarity::identity()) > 0.9);
        assert!(Visibility::new(&sheet(100.0), Point3::new(0.0, 0.0, 99.0)).is_none());
    }
}
