//! Denavit-Hartenberg tables, nominal and of one calibrated arm, and the chain that any table makes.
//!
//! Standard convention, as the controller's KINEMATICS_INFO has it: joint i turns about z by
//! `q + theta`, moves along z by `d`, along the new x by `a` and turns about it by `alpha`.
//! A calibration describes nearly parallel axes by lengths `d` of several metres that cancel and by
//! angles `theta` that may be large; only the whole chain is near the drawing's.

use arthro_geometry::Vector3;
use arthro_geometry::nalgebra::{Matrix3, Matrix6};
use serde::{Deserialize, Serialize};

use super::flange_pose::FlangePose;
use super::links::Links;
use super::{Joints, jacobian_of};

/// A table, or differences of one, joint by joint from base to wrist 3.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dh {
    /// Added to each joint angle, rad.
    pub theta_rad: [f64; 6],
    /// Along the turned x axis, mm.
    pub a_mm: [f64; 6],
    /// Along the joint's axis, mm.
    pub d_mm: [f64; 6],
    /// From a joint's axis to the next about x, rad.
    pub alpha_rad: [f64; 6],
}

impl Dh {
    /// Of an arm as drawn.
    pub fn nominal(links: &Links) -> Self {
        use std::f64::consts::FRAC_PI_2;
        Self {
            theta_rad: [0.0; 6],
            a_mm: [0.0, links.a2_mm, links.a3_mm, 0.0, 0.0, 0.0],
            d_mm: [links.d1_mm, 0.0, 0.0, links.d4_mm, links.d5_mm, links.d6_mm],
            alpha_rad: [FRAC_PI_2, 0.0, 0.0, FRAC_PI_2, -FRAC_PI_2, 0.0],
        }
    }

    /// With differences added number by number: those of the controller's file calibration.conf.
    pub fn plus(&self, deltas: &Self) -> Self {
        let sum = |a: &[f64; 6], b: &[f64; 6]| std::array::from_fn(|i| a[i] + b[i]);
        Self {
            theta_rad: sum(&self.theta_rad, &deltas.theta_rad),
            a_mm: sum(&self.a_mm, &deltas.a_mm),
            d_mm: sum(&self.d_mm, &deltas.d_mm),
            alpha_rad: sum(&self.alpha_rad, &deltas.alpha_rad),
        }
    }

    /// The first number that is none, by field and joint from 1.
    pub fn not_finite(&self) -> Option<(&'static str, usize)> {
        let fields = [
            ("theta_rad", &self.theta_rad),
            ("a_mm", &self.a_mm),
            ("d_mm", &self.d_mm),
            ("alpha_rad", &self.alpha_rad),
        ];
        fields.into_iter().find_map(|(name, values)| {
            let joint = values.iter().position(|value| !value.is_finite())?;
            Some((name, joint + 1))
        })
    }
}

/// The links of a table, ready for computing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain {
    dh: Dh,
    sin_alpha: [f64; 6],
    cos_alpha: [f64; 6],
}

impl Chain {
    /// Of a table of finite numbers.
    pub fn new(dh: Dh) -> Self {
        Self {
            dh,
            sin_alpha: dh.alpha_rad.map(f64::sin),
            cos_alpha: dh.alpha_rad.map(f64::cos),
        }
    }

    /// The table.
    pub fn dh(&self) -> &Dh {
        &self.dh
    }

    /// The flange at the given joints.
    pub fn forward(&self, joints: &Joints) -> FlangePose {
        self.walk(joints, |_, _| ())
    }

    /// The flange, and its velocity in base axes, `[v mm/s; w rad/s] = J q'`.
    pub fn forward_and_jacobian(&self, joints: &Joints) -> (FlangePose, Matrix6<f64>) {
        let mut pivots = [(Vector3::zeros(), Vector3::zeros()); 6];
        let mut next = pivots.iter_mut();
        let flange = self.walk(joints, |axis, origin| {
            if let Some(pivot) = next.next() {
                *pivot = (axis, origin);
            }
        });
        (flange, jacobian_of(&pivots, &flange.origin_mm))
    }

    /// Goes from base to flange and shows the axis of each joint and a point on it.
    fn walk(&self, joints: &Joints, mut visit: impl FnMut(Vector3, Vector3)) -> FlangePose {
        let (mut x, mut y, mut z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let mut origin = Vector3::zeros();
        for (i, joint) in joints.iter().enumerate() {
            visit(z, origin);
            let (s, c) = (joint + self.dh.theta_rad[i]).sin_cos();
            let across = y * c - x * s;
            x = x * c + y * s;
            origin += z * self.dh.d_mm[i] + x * self.dh.a_mm[i];
            y = across * self.cos_alpha[i] + z * self.sin_alpha[i];
            z = z * self.cos_alpha[i] - across * self.sin_alpha[i];
        }
        FlangePose {
            rotation: Matrix3::from_columns(&[x, y, z]),
            origin_mm: origin,
        }
    }
}
