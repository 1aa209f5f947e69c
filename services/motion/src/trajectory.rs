//! An RCM path with its time law, checked before anything moves and then sampled once a controller
//! cycle. Every sample is verified by forward kinematics: the shaft passes the portal.

use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::rcm::{Placement, RcmPath};
use crate::time_law::{RateLimits, TimeLaw};

/// The shaft's largest distance to where the path has it, at a sample, mm.
pub const RCM_AT_SAMPLES_MM: f64 = 1e-6;
/// The same between samples, where the joints move linearly, mm.
pub const RCM_BETWEEN_SAMPLES_MM: f64 = 0.01;
/// The widest pivot: an aim beside or behind the portal is a mistake.
const PIVOT_MAX_RAD: f64 = std::f64::consts::FRAC_PI_2;
/// A joint that moves farther in one step of the survey jumps: the way passes a singularity.
const JUMP_RAD: f64 = 0.4;
/// Steps in which a path is surveyed for joint speeds.
const SURVEY_STEPS: usize = 100;
/// Most samples that the check walks through.
const SAMPLES_WALKED: usize = 5000;
/// Time in which an acceleration builds up, s: jerk = acceleration / this.
const ACCELERATION_RISE_S: f64 = 0.1;
/// Paths shorter than this are no motion, mm and rad.
const NO_MOTION: f64 = 1e-9;

/// A path that an arm can follow.
#[derive(Clone, Debug)]
pub struct Trajectory {
    arm: ToolArm,
    path: RcmPath,
    law: Option<TimeLaw>,
    margins: Margins,
    end: Joints,
}

/// What the check of a trajectory found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Smallest distance of any joint to its limit, rad.
    pub joint_limit_rad: f64,
    /// Largest distance of the shaft to where the path has it, at samples, mm.
    pub rcm_at_samples_mm: f64,
    /// The same halfway between samples with joints moving linearly, mm.
    pub rcm_between_samples_mm: f64,
    /// Largest joint speed, rad/s.
    pub joint_speed_rad_s: f64,
}

/// The speeds asked for; the joint limits may make it slower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    /// Of the tip along the shaft, mm/s.
    pub tip_mm_s: f64,
    /// Of the turn, rad/s.
    pub turn_rad_s: f64,
}

impl Trajectory {
    /// Plans the timing of `path` from the joints `start` and walks through all of its samples.
    pub fn plan(
        arm: ToolArm,
        path: RcmPath,
        start: &Joints,
        limits: &Limits,
        speeds: Speeds,
        period_s: f64,
    ) -> Result<Self, Error> {
        if path.turn_rad() > PIVOT_MAX_RAD {
            return Err(Error::TurnTooWide {
                turn_rad: path.turn_rad(),
                limit_rad: PIVOT_MAX_RAD,
            });
        }
        let law = if path.travel_mm().max(path.turn_rad()) < NO_MOTION {
            None
        } else {
            // Told first, because short of the boundary of the reach the joints jump.
            reach(&arm, &path, 1.0, start)?;
            let steepness = survey(&arm, &path, start)?;
            Some(TimeLaw::new(&rate_limits(
                &path, limits, speeds, &steepness,
            )))
        };
        let mut trajectory = Self {
            arm,
            path,
            law,
            margins: Margins {
                joint_limit_rad: arm.limit_margin_rad(start),
                rcm_at_samples_mm: 0.0,
                rcm_between_samples_mm: 0.0,
                joint_speed_rad_s: 0.0,
            },
            end: *start,
        };
        (trajectory.margins, trajectory.end) = trajectory.walk(start, period_s)?;
        Ok(trajectory)
    }

    /// The joints at its end.
    pub fn end(&self) -> Joints {
        self.end
    }

    /// What the check found.
    pub fn margins(&self) -> Margins {
        self.margins
    }

    /// Time from rest to rest, s.
    pub fn duration_s(&self) -> f64 {
        self.law.map_or(0.0, |law| law.duration_s())
    }

    /// The share of the path done at `time_s`.
    pub fn fraction(&self, time_s: f64) -> f64 {
        self.law.map_or(1.0, |law| law.at(time_s))
    }

    /// The path.
    pub fn path(&self) -> &RcmPath {
        &self.path
    }

    /// The joints at `time_s`, nearest to the sample before.
    pub fn sample(&self, time_s: f64, before: &Joints) -> Result<Joints, Error> {
        let s = self.fraction(time_s);
        let joints = reach(&self.arm, &self.path, s, before)?;
        let deviation_mm = self.strays_mm(&joints, s);
        if deviation_mm > RCM_AT_SAMPLES_MM {
            return Err(Error::RcmDeviation {
                deviation_mm,
                limit_mm: RCM_AT_SAMPLES_MM,
            });
        }
        Ok(joints)
    }

