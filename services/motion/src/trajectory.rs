//! An RCM path with its time law, checked before anything moves and then sampled once a controller
//! cycle. Every sample is verified by forward kinematics: the shaft passes the portal.

mod lag;
mod margins;
pub mod rates;
pub mod straight;

pub use self::margins::Margins;
use self::rates::{Bounds, JUMP_RAD, Survey};
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};
use crate::limits::Limits;
use crate::rcm::{Placement, RcmPath};
use crate::roll::profile::Search;
use crate::time_law::TimeLaw;

/// The shaft's largest distance to where the path has it, at a sample, mm.
pub const RCM_AT_SAMPLES_MM: f64 = 1e-6;
/// The same between samples, where the joints move linearly, mm.
pub const RCM_BETWEEN_SAMPLES_MM: f64 = 0.01;
/// The widest pivot: an aim beside or behind the portal is a mistake.
const PIVOT_MAX_RAD: f64 = std::f64::consts::FRAC_PI_2;
/// Samples that the check walks through at first. Joints that move linearly between fewer samples stray
/// farther, so a walk that finds them near enough speaks for every sample; else it walks through more.
const SAMPLES_WALKED: usize = 128;
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

/// [`Trajectory::plan`] or [`Trajectory::plan_rolling`].
pub type PlanTrajectory =
    fn(ToolArm, RcmPath, &Joints, &Limits, Speeds, f64) -> Result<Trajectory, Error>;

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
        must_not_turn_too_far(&path)?;
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

    /// The same with the roll about the shaft chosen along the way: tip and shaft are those of `path`.
    ///
    /// # Errors
    /// NO_ROLL where no roll leads on, and whatever the rolled path is refused for.
    pub fn plan_rolling(
        arm: ToolArm,
        path: RcmPath,
        start: &Joints,
        limits: &Limits,
        speeds: Speeds,
        period_s: f64,
    ) -> Result<Self, Error> {
        must_not_turn_too_far(&path)?;
        let profile = Search::default().profile(&arm, |s| path.pose(s), start)?;
        Self::plan(arm, path.rolled(profile), start, limits, speeds, period_s)
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

    /// Goes through samples and the middles between them, no closer than `period_s`.
    fn walk(&self, start: &Joints, period_s: f64) -> Result<(Margins, Joints), Error> {
        let all = (self.duration_s() / period_s).ceil().max(1.0) as usize;
        let mut samples = SAMPLES_WALKED.min(all);
        loop {
            let found = self.walk_through(
                start,
                samples,
                period_s.max(self.duration_s() / samples as f64),
            )?;
            let strays_mm = found.0.rcm_between_samples_mm;
            if (..=RCM_BETWEEN_SAMPLES_MM).contains(&strays_mm) {
                return Ok(found);
            }
            if samples >= all {
                return Err(Error::RcmDeviation {
                    deviation_mm: strays_mm,
                    limit_mm: RCM_BETWEEN_SAMPLES_MM,
                });
            }
            samples = all.min(2 * samples);
        }
    }

    fn walk_through(
        &self,
        start: &Joints,
        samples: usize,
        period_s: f64,
    ) -> Result<(Margins, Joints), Error> {
        let mut margins = self.margins;
        let mut before = *start;
        for sample in 1..=samples {
            let time_s = sample as f64 * period_s;
            let s = self.fraction(time_s);
            let joints = self.sample(time_s, &before)?;
            let (joint, step_rad) = largest_difference(&joints, &before);
            if !(..=JUMP_RAD).contains(&step_rad) {
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
        Ok((margins, before))
    }

    /// How much farther the shaft is from the portal than the path has it at `s`, mm.
    fn strays_mm(&self, joints: &Joints, s: f64) -> f64 {
        let base_from_tool = self.arm.base_from_tool(joints);
        let deviation_mm = Placement::of(&base_from_tool, &self.path.portal()).deviation_mm();
        (deviation_mm - self.path.planned_deviation_mm(s)).abs()
    }
}

fn must_not_turn_too_far(path: &RcmPath) -> Result<(), Error> {
    let turn_rad = path.turn_rad();
    if (..=PIVOT_MAX_RAD).contains(&turn_rad) {
        return Ok(());
    }
    Err(Error::TurnTooWide {
        turn_rad,
        limit_rad: PIVOT_MAX_RAD,
    })
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
