//! The inner loop of the search, in single precision and without a branch that depends on the data's order: how far a
//! pose is off, and one step towards the surface.

use arthro_geometry::nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3 as Vector};
use arthro_geometry::{Rotation, Similarity, Vector3};

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

/// A sample of the model: position, then normal, then 1 if the normal surely points outwards.
type Sample = ([f32; 4], [f32; 4]);

/// The sparse view against the model.
pub(super) struct Kernel<'a> {
    model: &'a Model,
    samples: Vec<Sample>,
    points: Vec<[f32; 3]>,
    sight: Vec<[f32; 3]>,
    unit: f32,
    /// A distance in the view beyond which a point counts as astray, mm of the view.
    stray_view: f32,
}

/// A distance to the surface counts no more than this for a pose that is not yet drawn, units.
const FAR_UNITS: f32 = 5.0;
/// Steps towards the nearest samples, and towards their planes.
const POINT_STEPS: i32 = 4;
const PLANE_STEPS: i32 = 9;

impl<'a> Kernel<'a> {
    /// `stray_view_mm` is the distance in the view at which a point counts as astray.
    pub(super) fn new(model: &'a Model, seen: &Seen, stray_view_mm: f64) -> Self {
        let four = |v: &Vector3, last: f32| [v.x as f32, v.y as f32, v.z as f32, last];
        let three = |v: &Vector3| [v.x as f32, v.y as f32, v.z as f32];
        Self {
            samples: model
                .points
                .iter()
                .zip(&model.normals)
                .zip(&model.is_outward)
                .map(|((point, normal), is_outward)| {
                    (
                        four(&point.coords, 0.0),
                        four(normal, f32::from(u8::from(*is_outward))),
                    )
                })
                .collect(),
            points: seen.points.iter().map(|p| three(&p.coords)).collect(),
            sight: seen.sight.iter().map(three).collect(),
            unit: model.unit_mm as f32,
            stray_view: stray_view_mm as f32,
            model,
        }
    }

    /// Mean distance of the points to the model, far ones cut short, units.
    pub(super) fn mean_distance(&self, pose: &Laid) -> f32 {
        let far = FAR_UNITS * self.unit;
        let mut sum = 0.0;
        for (index, point) in self.points.iter().enumerate() {
            let q = pose.carried(point);
            let (place, normal) = &self.samples[self.model.roughly_nearest(q)];
            let d = [q[0] - place[0], q[1] - place[1], q[2] - place[2]];
            let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().min(far);
            sum += if self.looks_away(pose, index, normal) {
                far
            } else {
                distance
            };
        }
        sum / (self.points.len() as f32 * self.unit)
    }

