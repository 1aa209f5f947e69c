//! What the motion functions of URScript command: each turns into a [`Motion`] that moves the target of the joints by one
//! controller cycle at a time.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector6};

use super::{
    kinematics::{self, Dh, Joints},
    profile::Trapezoid,
};

/// Turns an angle into the way that speed and acceleration of a linear move count: 1 rad is as 0.5 m of tool travel.
/// A model; the real controller's equivalent radius is in its configuration data.
const EQUIVALENT_RADIUS_M: f64 = 0.5;

/// The joints as commanded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Positions, rad.
    pub q: Joints,
    /// Speeds, rad/s.
    pub qd: Joints,
}

/// One running motion function.
#[derive(Clone, Debug)]
pub enum Motion {
    /// None: the target rests.
    Rest,
    /// `movej`: all joints in common time.
    Joints {
        /// Start.
        from: Joints,
        /// Goal.
        to: Joints,
        /// Way of the leading joint.
        profile: Trapezoid,
        /// Way of the leading joint in all.
        length_rad: f64,
        /// Time on the path.
        at_s: f64,
    },
    /// `movel`: a straight line with a constant rotation axis.
    Line {
        /// Base from tool at the start.
        from: Isometry3<f64>,
        /// From start to goal, in base axes.
        twist: Vector6<f64>,
        /// 0 to 1.
        profile: Trapezoid,
        /// Time on the path.
        at_s: f64,
    },
    /// `servoj`: towards the latest goal as a first-order filter.
    Servo {
        /// Latest goal.
        goal: Joints,
        /// Bandwidth, 1/s.
        rate: f64,
    },
    /// `speedj`, and with speed 0 `stopj`: joint speeds change with bounded acceleration of the leading joint.
    JointSpeed {
        /// Wanted, rad/s.
        speed: Joints,
        /// Leading joint, rad/s².
        accel: f64,
    },
    /// `speedl`, and with speed 0 `stopl`: the twist of the tool changes with bounded acceleration.
    ToolSpeed {
        /// Base from tool as commanded.
        pose: Isometry3<f64>,
        /// Present twist in base axes.
        twist: Vector6<f64>,
        /// Wanted twist.
        speed: Vector6<f64>,
        /// Per second, in the metric of [`way`].
        accel: f64,
    },
}

/// How a cycle of motion ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Goes on.
    Moving,
    /// Reached what it was for. A speed or a servo motion goes on until something replaces it.
    Reached,
    /// No joint positions for the next pose (singularity, out of reach).
    NoSolution,
}

impl Motion {
    /// `movej`; with `time_s` speed and acceleration do not matter.
    pub fn joints(from: Joints, to: Joints, speed: f64, accel: f64, time_s: f64) -> Self {
        let length_rad = largest_difference(&from, &to);
        Self::Joints {
            from,
            to,
            profile: profile(length_rad, speed, accel, time_s),
            length_rad,
            at_s: 0.0,
        }
    }

    /// `movel`; with `time_s` speed and acceleration do not matter.
    pub fn line(
        from: Isometry3<f64>,
        to: &Isometry3<f64>,
        speed: f64,
        accel: f64,
        time_s: f64,
    ) -> Self {
        let twist = kinematics::twist_between(&from, to);
        let length = way(&twist);
        if length <= 1e-12 {
            return Self::Line {
                from,
                twist,
                profile: Trapezoid::bounded(0.0, 1.0, 1.0),
                at_s: 0.0,
            };
        }
        let profile = profile(1.0, speed / length, accel / length, time_s);
        Self::Line {
            from,
            twist,
            profile,
            at_s: 0.0,
        }
    }

    /// `servoj`. The bandwidth of the model: one lookahead time as time constant at the default gain of 300.
    pub fn servo(goal: Joints, lookahead_s: f64, gain: f64) -> Self {
        Self::Servo {
            goal,
            rate: gain / 300.0 / lookahead_s,
        }
    }

    /// `speedl` or `stopl` for an arm whose target moved to `target` in a cycle of `step_s`.
    pub fn tool_speed(
        dh: &Dh,
        target: &Target,
        step_s: f64,
        flange_from_tool: &Isometry3<f64>,
        speed: Vector6<f64>,
        accel: f64,
    ) -> Self {
        // From the last cycle's way, not the Jacobian: along a line the way is exact, the Jacobian at its end is not.
        let before = each(|joint| target.q[joint] - target.qd[joint] * step_s);
        let pose = dh.flange(&target.q) * flange_from_tool;
        let twist =
            kinematics::twist_between(&(dh.flange(&before) * flange_from_tool), &pose) / step_s;
        Self::ToolSpeed {
            pose,
            twist,
            speed,
            accel,
        }
    }

