//! The fine stage: iterative closest points with a clamped scale (Eq. 5-7 of the paper).
//!
//! Pairs go from the view to the model: every view point lies on the model, not the other way round. Paired the
//! other way, a partial view draws the model's scale down without end. Point-to-point steps have the closed form of
//! Eq. 5-7; point-to-plane steps follow, since only they slide along the surface to below the samples' spacing.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::{Matrix3, Rotation3};
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use rayon::prelude::*;

use crate::surface::{Foot, Matching, Surface};

mod plane;

/// The scales that a camera_from_ct similarity may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRange {
    /// Smallest scale.
    pub low: f64,
    /// Largest scale.
    pub high: f64,
}

impl ScaleRange {
    /// One scale and no other.
    pub fn only(scale: f64) -> Self {
        Self {
            low: scale,
            high: scale,
        }
    }

    /// The middle of the range and a standard deviation around it, as logarithms: a fourth of the range's width.
    fn expectation(&self) -> (f64, f64) {
        (
            (self.low * self.high).ln() / 2.0,
            (self.high / self.low).ln() / 4.0,
        )
    }

    /// The scale of the range nearest to `scale`.
    pub fn clamp(&self, scale: f64) -> f64 {
        scale.clamp(self.low, self.high)
    }
}

/// How to refine.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Point-to-point steps at first.
    pub point_steps: u32,
    /// Most point-to-plane steps after them; fewer when the pose rests.
    pub plane_steps: u32,
    /// Share of the view's points, the nearest ones, that count.
    pub kept_share: f64,
    /// The scales allowed.
    pub scale: ScaleRange,
    /// How pairs are found.
    pub matching: Matching,
    /// Where the start may be off.
    pub start: Start,
}

/// How good the pose is that a refinement starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Parts of the view may be off by millimetres: at first they pull like all others.
    Rough,
    /// What is far from the model is astray.
    Near,
}

/// Residuals' standard deviation is taken as no less than this, mm; a good sensor's own noise.
const LEAST_DEVIATION_MM: f64 = 0.1;
/// For a rough start it is taken larger by this in the first plane step, mm.
const FIRST_DEVIATION_MM: f64 = 1.0;
/// What is left of that after each step.
const DEVIATION_DECAY: f64 = 0.85;

impl Settings {
    fn least_deviation_mm(&self, plane_step: u32) -> f64 {
        match self.start {
            Start::Rough => {
                LEAST_DEVIATION_MM
                    + FIRST_DEVIATION_MM * DEVIATION_DECAY.powf(f64::from(plane_step))
            }
            Start::Near => LEAST_DEVIATION_MM,
        }
    }
}

/// A refined pose.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The pose, from view to model as it is paired.
    pub ct_from_camera: Similarity<Ct, Camera>,
    /// Each iteration's state before its step.
    pub iterations: Vec<Iteration>,
}

/// One iteration of the fine stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// Eq. 15, mm2 of the camera frame.
    pub mse_mm2: f64,
    /// Scale of camera_from_ct.
    pub scale: f64,
}

/// Refines `start` until it rests or the steps are used up.
pub fn refine(
    model: &Surface,
    view: &[Point3],
    start: Similarity<Ct, Camera>,
    settings: &Settings,
) -> Refined {
    let mut refined = Refined {
        ct_from_camera: start,
        iterations: Vec::new(),
    };
    for step in 0..settings.point_steps + settings.plane_steps {
        let pairs = Pairs::new(model, view, &refined.ct_from_camera, settings);
        refined
            .iterations
            .push(pairs.iteration(&refined.ct_from_camera));
        let next = if step < settings.point_steps {
            pairs.point_step(model, view, settings.scale)
        } else {
            let least_deviation_mm = settings.least_deviation_mm(step - settings.point_steps);
            plane::step(
                model,
                &pairs,
                &refined.ct_from_camera,
                settings.scale,
                least_deviation_mm,
            )
        };
        let Some(next) = next else { break };
        let moved = movement_mm(&refined.ct_from_camera, &next, &pairs);
        refined.ct_from_camera = next;
        if step >= settings.point_steps && moved < RESTING_MM {
            break;
        }
    }
    refined
}

/// A pose that moves no view point farther than this in one step rests, mm.
const RESTING_MM: f64 = 1e-3;

/// The view carried to the model, each point with its foot there.
struct Pairs {
    /// View points in ct.
    carried: Vec<Point3>,
    feet: Vec<Foot>,
    /// Largest squared distance that still counts, mm2.
    limit2: f64,
}

impl Pairs {
    fn new(
        model: &Surface,
        view: &[Point3],
        ct_from_camera: &Similarity<Ct, Camera>,
        settings: &Settings,
    ) -> Self {
        let carried: Vec<Point3> = view.iter().map(|point| *ct_from_camera * *point).collect();
        let feet: Vec<Foot> = carried
            .par_iter()
            .with_min_len(256)
            .map(|point| model.foot(point, settings.matching))
            .collect();
        let mut distances: Vec<f64> = feet.iter().map(|foot| foot.surface_distance2).collect();
        let kept =
            ((distances.len() as f64 * settings.kept_share) as usize).min(distances.len() - 1);
        let limit2 = *distances.select_nth_unstable_by(kept, f64::total_cmp).1;
        Self {
            carried,
            feet,
            limit2,
        }
    }

