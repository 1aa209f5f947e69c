//! The inner loop of the search, in single precision and without a branch that depends on the data's order: how far a
//! pose is off, and one step towards the surface.

use arthro_geometry::{Rotation, Similarity, Vector3};
use nalgebra::{Matrix3, Rotation3, Vector3 as Vector};

use super::equations::Equations;
use crate::contact::AVERTED;
use crate::model::Model;
use crate::problem;
use crate::scale::ScaleRange;
use crate::view::Seen;

/// `ct_from_view` about the centres of both: q = scaled_rotation y + shift.
#[derive(Clone, Copy, Debug)]
pub(super) struct Laid {
    matrix: Matrix3<f32>,
    shift: Vector<f32>,
    scale: f32,
}

/// A sample of the model.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Sample {
    place: Vector<f32>,
    normal: Vector<f32>,
    /// 1 if the normal surely points outwards, else 0.
    outward: f32,
}

/// A view point carried to the model, and the sample that it meets there.
struct Meeting {
    at: Vector<f32>,
    place: Vector<f32>,
    normal: Vector<f32>,
    distance2: f32,
    height: f32,
    /// Whether the camera could not have seen that side of the surface.
    is_averted: bool,
}

/// The sparse view against the model.
pub(super) struct Kernel<'a> {
    model: &'a Model,
    samples: Vec<Sample>,
    points: Vec<Vector<f32>>,
    sight: Vec<Vector<f32>>,
    unit: f32,
    /// A distance in the view beyond which a point counts as astray, mm of the view.
    stray_view: f32,
}

/// A distance to the surface counts no more than this for a pose that is not yet drawn, units.
const FAR_UNITS: f32 = 5.0;
/// Steps towards the nearest samples; the reach of their weights at first, and how much less it is after each, units.
const POINT_STEPS: i32 = 4;
const POINT_REACH_UNITS: f32 = 4.0;
const POINT_REACH_LESS_UNITS: f32 = 0.7;
/// Steps towards the samples' planes; the reach of their weights at first, what is left of it after each, and the least.
const PLANE_STEPS: i32 = 9;
const PLANE_REACH_UNITS: f32 = 2.5;
const PLANE_REACH_DECAY: f32 = 0.8;
const LEAST_REACH_UNITS: f32 = 0.6;
/// What a point counts on a side that the camera did not see: enough to be drawn off it.
const AVERTED_WEIGHT: f32 = 0.1;
/// Damping as a share of what holds the shifts; turns and stretches move points by about so many units a radian.
const DAMPING: f64 = 3e-3;
const ARM_UNITS: f64 = 10.0;
/// A step turns by no more than this, rad.
const LARGEST_TURN_RAD: f64 = 0.3;

impl<'a> Kernel<'a> {
    /// `stray_view_mm` is the distance in the view at which a point counts as astray.
    pub(super) fn new(model: &'a Model, seen: &Seen, stray_view_mm: f64) -> Self {
        let sample = |index: usize| Sample {
            place: model.points[index].coords.cast(),
            normal: model.normals[index].cast(),
            outward: f32::from(u8::from(model.is_outward[index])),
        };
        Self {
            samples: (0..model.points.len()).map(sample).collect(),
            points: seen.points.iter().map(|p| p.coords.cast()).collect(),
            sight: seen.sight.iter().map(|sight| sight.cast()).collect(),
            unit: model.unit_mm as f32,
            stray_view: stray_view_mm as f32,
            model,
        }
    }

    /// Mean distance of the points to the model, far ones cut short, units.
    pub(super) fn mean_distance(&self, pose: &Laid) -> f32 {
        let far = FAR_UNITS * self.unit;
        let sum: f32 = (0..self.points.len())
            .map(|index| self.meeting(pose, index))
            .map(|met| {
                if met.is_averted {
                    far
                } else {
                    met.distance2.sqrt().min(far)
                }
            })
            .sum();
        sum / (self.points.len() as f32 * self.unit)
    }

    /// Root mean square distance of the points to the model's surface, strays cut short, mm of the view.
    pub(super) fn misfit_view_mm(&self, pose: &Laid) -> f64 {
        let stray2 = (self.stray_view * pose.scale).powi(2);
        let spacing = self.model.spacing_mm as f32;
        let sum: f32 = (0..self.points.len())
            .map(|index| self.meeting(pose, index))
            .map(|met| {
                let height2 = met.height * met.height;
                let beyond = ((met.distance2 - height2).max(0.0).sqrt() - spacing).max(0.0);
                let is_stray = met.is_averted || height2 + beyond * beyond > stray2;
                if is_stray {
                    stray2
                } else {
                    height2 + beyond * beyond
                }
            })
            .sum();
        f64::from((sum / self.points.len() as f32).sqrt() / pose.scale)
    }

    /// The pose after some steps towards the nearest samples; its scale is kept.
    pub(super) fn drawn(&self, mut pose: Laid) -> Laid {
        for step in 0..POINT_STEPS {
            let reach = self.unit * (POINT_REACH_UNITS - POINT_REACH_LESS_UNITS * step as f32);
            pose = self.point_step(&pose, reach);
        }
        pose
    }

    /// The pose after some steps towards the samples' planes, its scale free within `allowed`.
    pub(super) fn settled(&self, mut pose: Laid, allowed: ScaleRange) -> Laid {
        for step in 0..PLANE_STEPS {
            let reach = PLANE_REACH_UNITS * PLANE_REACH_DECAY.powi(step);
            match self.plane_step(&pose, self.unit * reach.max(LEAST_REACH_UNITS), allowed) {
                Some(next) => pose = next,
                None => break,
            }
        }
        pose
    }

