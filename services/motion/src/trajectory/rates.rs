//! Limits of s from those of joints, tip and turn: the path is surveyed once, the fastest law is sought
//! within limits of s, and what it would make of joints, tip and turn is judged place by place.
//!
//! With q(s(t)): q' = q_s s', q'' = q_s s'' + q_ss s'^2, q''' = q_s s''' + 3 q_ss s' s'' + q_sss s'^3,
//! and likewise for the tip and the angle that the tool turns by. Where the law breaks a limit, the limit
//! of s that contributes most there is lowered; what is left after a few rounds is taken up by running
//! the whole law more slowly, which scales the three derivatives by 1, 2 and 3 powers and so ends within
//! all limits. One set of limits holds for the whole path: a path is as slow as its slowest place in
//! cruise, but not as slow as if its worst speed, acceleration and jerk came together.

use super::{Speeds, jump, reach};
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, largest_difference};
use crate::limits::Limits;
use crate::rcm::RcmPath;
use crate::time_law::{Rate, RateLimits, TimeLaw};
use arthro_geometry::{Point3, Rotation, Vector3};

/// A joint that moves farther in one step of the survey jumps: the way passes a singularity.
pub const JUMP_RAD: f64 = 0.4;
/// Steps in which a path is surveyed.
const STEPS: usize = 96;
/// Instants at which a law is judged, beside those where its jerk changes.
const INSTANTS: usize = 128;
/// Rounds of lowering the limits of s one by one.
const ROUNDS: usize = 6;
/// Rates slower than this, per unit of s, bind nothing.
const NO_RATE: f64 = 1e-9;

/// Six joints (rad), the tip (mm) and the angle turned by (rad).
type Sample = [f64; 10];

/// Derivatives by s at the nodes of a path.
pub struct Survey {
    first: Vec<Sample>,
    second: Vec<Sample>,
    third: Vec<Sample>,
}

/// The limits that a law is judged by: speed, acceleration, jerk.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    joint: [f64; 3],
    tip: [f64; 3],
    turn: [f64; 3],
}

impl Bounds {
    /// The limits of an arm at the speeds asked for.
    pub fn new(limits: &Limits, speeds: Speeds) -> Self {
        Self {
            joint: [
                limits.joint_speed_rad_s,
                limits.joint_acceleration_rad_s2,
                limits.joint_jerk_rad_s3,
            ],
            tip: [
                speeds.tip_mm_s,
                limits.inside_acceleration_mm_s2,
                limits.inside_jerk_mm_s3,
            ],
            turn: [
                speeds.turn_rad_s,
                limits.pivot_acceleration_rad_s2,
                limits.pivot_jerk_rad_s3,
            ],
        }
    }

    /// The largest share of any limit of this order that `values` take.
    fn share(&self, order: usize, values: &Sample) -> f64 {
        let joints = values[..6]
            .iter()
            .fold(0.0, |most: f64, v| most.max(v.abs()));
        let tip = Vector3::new(values[6], values[7], values[8]).norm();
        (joints / self.joint[order])
            .max(tip / self.tip[order])
            .max(values[9].abs() / self.turn[order])
    }
}

impl Survey {
    /// Goes along a path from the joints `start`.
    ///
    /// # Errors
    /// The path leaves the reach or the joint limits, or a joint jumps.
    pub fn of(arm: &ToolArm, path: &RcmPath, start: &Joints) -> Result<Self, Error> {
        let mut samples = Vec::with_capacity(STEPS + 1);
        let first = path.pose(0.0);
        let (mut before, mut rotation, mut turned_rad) = (*start, first.rotation(), 0.0);
        samples.push(sample(&before, &first.origin(), turned_rad));
        for index in 1..=STEPS {
            let s = index as f64 / STEPS as f64;
            let joints = reach(arm, path, s, &before)?;
            let (joint, step_rad) = largest_difference(&joints, &before);
            if !(..=JUMP_RAD).contains(&step_rad) {
                return Err(jump(joint, step_rad, s));
            }
            let pose = path.pose(s);
            turned_rad += angle_between(&rotation, &pose.rotation());
            rotation = pose.rotation();
            samples.push(sample(&joints, &pose.origin(), turned_rad));
            before = joints;
        }
        let first = derivative(&samples);
        let second = derivative(&first);
        let third = derivative(&second);
        Ok(Self {
            first,
            second,
            third,
        })
    }

    /// The fastest law found within the bounds.
    ///
    /// # Errors
    /// NO_TIMING, which finite limits do not lead to.
    pub fn law(&self, bounds: &Bounds) -> Result<TimeLaw, Error> {
        let steepest = |order: usize| {
            self.first
                .iter()
                .map(|first| bounds.share(order, first))
                .fold(NO_RATE, f64::max)
                .recip()
        };
        let mut limits = RateLimits {
            speed: steepest(0),
            acceleration: steepest(1),
            jerk: steepest(2),
        };
        let mut law = TimeLaw::new(&limits)?;
        for _ in 0..ROUNDS {
            let worst = self.judge(&law, bounds);
            if worst.iter().all(|worst| worst.share <= 1.0) {
                return Ok(law);
            }
            for (order, worst) in worst.iter().enumerate() {
                if worst.share > 1.0 {
                    worst.lower(order, &mut limits);
                }
            }
            law = TimeLaw::new(&limits)?;
        }
        let worst = self.judge(&law, bounds);
        let by = worst[0]
            .share
            .max(worst[1].share.sqrt())
            .max(worst[2].share.cbrt());
        if by <= 1.0 {
            return Ok(law);
        }
        TimeLaw::new(&limits.dilated(by))
    }