    fn kept(&self) -> impl Iterator<Item = (usize, &Foot)> {
        self.feet
            .iter()
            .enumerate()
            .filter(|(_, foot)| foot.surface_distance2 <= self.limit2)
    }

    fn iteration(&self, ct_from_camera: &Similarity<Ct, Camera>) -> Iteration {
        let scale = 1.0 / ct_from_camera.scale;
        let (sum, count) = self.kept().fold((0.0, 0.0), |(sum, count), (_, foot)| {
            (sum + foot.distance2, count + 1.0)
        });
        Iteration {
            mse_mm2: sum / count * scale * scale,
            scale,
        }
    }

    fn point_step(
        &self,
        model: &Surface,
        view: &[Point3],
        scale: ScaleRange,
    ) -> Option<Similarity<Ct, Camera>> {
        let pairs: Vec<(Point3, Point3)> = self
            .kept()
            .map(|(index, foot)| (model.points[foot.index], view[index]))
            .collect();
        Some(closed_form(&pairs, scale)?.inverse())
    }
}

/// The similarity that best maps each pair's first point (ct) onto its second (camera), scale clamped: Eq. 5-7.
///
/// `None` if the pairs do not span a plane.
pub fn closed_form(
    pairs: &[(Point3, Point3)],
    scale: ScaleRange,
) -> Option<Similarity<Camera, Ct>> {
    let count = pairs.len() as f64;
    let mean_ct = pairs.iter().map(|(ct, _)| ct.coords).sum::<Vector3>() / count;
    let mean_camera = pairs
        .iter()
        .map(|(_, camera)| camera.coords)
        .sum::<Vector3>()
        / count;
    let mut covariance = Matrix3::zeros();
    let mut variance = 0.0;
    for (ct, camera) in pairs {
        let (ct, camera) = (ct.coords - mean_ct, camera.coords - mean_camera);
        covariance += camera * ct.transpose();
        variance += ct.norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (u, v_transposed) = (svd.u?, svd.v_t?);
    if svd.singular_values[1] <= 1e-9 * svd.singular_values[0] {
        return None;
    }
    // A reflection fits a flat cloud as well as a rotation: the least axis gives way.
    let mut signs = Vector3::new(1.0, 1.0, 1.0);
    signs[svd.singular_values.imin()] = (u * v_transposed).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&signs) * v_transposed;
    let rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let scale = scale.clamp(svd.singular_values.dot(&signs) / variance);
    Some(Similarity::new(
        scale,
        rotation,
        mean_camera - rotation * mean_ct * scale,
    ))
}

/// How far the step from one pose to the next moves the view's points at most, mm.
fn movement_mm(from: &Similarity<Ct, Camera>, to: &Similarity<Ct, Camera>, pairs: &Pairs) -> f64 {
    let step = *to * from.inverse();
    pairs
        .carried
        .iter()
        .step_by(pairs.carried.len() / 16 + 1)
        .map(|point| (step * *point - point).norm())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_closed_form_recovers_a_known_similarity(
            scale in 0.5..2.0f64,
            axis in prop::array::uniform3(-3.0..3.0f64),
            shift in prop::array::uniform3(-300.0..300.0f64),
            points in prop::collection::vec(prop::array::uniform3(-20.0..20.0f64), 6..30),
        ) {
            let truth = Similarity::<Camera, Ct>::new(
                scale, Rotation::from_scaled_axis(Vector3::from(axis)), Vector3::from(shift));
            let pairs: Vec<_> = points.iter().map(|p| Point3::from(*p)).map(|p| (p, truth * p)).collect();
            let found = closed_form(&pairs, ScaleRange { low: 0.1, high: 10.0 }).unwrap();
            prop_assert!((found.scale - truth.scale).abs() < 1e-9);
            prop_assert!(found.rotation.angle_to(&truth.rotation) < 1e-6);
            prop_assert!((found.translation_mm - truth.translation_mm).norm() < 1e-6);
        }
    }

    #[test]
    fn the_closed_form_keeps_the_scale_in_its_range() {
        let points = [
            [0.0, 0.0, 0.0],
            [9.0, 0.0, 0.0],
            [0.0, 7.0, 0.0],
            [1.0, 2.0, 5.0],
        ];
        let pairs: Vec<_> = points
            .iter()
            .map(|p| Point3::from(*p))
            .map(|p| (p, p * 2.0))
            .collect();
        let found = closed_form(
            &pairs,
            ScaleRange {
                low: 0.98,
                high: 1.02,
            },
        )
        .unwrap();
        assert_eq!(found.scale, 1.02);
    }

    #[test]
    fn pairs_on_a_line_have_no_closed_form() {
        let pairs: Vec<_> = (0..9)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .map(|p| (p, p))
            .collect();
        assert!(closed_form(&pairs, ScaleRange::only(1.0)).is_none());
    }
}
