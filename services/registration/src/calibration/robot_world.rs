//! The equation behind both hand-eye calibrations, `A X = Z B` of four frames: the arm measures `A`, the camera
//! measures `B`, and the mountings `X` and `Z` are refined together.
//!
//! With the camera beside the arm and the board on the flange, `A` is base_from_flange, `X` flange_from_board, `Z`
//! base_from_camera and `B` camera_from_board. With the camera on the flange, `X` is flange_from_camera, `Z`
//! base_from_board and `B` board_from_camera.

use arthro_geometry::Vector3;
use arthro_geometry::nalgebra::{Isometry3, Matrix3, Matrix6, SMatrix, SVector, Vector6};

use super::closed_form::{MotionPair, daniilidis, shah};
use super::noise::{PoseCovariance, blocks, moved};
use super::robust::Problem;

/// Motions that turn by nearly half a turn are left out of pairs: noise flips the sign of their axis, rad.
const TURN_MAX_RAD: f64 = 3.0;
/// Millimetres that a radian stands for when starts are compared, if the camera is nearer than this.
const LEVER_MIN_MM: f64 = 10.0;

/// What one pose says.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation {
    /// By the arm.
    pub a: Isometry3<f64>,
    /// By the camera.
    pub b: Isometry3<f64>,
    /// Stated covariances of `a` and `b`.
    pub noise: Option<(PoseCovariance, PoseCovariance)>,
}

/// The two mountings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mountings {
    /// On the body that the arm moves.
    pub x: Isometry3<f64>,
    /// On the body that stands still.
    pub z: Isometry3<f64>,
}

/// Which mounting pairs of motions are solved for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// The moving one.
    X,
    /// The standing one.
    Z,
}

/// All poses.
#[derive(Clone, Debug)]
pub(super) struct RobotWorld {
    /// One a pose.
    pub equations: Vec<Equation>,
    /// How far from the camera the board is, median, mm.
    lever_mm: f64,
}

impl RobotWorld {
    /// Of these poses.
    pub fn new(equations: Vec<Equation>) -> Self {
        let mut distances: Vec<f64> = equations
            .iter()
            .map(|equation| equation.b.translation.vector.norm())
            .collect();
        distances.sort_by(f64::total_cmp);
        let median = distances.get(distances.len() / 2).copied();
        Self {
            equations,
            lever_mm: median.unwrap_or(0.0).max(LEVER_MIN_MM),
        }
    }

    /// Relative motions of all pairs of these poses, `a W = W b` for the wanted mounting `W`.
    pub fn pairs(&self, poses: &[usize], wanted: Wanted) -> Vec<MotionPair> {
        let mut pairs = Vec::new();
        for (rank, first) in poses.iter().enumerate() {
            for second in &poses[rank + 1..] {
                let (one, other) = (&self.equations[*first], &self.equations[*second]);
                let pair = match wanted {
                    Wanted::X => MotionPair {
                        a: other.a.inverse() * one.a,
                        b: other.b.inverse() * one.b,
                    },
                    Wanted::Z => MotionPair {
                        a: other.a * one.a.inverse(),
                        b: other.b * one.b.inverse(),
                    },
                };
                if pair.a.rotation.angle() < TURN_MAX_RAD {
                    pairs.push(pair);
                }
            }
        }
        pairs
    }

    /// Both mountings by Shah's closed form.
    pub fn shah(&self, poses: &[usize]) -> Option<Mountings> {
        let measured: Vec<_> = poses
            .iter()
            .map(|index| (self.equations[*index].a, self.equations[*index].b))
            .collect();
        let [x, z] = shah::solve(&measured)?;
        Some(Mountings { x, z })
    }
}

impl Problem<12, 6> for RobotWorld {
    type State = Mountings;
    const GROUP: usize = 3;
    const SUBSET: usize = 5;

    fn len(&self) -> usize {
        self.equations.len()
    }

    fn starts(&self, poses: &[usize]) -> Vec<Mountings> {
        let by_shah = self.shah(poses);
        // Daniilidis gives Z alone; the first pose tells X from it, and refinement does the rest.
        let by_daniilidis = (poses.len() == self.len())
            .then(|| daniilidis_of(&self.pairs(poses, Wanted::Z)))
            .flatten()
            .map(|z| Mountings {
                x: self.equations[0].a.inverse() * z * self.equations[0].b,
                z,
            });
        by_shah.into_iter().chain(by_daniilidis).collect()
    }

    fn lever_mm(&self, group: usize) -> f64 {
        [self.lever_mm, 1.0][group.min(1)]
    }

    /// Rotation vector (rad), then displacement (mm), of `A X` against `Z B`.
    fn residual(&self, index: usize, state: &Mountings) -> Vector6<f64> {
        let Equation { a, b, .. } = &self.equations[index];
        let (one, other) = (a * state.x, state.z * b);
        let rotation = (one.rotation * other.rotation.inverse()).scaled_axis();
        let displacement = one.translation.vector - other.translation.vector;
        Vector6::from_iterator(rotation.iter().chain(displacement.iter()).copied())
    }

    fn jacobian(&self, index: usize, state: &Mountings) -> SMatrix<f64, 6, 12> {
        let Equation { a, b, .. } = &self.equations[index];
        let rotation = self.residual(index, state).fixed_rows::<3>(0).into_owned();
        let a_turn = a.rotation.to_rotation_matrix().into_inner();
        let lever = (state.z.rotation * b.translation.vector).cross_matrix();
        let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
        jacobian
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(left_inverse(&rotation) * a_turn));
        jacobian
            .fixed_view_mut::<3, 3>(0, 6)
            .copy_from(&-left_inverse(&-rotation));
        jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&a_turn);
        jacobian.fixed_view_mut::<3, 3>(3, 6).copy_from(&lever);
        jacobian
            .fixed_view_mut::<3, 3>(3, 9)
            .copy_from(&-Matrix3::identity());
        jacobian
    }

    fn covariance(&self, index: usize, state: &Mountings) -> Option<Matrix6<f64>> {
        let Equation { a, noise, .. } = &self.equations[index];
        let (by_arm, by_camera) = noise.as_ref()?;
        // An error of the arm's rotation swings what is mounted on it.
        let lever = (a.rotation * state.x.translation.vector).cross_matrix();
        let eye = Matrix3::identity();
        let from_arm = blocks(&eye, &Matrix3::zeros(), &-lever, &eye);
        let z_turn = state.z.rotation.to_rotation_matrix().into_inner();
        let from_camera = blocks(&z_turn, &Matrix3::zeros(), &Matrix3::zeros(), &z_turn);
        Some(
            from_arm * by_arm * from_arm.transpose()
                + from_camera * by_camera * from_camera.transpose(),
        )
    }

    fn moved(&self, state: &Mountings, step: &SVector<f64, 12>) -> Mountings {
        let part = |first: usize| -> Vector3 { step.fixed_rows::<3>(first).into_owned() };
        Mountings {
            x: moved(&state.x, part(0), part(3)),
            z: moved(&state.z, part(6), part(9)),
        }
    }
}

/// Daniilidis' closed form in the unit of the motions themselves.
pub(super) fn daniilidis_of(pairs: &[MotionPair]) -> Option<Isometry3<f64>> {
    daniilidis::solve(pairs, daniilidis::length_unit_mm(pairs))
}

/// Inverse of the left Jacobian of the rotation group, to the second order: residuals are small where it matters.
fn left_inverse(rotation: &Vector3) -> Matrix3<f64> {
    let skew = rotation.cross_matrix();
    Matrix3::identity() - skew * 0.5 + skew * skew / 12.0
}