    /// Moves the target by `dt` s of the path's own time; positions change within `dt_real` s.
    pub fn advance(
        &mut self,
        dh: &Dh,
        target: &mut Target,
        flange_from_tool: &Isometry3<f64>,
        dt: f64,
        dt_real: f64,
    ) -> Progress {
        match self {
            Self::Rest => {
                target.qd = [0.0; 6];
                Progress::Reached
            }
            Self::Joints {
                from,
                to,
                profile,
                length_rad,
                at_s,
            } => {
                *at_s += dt;
                let reached = *at_s >= profile.duration_s();
                let share = if *length_rad > 0.0 {
                    profile.at(*at_s) / *length_rad
                } else {
                    1.0
                };
                let next = if reached {
                    *to
                } else {
                    each(|joint| from[joint] + (to[joint] - from[joint]) * share)
                };
                target.step_to(next, dt_real);
                if reached {
                    Progress::Reached
                } else {
                    Progress::Moving
                }
            }
            Self::Line {
                from,
                twist,
                profile,
                at_s,
            } => {
                *at_s += dt;
                let share = if way(twist) <= 1e-12 {
                    1.0
                } else {
                    profile.at(*at_s)
                };
                let pose = kinematics::moved(from, &(*twist * share));
                let Some(next) = dh.inverse(&pose, flange_from_tool, &target.q) else {
                    return Progress::NoSolution;
                };
                target.step_to(next, dt_real);
                if *at_s >= profile.duration_s() {
                    Progress::Reached
                } else {
                    Progress::Moving
                }
            }
            Self::Servo { goal, rate } => {
                let share = 1.0 - (-*rate * dt).exp();
                let next = each(|joint| target.q[joint] + (goal[joint] - target.q[joint]) * share);
                target.step_to(next, dt_real);
                Progress::Reached
            }
            Self::JointSpeed { speed, accel } => {
                let missing = largest_difference(&target.qd, speed);
                let share = if missing <= *accel * dt_real {
                    1.0
                } else {
                    *accel * dt_real / missing
                };
                let before = target.qd;
                target.qd = each(|joint| before[joint] + (speed[joint] - before[joint]) * share);
                // A speed that the slider slows is covered in path time.
                target.q =
                    each(|joint| target.q[joint] + 0.5 * (before[joint] + target.qd[joint]) * dt);
                if share >= 1.0 {
                    Progress::Reached
                } else {
                    Progress::Moving
                }
            }
            Self::ToolSpeed {
                pose,
                twist,
                speed,
                accel,
            } => {
                let missing = way(&(*speed - *twist));
                let share = if missing <= *accel * dt_real {
                    1.0
                } else {
                    *accel * dt_real / missing
                };
                let before = *twist;
                *twist += (*speed - before) * share;
                *pose = kinematics::moved(pose, &((before + *twist) * (0.5 * dt)));
                let Some(next) = dh.inverse(pose, flange_from_tool, &target.q) else {
                    return Progress::NoSolution;
                };
                target.step_to(next, dt_real);
                let reached = share >= 1.0;
                if reached && way(speed) == 0.0 {
                    target.qd = [0.0; 6];
                }
                if reached {
                    Progress::Reached
                } else {
                    Progress::Moving
                }
            }
        }
    }
}

impl Target {
    /// At rest.
    pub fn resting(q: Joints) -> Self {
        Self { q, qd: [0.0; 6] }
    }

    fn step_to(&mut self, next: Joints, dt: f64) {
        self.qd = each(|joint| (next[joint] - self.q[joint]) / dt);
        self.q = next;
    }
}

/// The pose between two poses, as `interpolate_pose` gives it.
pub fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    let rotation = (to.rotation * from.rotation.inverse()).scaled_axis() * share;
    let position = from.translation.vector.lerp(&to.translation.vector, share);
    Isometry3::from_parts(
        Translation3::from(position),
        UnitQuaternion::from_scaled_axis(rotation) * from.rotation,
    )
}

/// Largest difference of one joint.
pub fn largest_difference(a: &Joints, b: &Joints) -> f64 {
    a.iter()
        .zip(b)
        .fold(0.0, |largest: f64, (a, b)| largest.max((a - b).abs()))
}

/// Length of a twist (or of its rate) as the speed and acceleration of a linear move count it.
fn way(twist: &Vector6<f64>) -> f64 {
    let linear = twist.fixed_rows::<3>(0).norm();
    let angular = twist.fixed_rows::<3>(3).norm();
    linear.max(angular * EQUIVALENT_RADIUS_M)
}

fn profile(length: f64, speed: f64, accel: f64, time_s: f64) -> Trapezoid {
    if time_s > 0.0 {
        Trapezoid::timed(length, time_s)
    } else {
        Trapezoid::bounded(length, speed, accel)
    }
}

fn each(value: impl FnMut(usize) -> f64) -> Joints {
    std::array::from_fn(value)
}
