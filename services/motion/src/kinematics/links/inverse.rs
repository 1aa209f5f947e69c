//! The analytic inverse of an arm as drawn, with all of its up to eight branches.
//!
//! The centre `p5` of the last bend is known from the pose. Joint 1 follows from `p5 . n = d4`, joints 5 and 6
//! from `n` seen from the flange, the sum of joints 2 to 4 from what is left of the orientation, and the elbow
//! from the triangle of upper arm and forearm. Sines and cosines are carried along, and each angle is taken
//! from both at the end: no arccosine, whose precision fails where branches meet.

use std::f64::consts::{PI, TAU};

use arthro_geometry::Vector3;
use arthro_geometry::nalgebra::Vector2;

use super::Links;
use crate::kinematics::flange_pose::FlangePose;
use crate::kinematics::solutions::Solutions;

/// How far outside its reach a pose is still taken for rounding, mm; its solutions miss it by no more.
const ROUNDING_MM: f64 = 2e-10;
/// The sine of joint 5 below which the wrist is singular: joints 4 and 6 turn about one axis and the pose fixes
/// only their sum. It is small because taking joint 6 from elsewhere turns the flange by as much.
const WRIST_SINGULAR_SINE: f64 = 1e-13;
/// What taking joint 6 from elsewhere may turn the flange by where it makes the elbow reach, rad.
const TURN_ROUNDING: f64 = 1e-12;

/// How much joints may miss a pose, for starts of an iteration.
#[derive(Clone, Copy, Debug)]
pub(in crate::kinematics) struct Leeway {
    /// How far out of reach a pose may be, mm.
    pub reach_mm: f64,
    /// Least distance of the last bend to the shoulder's singularity, mm.
    pub shoulder_mm: f64,
    /// Least distance of joint 3 to 0 and half a turn, rad.
    pub elbow_rad: f64,
    /// Added to joint 6, rad.
    pub q6_rad: f64,
}

impl Leeway {
    const NONE: Self = Self {
        reach_mm: ROUNDING_MM,
        shoulder_mm: 0.0,
        elbow_rad: 0.0,
        q6_rad: 0.0,
    };
}

impl Links {
    /// All joint angles that reach a pose, each in -pi .. pi; none when it is out of reach. Branches that
    /// meet at a singularity are all listed.
    ///
    /// Where the wrist is singular, joint 6 is `singular_q6_rad`, that of the sample before, or the nearest
    /// to it with which the elbow reaches.
    pub fn inverse(&self, flange: &FlangePose, singular_q6_rad: f64) -> Solutions {
        self.inverse_with(flange, singular_q6_rad, &Leeway::NONE)
    }

    /// The same, or joints that nearly reach.
    #[inline(always)]
    pub(in crate::kinematics) fn inverse_with(
        &self,
        flange: &FlangePose,
        singular_q6_rad: f64,
        leeway: &Leeway,
    ) -> Solutions {
        let mut solutions = Solutions::default();
        let rotation = &flange.rotation;
        let (x6, y6, z6) = (rotation.column(0), rotation.column(1), rotation.column(2));
        let p5 = self.last_bend(flange);
        // n has length 1 and p5 . n = d4: along p5 and across it, seen from above, it has these parts.
        let radius = (p5.x * p5.x + p5.y * p5.y).sqrt();
        if !(self.d4_mm - leeway.reach_mm..).contains(&radius) {
            return solutions;
        }
        let across = ((radius - self.d4_mm).max(0.0) * (radius + self.d4_mm)).sqrt();
        let across = across.max(leeway.shoulder_mm);
        let scale = 1.0 / (radius * (self.d4_mm * self.d4_mm + across * across).sqrt());
        for across in [across, -across] {
            let n = Vector3::new(
                (self.d4_mm * p5.x - across * p5.y) * scale,
                (self.d4_mm * p5.y + across * p5.x) * scale,
                0.0,
            );
            let (s1, c1) = (n.x, -n.y);
            let in_plane = |v: Vector3| Vector2::new(v.x * c1 + v.y * s1, v.z);
            let q1 = s1.atan2(c1);
            let (nx, ny, nz) = (n.dot(&x6), n.dot(&y6), n.dot(&z6));
            let sine = (nx * nx + ny * ny).sqrt();
            let q5 = sine.atan2(nz);
            let (q6, s6, c6) = if sine >= WRIST_SINGULAR_SINE && leeway.q6_rad == 0.0 {
                ((-ny).atan2(nx), -ny / sine, nx / sine)
            } else {
                let drawn = if sine < WRIST_SINGULAR_SINE {
                    singular_q6_rad
                } else {
                    (-ny).atan2(nx)
                };
                let (s6, c6) = (drawn + leeway.q6_rad).sin_cos();
                (s6.atan2(c6), s6, c6)
            };
            let x4 = in_plane((x6 * c6 - y6 * s6) * nz - z6 * sine);
            let q234 = x4.y.atan2(x4.x);
            let z4 = in_plane(-(x6 * s6 + y6 * c6));
            let last_bend = in_plane(p5.coords) - Vector2::new(0.0, self.d1_mm);
            // The other bend of the wrist turns x4 and z4 round.
            for (q234, z4, q5, q6) in [
                (q234, z4, q5, q6),
                (half_turn(q234), -z4, -q5, half_turn(q6)),
            ] {
                let mut turned = 0.0;
                let mut bends = self.bends(&(last_bend - z4 * self.d5_mm), leeway);
                if bends.is_none() {
                    turned = self.turn_to_reach(&last_bend, &z4);
                    if turned.abs() * sine <= TURN_ROUNDING {
                        let (s, c) = turned.sin_cos();
                        let z4 = Vector2::new(c * z4.x - s * z4.y, s * z4.x + c * z4.y);
                        bends = self.bends(&(last_bend - z4 * self.d5_mm), leeway);
                    }
                }
                for (q2, q3) in bends.into_iter().flatten() {
                    let q4 = wrap_once(wrap_once(q234 + turned) - q2 - q3);
                    // Where joints 4 and 6 turn about one axis, one makes up for the other.
                    let q6 = wrap_once(q6 - turned * nz.signum());
                    solutions.push([q1, q2, q3, q4, q5, q6]);
                }
            }
        }
        solutions
    }

