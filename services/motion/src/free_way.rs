//! The way of a move outside the body with its time law: a straight line of the tool, or all joints in common time.
//! Sampled once a controller cycle, like a path through the portal.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Tool};

use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::time_law::{RateLimits, TimeLaw};

/// Steps in which a line is surveyed for joint speeds.
const SURVEY_STEPS: usize = 100;
/// A turn of the tool is taken for at least this long a way, mm a rad: a turn on the spot is no way at all.
const TURN_RADIUS_MM: f64 = 100.0;
/// Ways shorter than this are no motion, mm and rad.
const NO_MOTION: f64 = 1e-9;

/// A way outside that an arm can follow.
#[derive(Clone, Debug)]
pub struct FreeWay {
    arm: ToolArm,
    shape: Shape,
    law: Option<TimeLaw>,
}

#[derive(Clone, Debug)]
enum Shape {
    /// The tip on a straight line, the tool turning about one axis.
    Line {
        from: Rigid<Base, Tool>,
        to: Rigid<Base, Tool>,
    },
    /// Each joint in proportion.
    Joints { from: Joints, to: Joints },
}

impl FreeWay {
    /// From the tool pose at the joints `start` straight to `to`, the tip at most at `speed_mm_s`; the limits of the
    /// joints may make it slower.
    ///
    /// # Errors
    /// [`Error::OutOfReach`] or [`Error::JointLimit`] on the way.
    pub fn line(
        arm: ToolArm,
        start: &Joints,
        to: Rigid<Base, Tool>,
        speed_mm_s: f64,
        limits: &Limits,
    ) -> Result<Self, Error> {
        let from = arm.base_from_tool(start);
        let length_mm = (to.origin() - from.origin()).norm();
        let turn_rad = from.rotation().angle_to(&to.rotation());
        let way_mm = length_mm.max(turn_rad * TURN_RADIUS_MM);
        let mut way = Self {
            arm,
            shape: Shape::Line { from, to },
            law: None,
        };
        if way_mm > NO_MOTION {
            let (first_rad, second_rad) = way.survey(start)?;
            let joint_half = 0.5 * limits.joint_acceleration_rad_s2;
            let speed = (speed_mm_s / way_mm)
                .min(limits.joint_speed_rad_s / first_rad.max(NO_MOTION))
                .min((joint_half / second_rad.max(NO_MOTION)).sqrt());
            let acceleration = (limits.free_acceleration_mm_s2 / way_mm)
                .min(joint_half / first_rad.max(NO_MOTION));
            way.law = Some(law(speed, acceleration, limits)?);
        }
        Ok(way)
    }

    /// From the joints `from` to `to`, the leading joint at most at `speed_rad_s`.
    ///
    /// # Errors
    /// A time law that cannot be.
    pub fn joints(
        arm: ToolArm,
        from: &Joints,
        to: &Joints,
        speed_rad_s: f64,
        limits: &Limits,
    ) -> Result<Self, Error> {
        let (_, turn_rad) = largest_difference(from, to);
        let acceleration = limits.joint_acceleration_rad_s2;
        let law = if turn_rad > NO_MOTION {
            Some(law(
                speed_rad_s / turn_rad,
                acceleration / turn_rad,
                limits,
            )?)
        } else {
            None
        };
        Ok(Self {
            arm,
            shape: Shape::Joints {
                from: *from,
                to: *to,
            },
            law,
        })
    }

    /// Time from rest to rest, s.
    pub fn duration_s(&self) -> f64 {
        self.law.as_ref().map_or(0.0, TimeLaw::duration_s)
    }

    /// The share of the way done at `time_s`.
    pub fn fraction(&self, time_s: f64) -> f64 {
        self.law.as_ref().map_or(1.0, |law| law.at(time_s))
    }

    /// The joints at `time_s`, nearest to the sample before.
    ///
    /// # Errors
    /// [`Error::OutOfReach`] or [`Error::JointLimit`].
    pub fn sample(&self, time_s: f64, before: &Joints) -> Result<Joints, Error> {
        self.at(self.fraction(time_s), before)
    }

    fn at(&self, s: f64, before: &Joints) -> Result<Joints, Error> {
        match &self.shape {
            Shape::Joints { from, to } => Ok(std::array::from_fn(|joint| {
                from[joint] + (to[joint] - from[joint]) * s
            })),
            Shape::Line { from, to } => {
                let tip = from.origin() + (to.origin() - from.origin()) * s;
                let rotation = from.rotation().slerp(&to.rotation(), s);
                let percent = 100.0 * s;
                self.arm
                    .joints(&Rigid::new(rotation, tip.coords), before)
                    .map_err(|unreachable| match unreachable {
                        Unreachable::OutOfReach => Error::OutOfReach { percent },
                        Unreachable::JointLimit => Error::JointLimit { percent },
                    })
            }
        }
    }