    /// Goes through all samples and the middles between them.
    fn walk(&self, start: &Joints, period_s: f64) -> Result<(Margins, Joints), Error> {
        let mut margins = self.margins;
        let mut before = *start;
        // Fewer samples of a very slow path lie farther apart, which is judged more strictly.
        let samples = ((self.duration_s() / period_s).ceil() as usize).min(SAMPLES_WALKED);
        let period_s = period_s.max(self.duration_s() / samples.max(1) as f64);
        for sample in 1..=samples {
            let time_s = sample as f64 * period_s;
            let s = self.fraction(time_s);
            let joints = self.sample(time_s, &before)?;
            let (joint, step_rad) = largest_difference(&joints, &before);
            if step_rad > JUMP_RAD {
                return Err(jump(joint, step_rad, s));
            }
            let middle_s = self.fraction(time_s - 0.5 * period_s);
            let middle = std::array::from_fn(|i| 0.5 * (joints[i] + before[i]));
            margins.joint_speed_rad_s = margins.joint_speed_rad_s.max(step_rad / period_s);
            margins.joint_limit_rad = margins
                .joint_limit_rad
                .min(self.arm.limit_margin_rad(&joints));
            margins.rcm_at_samples_mm = margins.rcm_at_samples_mm.max(self.strays_mm(&joints, s));
            margins.rcm_between_samples_mm = margins
                .rcm_between_samples_mm
                .max(self.strays_mm(&middle, middle_s));
            before = joints;
        }
        if margins.rcm_between_samples_mm > RCM_BETWEEN_SAMPLES_MM {
            return Err(Error::RcmDeviation {
                deviation_mm: margins.rcm_between_samples_mm,
                limit_mm: RCM_BETWEEN_SAMPLES_MM,
            });
        }
        Ok((margins, before))
    }

    /// How much farther the shaft is from the portal than the path has it at `s`, mm.
    fn strays_mm(&self, joints: &Joints, s: f64) -> f64 {
        let base_from_tool = self.arm.base_from_tool(joints);
        let deviation_mm = Placement::of(&base_from_tool, &self.path.portal()).deviation_mm();
        (deviation_mm - self.path.planned_deviation_mm(s)).abs()
    }
}

impl Margins {
    /// The worse of two, number by number.
    pub fn worst(&self, other: &Self) -> Self {
        Self {
            joint_limit_rad: self.joint_limit_rad.min(other.joint_limit_rad),
            rcm_at_samples_mm: self.rcm_at_samples_mm.max(other.rcm_at_samples_mm),
            rcm_between_samples_mm: self
                .rcm_between_samples_mm
                .max(other.rcm_between_samples_mm),
            joint_speed_rad_s: self.joint_speed_rad_s.max(other.joint_speed_rad_s),
        }
    }
}

/// The joints at `s` of a path.
pub fn reach(arm: &ToolArm, path: &RcmPath, s: f64, before: &Joints) -> Result<Joints, Error> {
    let percent = 100.0 * s;
    arm.joints(&path.pose(s), before)
        .map_err(|unreachable| match unreachable {
            Unreachable::OutOfReach => Error::OutOfReach { percent },
            Unreachable::JointLimit => Error::JointLimit { percent },
        })
}

/// The refusal of a jump of the joint with this index.
pub fn jump(joint: usize, jump_rad: f64, s: f64) -> Error {
    Error::JointJump {
        joint: joint + 1,
        jump_rad,
        limit_rad: JUMP_RAD,
        percent: 100.0 * s,
    }
}

/// The largest first and second derivatives of any joint by s.
struct Steepness {
    first_rad: f64,
    second_rad: f64,
}

fn survey(arm: &ToolArm, path: &RcmPath, start: &Joints) -> Result<Steepness, Error> {
    let step = 1.0 / SURVEY_STEPS as f64;
    let mut steepness = Steepness {
        first_rad: 0.0,
        second_rad: 0.0,
    };
    let mut before = *start;
    let mut slope_before: Option<Joints> = None;
    for index in 1..=SURVEY_STEPS {
        let s = index as f64 * step;
        let joints = reach(arm, path, s, &before)?;
        let (joint, step_rad) = largest_difference(&joints, &before);
        if step_rad > JUMP_RAD {
            return Err(jump(joint, step_rad, s));
        }
        let slope = std::array::from_fn(|i| (joints[i] - before[i]) / step);
        steepness.first_rad = steepness.first_rad.max(step_rad / step);
        if let Some(slope_before) = slope_before {
            let (_, change) = largest_difference(&slope, &slope_before);
            steepness.second_rad = steepness.second_rad.max(change / step);
        }
        slope_before = Some(slope);
        before = joints;
    }
    Ok(steepness)
}

/// Limits of s from those of tip, turn and joints. With q(s(t)), q' = dq/ds s' and
/// q'' = dq/ds s'' + d2q/ds2 s'^2; each term of q'' gets half of the joint's acceleration.
fn rate_limits(
    path: &RcmPath,
    limits: &Limits,
    speeds: Speeds,
    steepness: &Steepness,
) -> RateLimits {
    let per = |limit: f64, extent: f64| limit / extent.max(NO_MOTION);
    let (travel_mm, turn_rad) = (path.travel_mm(), path.turn_rad());
    let joint_half = 0.5 * limits.joint_acceleration_rad_s2;
    let speed = per(speeds.tip_mm_s, travel_mm)
        .min(per(speeds.turn_rad_s, turn_rad))
        .min(per(limits.joint_speed_rad_s, steepness.first_rad))
        .min(per(joint_half, steepness.second_rad).sqrt());
    let acceleration = per(limits.inside_acceleration_mm_s2, travel_mm)
        .min(per(limits.pivot_acceleration_rad_s2, turn_rad))
        .min(per(joint_half, steepness.first_rad));
    RateLimits {
        speed,
        acceleration,
        jerk: acceleration / ACCELERATION_RISE_S,
    }
}

#[cfg(test)]
mod tests;