    /// Where the law takes the largest share of the limits of each order.
    fn judge(&self, law: &TimeLaw, bounds: &Bounds) -> [Worst; 3] {
        let mut worst = [Worst::default(); 3];
        let even = (0..=INSTANTS).map(|i| law.duration_s() * i as f64 / INSTANTS as f64);
        // The jerk changes at these: what holds just before is judged too.
        let changes = law
            .phases_s()
            .flat_map(|at_s| [at_s, at_s - 1e-9 * law.duration_s()]);
        for time_s in even.chain(changes) {
            let rate = law.rate(time_s.max(0.0));
            let (first, second, third) = self.at(rate.s);
            let terms = Terms::new(&rate, &first, &second, &third);
            for (order, worst) in worst.iter_mut().enumerate() {
                let share = bounds.share(order, &terms.sum(order));
                if share > worst.share {
                    *worst = Worst {
                        share,
                        by: terms.of[order].map(|term| bounds.share(order, &term)),
                    };
                }
            }
        }
        worst
    }

    /// The derivatives at `s`, linear between the nodes.
    fn at(&self, s: f64) -> (Sample, Sample, Sample) {
        let place = s.clamp(0.0, 1.0) * STEPS as f64;
        let node = (place as usize).min(STEPS - 1);
        let share = place - node as f64;
        let between = |of: &[Sample]| -> Sample {
            std::array::from_fn(|i| of[node][i] + (of[node + 1][i] - of[node][i]) * share)
        };
        (
            between(&self.first),
            between(&self.second),
            between(&self.third),
        )
    }
}

/// What the speed, the acceleration and the jerk at one instant consist of, by the derivative of s that
/// bears most on each term: its speed, its acceleration, its jerk.
struct Terms {
    of: [[Sample; 3]; 3],
}

impl Terms {
    fn new(rate: &Rate, first: &Sample, second: &Sample, third: &Sample) -> Self {
        let by = |factor: f64, of: &Sample| of.map(|value| value * factor);
        let none = [0.0; 10];
        let Rate {
            speed,
            acceleration,
            jerk,
            ..
        } = *rate;
        Self {
            of: [
                [by(speed, first), none, none],
                [by(speed * speed, second), by(acceleration, first), none],
                [
                    by(speed.powi(3), third),
                    by(3.0 * speed * acceleration, second),
                    by(jerk, first),
                ],
            ],
        }
    }

    fn sum(&self, order: usize) -> Sample {
        let [a, b, c] = &self.of[order];
        std::array::from_fn(|i| a[i] + b[i] + c[i])
    }
}

/// The worst place of one order.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    /// Of the limit.
    share: f64,
    /// The same of its terms alone.
    by: [f64; 3],
}

impl Worst {
    /// Lowers the limit of s that contributes most.
    fn lower(&self, order: usize, limits: &mut RateLimits) {
        let [speed, acceleration, jerk] = self.by;
        if jerk >= acceleration.max(speed) {
            limits.jerk /= self.share;
        } else if acceleration >= speed {
            limits.acceleration /= self.share;
        } else {
            limits.speed /= self.share.powf(1.0 / (order + 1) as f64);
        }
    }
}

fn sample(joints: &Joints, tip: &Point3, turned_rad: f64) -> Sample {
    let [a, b, c, d, e, f] = *joints;
    [a, b, c, d, e, f, tip.x, tip.y, tip.z, turned_rad]
}

/// Central differences; of second order at the ends too.
fn derivative(of: &[Sample]) -> Vec<Sample> {
    let step = 1.0 / STEPS as f64;
    let last = of.len() - 1;
    let slope = |a: &Sample, b: &Sample, c: &Sample, weights: [f64; 3]| -> Sample {
        std::array::from_fn(|i| {
            (weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i]) / (2.0 * step)
        })
    };
    (0..=last)
        .map(|index| {
            if index == 0 {
                slope(&of[0], &of[1], &of[2], [-3.0, 4.0, -1.0])
            } else if index == last {
                slope(&of[last], &of[last - 1], &of[last - 2], [3.0, -4.0, 1.0])
            } else {
                slope(&of[index - 1], &of[index], &of[index + 1], [-1.0, 0.0, 1.0])
            }
        })
        .collect()
}

/// The angle between two orientations, rad, precise also where it is tiny.
fn angle_between(a: &Rotation, b: &Rotation) -> f64 {
    let between = a.inverse() * b;
    2.0 * between.imag().norm().atan2(between.w.abs())
}