    /// Joints 2 and 3, elbow one way and the other, that bring the wrist to a place in the plane of the arm,
    /// seen from the shoulder; none if it is out of reach.
    #[inline(always)]
    fn bends(&self, wrist: &Vector2<f64>, leeway: &Leeway) -> Option<[(f64, f64); 2]> {
        let (a2, a3) = (self.a2_mm, self.a3_mm);
        let squared = wrist.norm_squared();
        let (shortest, longest) = self.reach_mm();
        let reach = shortest - leeway.reach_mm..=longest + leeway.reach_mm;
        if !reach.contains(&squared.sqrt()) {
            return None;
        }
        let cosine = ((squared - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)).clamp(-1.0, 1.0);
        let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
        let q3 = sine.atan2(cosine);
        let q3 = q3.max(leeway.elbow_rad).min(PI - leeway.elbow_rad);
        // The wrist seen from the upper arm, once with the elbow turned one way and once the other.
        let (along, across) = (a2 + a3 * cosine, a3 * sine);
        let q2 = |across: f64| {
            (along * wrist.y - across * wrist.x).atan2(along * wrist.x + across * wrist.y)
        };
        Some([(q2(across), q3), (q2(-across), -q3)])
    }

    /// The least turn of the wrist's second axis `z4` about the last bend that brings the wrist into reach of
    /// the elbow, or as near as it gets, rad.
    #[cold]
    fn turn_to_reach(&self, last_bend: &Vector2<f64>, z4: &Vector2<f64>) -> f64 {
        let (shortest, longest) = self.reach_mm();
        let distance = last_bend.norm();
        // |last_bend - d5 z4|^2 by the angle between them.
        let cosine_at = |reach: f64| {
            (distance * distance + self.d5_mm * self.d5_mm - reach * reach)
                / (2.0 * distance * self.d5_mm)
        };
        let angle = last_bend.perp(z4).atan2(last_bend.dot(z4));
        // Not clamp, which does not bear bounds that are no numbers.
        let cosine = angle.cos().max(cosine_at(longest)).min(cosine_at(shortest));
        cosine.clamp(-1.0, 1.0).acos().copysign(angle) - angle
    }

    /// The least and the largest distance of wrist and shoulder in the plane of the arm, mm.
    fn reach_mm(&self) -> (f64, f64) {
        let (upper, fore) = (self.a2_mm.abs(), self.a3_mm.abs());
        ((upper - fore).abs(), upper + fore)
    }
}

/// The opposite of an angle in -pi .. pi, likewise.
fn half_turn(angle: f64) -> f64 {
    if angle > 0.0 { angle - PI } else { angle + PI }
}

/// The same angle in -pi .. pi, of one in -3 pi .. 3 pi.
fn wrap_once(angle: f64) -> f64 {
    if angle > PI {
        angle - TAU
    } else if angle < -PI {
        angle + TAU
    } else {
        angle
    }
}