    /// The largest first and second derivatives of any joint by s, rad.
    fn survey(&self, start: &Joints) -> Result<(f64, f64), Error> {
        let step = 1.0 / SURVEY_STEPS as f64;
        let (mut first_rad, mut second_rad) = (0.0_f64, 0.0_f64);
        let mut before = *start;
        let mut slope_before: Option<Joints> = None;
        for index in 1..=SURVEY_STEPS {
            let joints = self.at(index as f64 * step, &before)?;
            let slope: Joints = std::array::from_fn(|i| (joints[i] - before[i]) / step);
            first_rad = first_rad.max(largest_difference(&joints, &before).1 / step);
            if let Some(slope_before) = slope_before {
                second_rad = second_rad.max(largest_difference(&slope, &slope_before).1 / step);
            }
            slope_before = Some(slope);
            before = joints;
        }
        Ok((first_rad, second_rad))
    }
}

/// An acceleration builds up in the time that the joints' may.
fn law(speed: f64, acceleration: f64, limits: &Limits) -> Result<TimeLaw, Error> {
    let rise_s = limits.joint_acceleration_rad_s2 / limits.joint_jerk_rad_s3;
    TimeLaw::new(&RateLimits {
        speed,
        acceleration,
        jerk: acceleration / rise_s,
    })
}

#[cfg(test)]
mod tests {
    use arthro_geometry::{Rotation, Vector3};
    use proptest::prelude::*;

    use super::*;

    const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];
    const PERIOD_S: f64 = 0.008;

    fn arm() -> ToolArm {
        ToolArm::new(
            crate::kinematics::model::Model::ur5(),
            Rigid::new(
                Rotation::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2),
                Vector3::new(0.0, 0.0, 310.0),
            ),
        )
    }

    fn samples(way: &FreeWay) -> Vec<Joints> {
        let mut joints = START;
        (1..=(way.duration_s() / PERIOD_S).ceil() as usize)
            .map(|n| {
                joints = way.sample(n as f64 * PERIOD_S, &joints).unwrap();
                joints
            })
            .collect()
    }

    proptest! {
        #[test]
        fn a_line_is_straight_and_within_the_limits(
            x in -80.0..20.0f64, y in -60.0..60.0f64, z in -40.0..80.0f64, turn in -0.4..0.4f64, speed in 5.0..100.0f64,
        ) {
            let limits = Limits::default();
            let from = arm().base_from_tool(&START);
            let turned = from.rotation() * Rotation::from_axis_angle(&Vector3::y_axis(), turn);
            let to = Rigid::new(turned, from.translation_mm() + Vector3::new(x, y, z));
            let way = FreeWay::line(arm(), &START, to, speed, &limits).unwrap();
            let line = Vector3::new(x, y, z);
            let mut before = START;
            for joints in samples(&way) {
                let gone = arm().base_from_tool(&joints).origin() - from.origin();
                let beside = gone - line * (gone.dot(&line) / line.norm_squared());
                prop_assert!(beside.norm() < 1e-6, "{} mm beside the line", beside.norm());
                let step = largest_difference(&joints, &before).1;
                prop_assert!(step <= 1.02 * limits.joint_speed_rad_s * PERIOD_S, "{step} rad");
                let tip = arm().base_from_tool(&joints).origin() - arm().base_from_tool(&before).origin();
                prop_assert!(tip.norm() <= speed * PERIOD_S * (1.0 + 1e-6));
                before = joints;
            }
            let end = arm().base_from_tool(&before);
            prop_assert!((end.origin() - to.origin()).norm() < 1e-6);
        }
    }

    #[test]
    fn the_jerk_of_the_joints_is_limited_outside_too() {
        let mut to = START;
        to[0] += 0.6;
        let limits = Limits {
            joint_jerk_rad_s3: 4.0,
            ..Limits::default()
        };
        let way = FreeWay::joints(arm(), &START, &to, 0.5, &limits).unwrap();
        let joints: Vec<f64> = samples(&way).iter().map(|joints| joints[0]).collect();
        let most = joints
            .windows(4)
            .map(|q| (q[3] - 3.0 * q[2] + 3.0 * q[1] - q[0]).abs() / PERIOD_S.powi(3))
            .fold(0.0, f64::max);
        assert!((3.9..=4.01).contains(&most), "{most} rad/s3");
    }

    #[test]
    fn joints_go_in_common_time() {
        let mut to = START;
        to[0] += 0.6;
        to[3] -= 0.2;
        let way = FreeWay::joints(arm(), &START, &to, 0.5, &Limits::default()).unwrap();
        for joints in samples(&way) {
            assert!(((joints[0] - START[0]) + 3.0 * (joints[3] - START[3])).abs() < 1e-12);
        }
        assert_eq!(samples(&way).last(), Some(&to));
        assert!(way.duration_s() > 1.2);
        let none = FreeWay::joints(arm(), &START, &START, 0.5, &Limits::default()).unwrap();
        assert_eq!((none.duration_s(), none.fraction(0.0)), (0.0, 1.0));
    }
}
