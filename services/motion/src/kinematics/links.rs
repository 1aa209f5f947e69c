//! The arm as its drawing has it: six lengths, forward kinematics and Jacobian; [`inverse`] goes back.
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

pub mod inverse;

use arthro_geometry::nalgebra::{Matrix3, Matrix6};
use arthro_geometry::{Point3, Vector3};

use super::flange_pose::FlangePose;
use super::{Joints, jacobian_of};

/// The lengths that differ between the sizes of the arm; every other Denavit-Hartenberg length is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Links {
    /// Height of the shoulder above the base, mm.
    pub d1_mm: f64,
    /// Upper arm, mm; negative by the manufacturer's convention.
    pub a2_mm: f64,
    /// Forearm, mm; negative likewise.
    pub a3_mm: f64,
    /// From the plane of the arm to the wrist, mm.
    pub d4_mm: f64,
    /// Between the bends of the wrist, mm.
    pub d5_mm: f64,
    /// From the last bend to the flange, mm.
    pub d6_mm: f64,
}

impl Links {
    /// The flange at the given joints.
    pub fn forward(&self, joints: &Joints) -> FlangePose {
        let axes = self.axes(joints);
        FlangePose {
            rotation: Matrix3::from_columns(&[axes.x6, axes.y6, axes.z6]),
            origin_mm: axes.flange,
        }
    }

    /// Velocity of the flange in base axes, `[v mm/s; w rad/s] = J q'`.
    pub fn jacobian(&self, joints: &Joints) -> Matrix6<f64> {
        let axes = self.axes(joints);
        let shoulder = Vector3::z() * self.d1_mm;
        let pivots = [
            (Vector3::z(), Vector3::zeros()),
            (axes.n, shoulder),
            (axes.n, axes.elbow),
            (axes.n, axes.wrist),
            (axes.z4, axes.wrist),
            (axes.z6, axes.flange),
        ];
        jacobian_of(&pivots, &axes.flange)
    }

    /// The centre of the wrist's last bend, where the axes of joints 5 and 6 meet.
    pub fn last_bend(&self, flange: &FlangePose) -> Point3 {
        Point3::from(flange.origin_mm - flange.rotation.column(2) * self.d6_mm)
    }

    fn axes(&self, joints: &Joints) -> Axes {
        let (s1, c1) = joints[0].sin_cos();
        let (s2, c2) = joints[1].sin_cos();
        let (s23, c23) = (joints[1] + joints[2]).sin_cos();
        let (s234, c234) = (joints[1] + joints[2] + joints[3]).sin_cos();
        let (s5, c5) = joints[4].sin_cos();
        let (s6, c6) = joints[5].sin_cos();
        let n = Vector3::new(s1, -c1, 0.0);
        let in_plane = |along: f64, up: f64| Vector3::new(c1 * along, s1 * along, up);
        let elbow = in_plane(self.a2_mm * c2, self.d1_mm + self.a2_mm * s2);
        let wrist = elbow + in_plane(self.a3_mm * c23, self.a3_mm * s23) + n * self.d4_mm;
        let x4 = in_plane(c234, s234);
        let z4 = in_plane(s234, -c234);
        let x5 = x4 * c5 + n * s5;
        let z6 = n * c5 - x4 * s5;
        Axes {
            n,
            z4,
            x6: x5 * c6 - z4 * s6,
            y6: -(x5 * s6 + z4 * c6),
            z6,
            elbow,
            wrist,
            flange: wrist + z4 * self.d5_mm + z6 * self.d6_mm,
        }
    }
}

/// Where the axes and joints of the arm are, in base.
struct Axes {
    n: Vector3,
    z4: Vector3,
    x6: Vector3,
    y6: Vector3,
    z6: Vector3,
    elbow: Vector3,
    wrist: Vector3,
    flange: Vector3,
}
