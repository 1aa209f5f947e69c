//! The UR5 (CB3) with its nominal Denavit-Hartenberg parameters: forward kinematics, Jacobian and the
//! analytic inverse with all of its up to eight branches.
//!
//! Frames: `Base` and `Flange`, mm and rad. With the vertical plane of the upper arm and forearm
//! spanned by `e_r = (c1, s1, 0)` and z, and `n = (s1, -c1, 0)` the axis of joints 2, 3 and 4:
//!
//! ```text
//! wrist  = (a2 c2 + a3 c23) e_r + (d1 + a2 s2 + a3 s23) z + d4 n
//! x4     = c234 e_r + s234 z          z4 = s234 e_r - c234 z
//! x5     = c5 x4 + s5 n               z6 = c5 n - s5 x4
//! x6     = c6 x5 - s6 z4              y6 = -s6 x5 - c6 z4
//! flange = wrist + d5 z4 + d6 z6
//! ```

use std::f64::consts::{PI, TAU};

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::{Matrix3, Matrix6, Rotation3, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Vector3};

use super::Joints;

/// Number of distinct inverse branches: shoulder, wrist and elbow, two each.
pub const BRANCHES: usize = 8;

/// Joint travel, rad: all joints turn a full turn either way; the elbow half a turn, beyond which
/// the forearm would pass through the upper arm.
pub const LIMITS_RAD: Joints = [TAU, TAU, PI, TAU, TAU, TAU];

const D1: f64 = 89.159;
const A2: f64 = -425.0;
const A3: f64 = -392.25;
const D4: f64 = 109.15;
const D5: f64 = 94.65;
const D6: f64 = 82.3;

/// How far outside its reach a pose is still taken for rounding, as a cosine or mm.
const ROUNDING: f64 = 1e-9;
/// Below this sine of joint 5 the wrist is singular: joints 4 and 6 turn about one axis and the
/// pose fixes only their sum. It is small because taking joint 6 from elsewhere turns the flange by
/// as much as this sine.
const WRIST_SINGULAR_SINE: f64 = 1e-13;

/// `base_from_flange` at the given joints.
pub fn forward(joints: &Joints) -> Rigid<Base, Flange> {
    let axes = Axes::at(joints);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
        axes.x6,
        axes.z6.cross(&axes.x6),
        axes.z6,
    ]));
    Rigid::new(
        UnitQuaternion::from_rotation_matrix(&rotation),
        axes.flange.coords,
    )
}

/// Velocity of the flange in base axes, `[v mm/s; w rad/s] = J q'`.
pub fn jacobian(joints: &Joints) -> Matrix6<f64> {
    let axes = Axes::at(joints);
    let shoulder = Point3::new(0.0, 0.0, D1);
    let pivots = [
        (Vector3::z(), Point3::origin()),
        (axes.n, shoulder),
        (axes.n, axes.elbow),
        (axes.n, axes.wrist),
        (axes.z4, axes.wrist),
        (axes.z6, axes.flange),
    ];
    let mut jacobian = Matrix6::zeros();
    for (column, (axis, origin)) in pivots.into_iter().enumerate() {
        let linear = axis.cross(&(axes.flange - origin));
        jacobian
            .fixed_view_mut::<3, 1>(0, column)
            .copy_from(&linear);
        jacobian.fixed_view_mut::<3, 1>(3, column).copy_from(&axis);
    }
    jacobian
}

/// The inverse solutions of one pose: at most [`BRANCHES`], each in (-pi, pi].
#[derive(Clone, Copy, Debug, Default)]
pub struct Solutions {
    joints: [Joints; BRANCHES],
    count: usize,
}

impl Solutions {
    /// The solutions found.
    pub fn as_slice(&self) -> &[Joints] {
        &self.joints[..self.count]
    }

    /// The solution nearest to `reference`, each joint taken by whole turns to where it is nearest
    /// within its limits. `None` when there is none within the limits.
    pub fn nearest(&self, reference: &Joints) -> Option<Joints> {
        self.as_slice()
            .iter()
            .filter_map(|solution| unwind(solution, reference))
            .map(|joints| (squared_distance(&joints, reference), joints))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, joints)| joints)
    }

    fn push(&mut self, joints: Joints) {
        self.joints[self.count] = joints;
        self.count += 1;
    }
}

