//! An RCM path with its time law, checked before anything moves and then sampled once a controller
//! cycle. Every sample is verified by forward kinematics: the shaft passes the portal.

mod margins;
pub mod rates;
pub mod straight;

pub use self::margins::Margins;
use self::rates::{Bounds, JUMP_RAD, Survey};
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::rcm::{Placement, RcmPath};
use crate::time_law::TimeLaw;

/// The shaft's largest distance to where the path has it, at a sample, mm.
pub const RCM_AT_SAMPLES_MM: f64 = 1e-6;
/// The same between samples, where the joints move linearly, mm.
pub const RCM_BETWEEN_SAMPLES_MM: f64 = 0.01;
/// The widest pivot: an aim beside or behind the portal is a mistake.
const PIVOT_MAX_RAD: f64 = std::f64::consts::FRAC_PI_2;
/// Most samples that the check walks through.
const SAMPLES_WALKED: usize = 5000;
/// A walked joint speed may exceed the limit by so much: the law was judged at the nodes of a survey.
const SPEED_TOLERANCE: f64 = 1.05;

/// A path that an arm can follow.
#[derive(Clone, Debug)]
pub struct Trajectory {
    arm: ToolArm,
    path: RcmPath,
    law: Option<TimeLaw>,
    margins: Margins,
    end: Joints,
}

/// The speeds asked for; the joint limits may make it slower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speeds {
    /// Of the tip in base, mm/s.
    pub tip_mm_s: f64,
    /// Of the tool's turning, rad/s.
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
        let law = if path.is_still() {
            None
        } else {
            // Told first, because short of the boundary of the reach the joints jump.
            reach(&arm, &path, 1.0, start)?;
            let survey = Survey::of(&arm, &path, start)?;
            Some(survey.law(&Bounds::new(limits, speeds))?)
        };
        let mut trajectory = Self {
            arm,
            path,
            law,
            margins: Margins::at(&arm, start),
            end: *start,
        };
        (trajectory.margins, trajectory.end) = trajectory.walk(start, period_s)?;
        let speed_rad_s = trajectory.margins.joint_speed_rad_s;
        if !(..=SPEED_TOLERANCE * limits.joint_speed_rad_s).contains(&speed_rad_s) {
            return Err(Error::JointSpeed {
                speed_rad_s,
                limit_rad_s: limits.joint_speed_rad_s,
            });
        }
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
            let mut here = Margins::at(&self.arm, &joints);
            here.joint_speed_rad_s = step_rad / period_s;
            here.rcm_at_samples_mm = self.strays_mm(&joints, s);
            here.rcm_between_samples_mm = self.strays_mm(&middle, middle_s);
            margins = margins.worst(&here);
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

/// The joints at `s` of a path.
pub fn reach(arm: &ToolArm, path: &RcmPath, s: f64, before: &Joints) -> Result<Joints, Error> {
    arm.joints(&path.pose(s), before)
        .map_err(|unreachable| unreachable_at(unreachable, s))
}

/// The refusal of a pose at `s` of a path.
pub fn unreachable_at(unreachable: Unreachable, s: f64) -> Error {
    let percent = 100.0 * s;
    match unreachable {
        Unreachable::OutOfReach => Error::OutOfReach { percent },
        Unreachable::JointLimit => Error::JointLimit { percent },
    }
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

#[cfg(test)]
mod tests;