    /// Root mean square distance of the points to the model's surface, strays cut short, mm of the view.
    pub(super) fn misfit_view_mm(&self, pose: &Laid) -> f64 {
        let stray = self.stray_view * pose.scale;
        let mut sum = 0.0;
        for (index, point) in self.points.iter().enumerate() {
            let q = pose.carried(point);
            let (place, normal) = &self.samples[self.model.roughly_nearest(q)];
            let d = [q[0] - place[0], q[1] - place[1], q[2] - place[2]];
            let height = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2];
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let beyond = ((squared - height * height).max(0.0).sqrt()
                - self.model.spacing_mm as f32)
                .max(0.0);
            let squared = (height * height + beyond * beyond).min(stray * stray);
            sum += if self.looks_away(pose, index, normal) {
                stray * stray
            } else {
                squared
            };
        }
        f64::from((sum / self.points.len() as f32).sqrt() / pose.scale)
    }

    /// The pose after some steps towards the nearest samples; its scale is kept.
    pub(super) fn drawn(&self, mut pose: Laid) -> Laid {
        for step in 0..POINT_STEPS {
            let reach = self.unit * (4.0 - 0.7 * step as f32);
            pose = self.point_step(&pose, reach);
        }
        pose
    }

    /// The pose after some steps towards the samples' planes, its scale free within `allowed`.
    pub(super) fn settled(&self, mut pose: Laid, allowed: ScaleRange) -> Laid {
        for step in 0..PLANE_STEPS {
            let reach = self.unit * 2.5 * 0.8f32.powi(step);
            match self.plane_step(&pose, reach.max(0.6 * self.unit), allowed) {
                Some(next) => pose = next,
                None => break,
            }
        }
        pose
    }

    /// Whether the camera could not have seen that side of the surface.
    #[inline]
    fn looks_away(&self, pose: &Laid, index: usize, normal: &[f32; 4]) -> bool {
        match self.sight.get(index) {
            Some(sight) => {
                let along = pose.matrix * Vector::from(*sight);
                (along.x * normal[0] + along.y * normal[1] + along.z * normal[2]) * normal[3]
                    > AVERTED as f32 * pose.scale
            }
            None => false,
        }
    }

    /// Weighted closed form of Umeyama with the scale held, Geman and McClure's weights.
    fn point_step(&self, pose: &Laid, reach: f32) -> Laid {
        let reach2 = reach * reach;
        let (mut weights, mut mean_q, mut mean_p) = (0.0f32, Vector::zeros(), Vector::zeros());
        let mut products = Matrix3::<f32>::zeros();
        for (index, point) in self.points.iter().enumerate() {
            let q = pose.carried(point);
            let (place, normal) = &self.samples[self.model.roughly_nearest(q)];
            let (q, p) = (Vector::from(q), Vector::new(place[0], place[1], place[2]));
            let share = reach2 / (reach2 + (q - p).norm_squared());
            let weight = if self.looks_away(pose, index, normal) {
                0.1
            } else {
                share * share
            };
            weights += weight;
            mean_q += q * weight;
            mean_p += p * weight;
            products.ger(weight, &p, &q, 1.0);
        }
        if weights <= 1e-6 {
            return *pose;
        }
        mean_q /= weights;
        mean_p /= weights;
        let covariance = products / weights - mean_p * mean_q.transpose();
        let turn = Rotation3::from_matrix_eps(&covariance, 1e-4, 12, Rotation3::identity());
        let matrix = turn * pose.matrix;
        Laid {
            matrix,
            shift: mean_p - turn * (mean_q - pose.shift),
            scale: pose.scale,
        }
    }

    /// Gauss-Newton over turn, shift and scale on the heights over the samples' planes.
    fn plane_step(&self, pose: &Laid, reach: f32, allowed: ScaleRange) -> Option<Laid> {
        let reach2 = reach * reach;
        // The upper triangle of the normal equations and their right side, row by row.
        let mut sums = [0.0f32; 36];
        for (index, point) in self.points.iter().enumerate() {
            let q = pose.carried(point);
            let (place, normal) = &self.samples[self.model.roughly_nearest(q)];
            let d = [q[0] - place[0], q[1] - place[1], q[2] - place[2]];
            let height = d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2];
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let share = reach2 / (reach2 + squared);
            let weight = if self.looks_away(pose, index, normal) {
                0.0
            } else {
                share * share
            };
            let row = [
                q[1] * normal[2] - q[2] * normal[1],
                q[2] * normal[0] - q[0] * normal[2],
                q[0] * normal[1] - q[1] * normal[0],
                normal[0],
                normal[1],
                normal[2],
                (q[0] - pose.shift.x) * normal[0]
                    + (q[1] - pose.shift.y) * normal[1]
                    + (q[2] - pose.shift.z) * normal[2]
                    - height,
                height,
            ];
            let mut at = 0;
            for i in 0..7 {
                let scaled = weight * row[i];
                for other in &row[i..8] {
                    sums[at] += scaled * other;
                    at += 1;
                }
            }
        }
        let mut matrix = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SVector::<f64, 7>::zeros();
        let mut at = 0;
        for i in 0..7 {
            for j in i..7 {
                matrix[(i, j)] = f64::from(sums[at]);
                matrix[(j, i)] = matrix[(i, j)];
                at += 1;
            }
            right[i] = f64::from(sums[at]);
            at += 1;
        }
        let unit = f64::from(self.unit);
        let shifts = (matrix[(3, 3)] + matrix[(4, 4)] + matrix[(5, 5)]) / 3.0;
        for i in 0..7 {
            // Turns and stretches move points by about ten units a radian.
            let arm2 = if (3..6).contains(&i) {
                1.0
            } else {
                100.0 * unit * unit
            };
            matrix[(i, i)] += 3e-3 * shifts * arm2;
        }
        let free = matrix.cholesky()?.solve(&-right);
        let wanted = f64::from(pose.scale) * free[6].clamp(-0.1, 0.1).exp();
        let scale = 1.0 / allowed.clamp(1.0 / wanted);
        let delta = if (scale / wanted - 1.0).abs() < 1e-9 {
            free
        } else {
            let stretch = (scale / f64::from(pose.scale)).ln();
            let six = matrix.fixed_view::<6, 6>(0, 0).into_owned();
            let rest = -(right.fixed_rows::<6>(0) + matrix.fixed_view::<6, 1>(0, 6) * stretch);
            let solved = six.cholesky()?.solve(&rest);
            SVector::<f64, 7>::from_fn(|i, _| if i < 6 { solved[i] } else { stretch })
        };
        let turn = Vector3::new(delta[0], delta[1], delta[2]);
        if !turn.norm().is_finite() {
            return None;
        }
        let turn = turn.cap_magnitude(0.3);
        let turn: Rotation3<f32> = Rotation3::new(turn.cast::<f32>());
        let shift: Vector<f32> = Vector3::new(delta[3], delta[4], delta[5]).cast();
        let stretch = scale as f32 / pose.scale;
        Some(Laid {
            matrix: turn * pose.matrix * stretch,
            shift: turn * pose.shift + shift,
            scale: scale as f32,
        })
    }
}

impl Laid {
    #[inline]
    fn carried(&self, point: &[f32; 3]) -> [f32; 3] {
        let m = &self.matrix;
        [0, 1, 2].map(|row| {
            m[(row, 0)] * point[0]
                + m[(row, 1)] * point[1]
                + m[(row, 2)] * point[2]
                + self.shift[row]
        })
    }

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