    /// Weighted closed form of Umeyama with the scale held.
    fn point_step(&self, pose: &Laid, reach: f32) -> Laid {
        let (mut weights, mut mean_q, mut mean_p) = (0.0f32, Vector::zeros(), Vector::zeros());
        let mut products = Matrix3::<f32>::zeros();
        for index in 0..self.points.len() {
            let met = self.meeting(pose, index);
            let weight = if met.is_averted {
                AVERTED_WEIGHT
            } else {
                met.weight(reach)
            };
            weights += weight;
            mean_q += met.at * weight;
            mean_p += met.place * weight;
            products.ger(weight, &met.place, &met.at, 1.0);
        }
        if weights <= f32::EPSILON {
            return *pose;
        }
        mean_q /= weights;
        mean_p /= weights;
        let covariance = products / weights - mean_p * mean_q.transpose();
        let turn = Rotation3::from_matrix_eps(&covariance, 1e-4, 12, Rotation3::identity());
        Laid {
            matrix: turn * pose.matrix,
            shift: mean_p - turn * (mean_q - pose.shift),
            scale: pose.scale,
        }
    }

    /// Gauss-Newton over turn, shift and scale on the heights over the samples' planes.
    fn plane_step(&self, pose: &Laid, reach: f32, allowed: ScaleRange) -> Option<Laid> {
        // The upper triangle of the normal equations and their right side, row by row.
        let mut sums = [0.0f32; 35];
        for index in 0..self.points.len() {
            let met = self.meeting(pose, index);
            if met.is_averted {
                continue;
            }
            let weight = met.weight(reach);
            let turn = met.at.cross(&met.normal);
            // Residuals are weighed in the view's length, which a growing model does not shrink.
            let stretch = (met.at - pose.shift).dot(&met.normal) - met.height;
            let n = met.normal;
            let row = [turn.x, turn.y, turn.z, n.x, n.y, n.z, stretch, met.height];
            let mut at = 0;
            for i in 0..7 {
                let scaled = weight * row[i];
                for other in &row[i..] {
                    sums[at] += scaled * other;
                    at += 1;
                }
            }
        }
        let (step, scale) = self
            .equations(&sums)
            .solved(f64::from(pose.scale), allowed)?;
        let turn = Vector3::new(step[0], step[1], step[2]).cap_magnitude(LARGEST_TURN_RAD);
        let turn: Rotation3<f32> = Rotation3::new(turn.cast::<f32>());
        let shift: Vector<f32> = Vector3::new(step[3], step[4], step[5]).cast();
        Some(Laid {
            matrix: turn * pose.matrix * (scale as f32 / pose.scale),
            shift: turn * pose.shift + shift,
            scale: scale as f32,
        })
    }

    /// The sums in double precision, damped so that a direction that few points hold does not run away.
    fn equations(&self, sums: &[f32; 35]) -> Equations {
        let mut equations = Equations::zeros();
        let mut at = 0;
        for i in 0..7 {
            for j in i..7 {
                equations.information[(i, j)] = f64::from(sums[at]);
                equations.information[(j, i)] = equations.information[(i, j)];
                at += 1;
            }
            equations.gradient[i] = f64::from(sums[at]);
            at += 1;
        }
        let shifts: f64 = (3..6).map(|i| equations.information[(i, i)]).sum::<f64>() / 3.0;
        let arm = ARM_UNITS * f64::from(self.unit);
        for i in 0..7 {
            let arm2 = if (3..6).contains(&i) { 1.0 } else { arm * arm };
            equations.information[(i, i)] += DAMPING * shifts * arm2;
        }
        equations
    }

    /// A view point carried to the model.
    #[inline(always)]
    fn meeting(&self, pose: &Laid, index: usize) -> Meeting {
        let at = pose.matrix * self.points[index] + pose.shift;
        let sample = &self.samples[self.model.roughly_nearest(at.into())];
        let offset = at - sample.place;
        let is_averted = match self.sight.get(index) {
            Some(sight) => {
                let along = (pose.matrix * sight).dot(&sample.normal);
                along * sample.outward > AVERTED as f32 * pose.scale
            }
            None => false,
        };
        Meeting {
            at,
            place: sample.place,
            normal: sample.normal,
            distance2: offset.norm_squared(),
            height: offset.dot(&sample.normal),
            is_averted,
        }
    }
}

impl Meeting {
    /// Geman and McClure's weight: one nearby, a fourth at `reach`, next to nothing beyond.
    #[inline(always)]
    fn weight(&self, reach: f32) -> f32 {
        let share = reach * reach / (reach * reach + self.distance2);
        share * share
    }
}

impl Laid {
    /// In double precision, the rotation made unit.
    pub(super) fn similarity(&self) -> problem::Pose {
        let matrix: Matrix3<f64> = self.matrix.cast();
        let rotation = Rotation3::from_matrix_eps(&matrix, 1e-12, 50, Rotation3::identity());
        Similarity::new(
            f64::from(self.scale),
            Rotation::from_rotation_matrix(&rotation),
            self.shift.cast(),
        )
    }
}

impl From<&problem::Pose> for Laid {
    fn from(pose: &problem::Pose) -> Self {
        let matrix = pose.rotation.to_rotation_matrix().into_inner() * pose.scale;
        Self {
            matrix: matrix.cast(),
            shift: pose.translation_mm.cast(),
            scale: pose.scale as f32,
        }
    }
}