/// All joint angles that reach `base_from_flange`; none when it is out of reach.
///
/// Where the wrist is singular, joint 6 is taken from `reference`, the previous sample.
pub fn inverse(base_from_flange: &Rigid<Base, Flange>, reference: &Joints) -> Solutions {
    let mut solutions = Solutions::default();
    let rotation = base_from_flange.rotation().to_rotation_matrix();
    let matrix = rotation.matrix();
    let (x6, y6, z6) = (matrix.column(0), matrix.column(1), matrix.column(2));
    // The centre of the wrist's last bend; its distance to the plane of the arm is d4.
    let p5 = base_from_flange.translation_mm() - z6 * D6;
    let radius = (p5.x * p5.x + p5.y * p5.y).sqrt();
    if radius < D4 - ROUNDING {
        return solutions;
    }
    let bearing = p5.y.atan2(p5.x);
    let offset = ((radius - D4).max(0.0) * (radius + D4)).sqrt().atan2(D4);
    for shoulder in [offset, -offset] {
        // p5 . n = d4, so the bearing of n, which is q1 - pi/2, lies `offset` beside that of p5.
        let q1 = wrap_once(bearing + shoulder + PI / 2.0);
        let (s1, c1) = q1.sin_cos();
        let n = Vector3::new(s1, -c1, 0.0);
        let (nx, ny, nz) = (n.dot(&x6), n.dot(&y6), n.dot(&z6));
        let sine = (nx * nx + ny * ny).sqrt();
        let q5 = sine.atan2(nz);
        let (q6, s6, c6) = if sine < WRIST_SINGULAR_SINE {
            let (s6, c6) = reference[5].sin_cos();
            (wrap(reference[5]), s6, c6)
        } else {
            ((-ny).atan2(nx), -ny / sine, nx / sine)
        };
        let z4 = -(x6 * s6 + y6 * c6);
        let x4 = (x6 * c6 - y6 * s6) * nz - z6 * sine;
        let q234 = x4.z.atan2(x4.x * c1 + x4.y * s1);
        // The other bend of the wrist turns x4 and z4 round.
        for (q234, z4, q5, q6) in [
            (q234, z4, q5, q6),
            (half_turn(q234), -z4, -q5, half_turn(q6)),
        ] {
            let p4 = p5 - z4 * D5;
            let reach = p4.x * c1 + p4.y * s1;
            let height = p4.z - D1;
            let cosine = (reach * reach + height * height - A2 * A2 - A3 * A3) / (2.0 * A2 * A3);
            if cosine.abs() > 1.0 + ROUNDING {
                continue;
            }
            let cosine = cosine.clamp(-1.0, 1.0);
            let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
            let bend = sine.atan2(cosine);
            let elevation = height.atan2(reach);
            let forearm = (A3 * sine).atan2(A2 + A3 * cosine);
            for (q3, forearm) in [(bend, forearm), (-bend, -forearm)] {
                let q2 = wrap_once(elevation - forearm);
                solutions.push([q1, q2, q3, wrap_once(q234 - q2 - q3), q5, q6]);
            }
        }
    }
    solutions
}

/// The smallest distance of any joint to its limit, rad; negative beyond it.
pub fn limit_margin_rad(joints: &Joints) -> f64 {
    joints
        .iter()
        .zip(LIMITS_RAD)
        .map(|(joint, limit)| limit - joint.abs())
        .fold(f64::INFINITY, f64::min)
}

/// Where the axes and joints of the arm are, in base.
struct Axes {
    n: Vector3,
    z4: Vector3,
    x6: Vector3,
    z6: Vector3,
    elbow: Point3,
    wrist: Point3,
    flange: Point3,
}

impl Axes {
    fn at(joints: &Joints) -> Self {
        let (s1, c1) = joints[0].sin_cos();
        let (s2, c2) = joints[1].sin_cos();
        let (s23, c23) = (joints[1] + joints[2]).sin_cos();
        let (s234, c234) = (joints[1] + joints[2] + joints[3]).sin_cos();
        let (s5, c5) = joints[4].sin_cos();
        let (s6, c6) = joints[5].sin_cos();
        let e_r = Vector3::new(c1, s1, 0.0);
        let n = Vector3::new(s1, -c1, 0.0);
        let z = Vector3::z();
        let elbow = Point3::from(e_r * (A2 * c2) + z * (D1 + A2 * s2));
        let wrist = elbow + e_r * (A3 * c23) + z * (A3 * s23) + n * D4;
        let x4 = e_r * c234 + z * s234;
        let z4 = e_r * s234 - z * c234;
        let x5 = x4 * c5 + n * s5;
        let z6 = n * c5 - x4 * s5;
        Self {
            n,
            z4,
            x6: x5 * c6 - z4 * s6,
            z6,
            elbow,
            wrist,
            flange: wrist + z4 * D5 + z6 * D6,
        }
    }
}

/// Each joint by whole turns to where it is nearest to `reference` within its limits.
fn unwind(solution: &Joints, reference: &Joints) -> Option<Joints> {
    let mut joints = *solution;
    for ((joint, reference), limit) in joints.iter_mut().zip(reference).zip(LIMITS_RAD) {
        let turns = ((reference - *joint) / TAU).round();
        *joint = [turns, turns - 1.0, turns + 1.0]
            .map(|turns| *joint + turns * TAU)
            .into_iter()
            .filter(|angle| angle.abs() <= limit)
            .min_by(|a, b| (a - reference).abs().total_cmp(&(b - reference).abs()))?;
    }
    Some(joints)
}

fn squared_distance(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The opposite of an angle in (-pi, pi], likewise.
fn half_turn(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// The same angle in (-pi, pi], of one in (-3 pi, 3 pi].
fn wrap_once(angle: f64) -> f64 {
    if angle > PI {
        angle - TAU
    } else if angle <= -PI {
        angle + TAU
    } else {
        angle
    }
}

/// The same angle in (-pi, pi].
fn wrap(angle: f64) -> f64 {
    angle - TAU * ((angle - PI) / TAU).ceil()
}

#[cfg(test)]
mod tests;
