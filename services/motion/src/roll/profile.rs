//! The roll along a whole path: chosen once, before the first motion, so that joints stay far from their limits and the
//! arm from its singularities.
//!
//! A dynamic program over a grid of path positions and rolls. A place costs `((1 - m) / m)^2` by its margin `m`
//! ([`Comfort::margin`]), which grows without bound towards a limit; a change of roll costs a little, so that
//! nothing rolls for nothing. The rolls found are the control points of a uniform cubic B-spline, whose second derivative
//! is continuous and which stays between them; the smooth profile is walked again at a finer step and its
//! least margin told.
//!
//! The grid is that of the arm as drawn, whose inverse is ten times as fast; a calibrated arm is some millimetres from it.
//! What is walked in the end is the arm as it is.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Tool};

use super::{Comfort, rolled};
use crate::kinematics::{Joints, ToolArm, Unreachable, largest_difference};

/// How finely and how far is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// Pieces of the path.
    pub pieces: usize,
    /// Step of the roll, rad.
    pub step_rad: f64,
    /// Farthest roll from the pose at the start either way, rad.
    pub most_rad: f64,
    /// Distances that are far enough.
    pub comfort: Comfort,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            pieces: 24,
            step_rad: 0.1,
            most_rad: 2.0,
            comfort: Comfort::default(),
        }
    }
}

/// The roll over s = 0 .. 1, 0 at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    controls_rad: Vec<f64>,
    margin: f64,
    end: Joints,
}

/// Why no roll takes the arm along the path.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoRoll {
    /// Not even the start is reached from the joints given.
    #[error("the start of the path is not where the joints are")]
    Start,
    /// The path cannot be followed farther whatever the roll.
    #[error(
        "no roll within {most_rad:.2} rad takes the arm farther than {percent:.0} % of the path: {}",
        match why { Unreachable::OutOfReach => "out of reach", Unreachable::JointLimit => "beyond a joint limit" }
    )]
    Ends {
        /// Where on the path.
        percent: f64,
        /// Farthest roll searched, rad.
        most_rad: f64,
        /// What ended the last way.
        why: Unreachable,
    },
}

impl NoRoll {
    /// The stable word.
    pub fn reason(&self) -> &'static str {
        "NO_ROLL"
    }
}

/// A joint that moves farther between two neighbours of the grid jumps to another branch, rad.
const JUMP_RAD: f64 = 0.4;
/// Rolls that one piece of the path may change by, in steps.
const STEPS_A_PIECE: usize = 2;
/// Cost of one step of roll on one piece.
const ROLL_COST: f64 = 0.01;
/// Places at which a piece of the smooth profile is walked.
const WALKED_A_PIECE: usize = 4;

#[derive(Clone, Copy)]
struct Place {
    cost: f64,
    joints: Joints,
    from: usize,
}

impl Search {
    /// The profile for `path`, which gives the unrolled tool at s = 0 .. 1, from the joints at its start.
    pub fn profile(
        &self,
        arm: &ToolArm,
        path: impl Fn(f64) -> Rigid<Base, Tool>,
        start: &Joints,
    ) -> Result<Profile, NoRoll> {
        let pieces = self.pieces.max(1);
        let reach = (self.most_rad / self.step_rad).floor().clamp(0.0, 1e4) as usize;
        let roll_rad = |index: usize| (index as f64 - reach as f64) * self.step_rad;
        let joints = arm.joints(&path(0.0), start).map_err(|_| NoRoll::Start)?;
        if largest_difference(&joints, start).1 > JUMP_RAD {
            return Err(NoRoll::Start);
        }
        let drawn = arm.drawn();
        let drawn_joints = drawn
            .joints(&path(0.0), &joints)
            .map_err(|_| NoRoll::Start)?;
        let mut stages: Vec<Vec<Option<Place>>> = Vec::with_capacity(pieces + 1);
        let mut first = vec![None; 2 * reach + 1];
        first[reach] = Some(Place {
            cost: 0.0,
            joints: drawn_joints,
            from: reach,
        });
        stages.push(first);
        for piece in 1..=pieces {
            let s = piece as f64 / pieces as f64;
            let pose = path(s);
            let before = &stages[piece - 1];
            let mut why = Unreachable::OutOfReach;
            let stage: Vec<Option<Place>> = (0..before.len())
                .map(|index| {
                    let pose = rolled(&pose, roll_rad(index));
                    self.best(&drawn, &pose, before, index, &mut why)
                })
                .collect();
            if stage.iter().all(Option::is_none) {
                return Err(NoRoll::Ends {
                    percent: 100.0 * (piece - 1) as f64 / pieces as f64,
                    most_rad: self.most_rad,
                    why,
                });
            }
            stages.push(stage);
        }
        let controls_rad = backwards(&stages).into_iter().map(roll_rad).collect();
        self.walk(arm, path, &joints, controls_rad)
    }

    /// The cheapest way to one place from those before it.
    fn best(
        &self,
        arm: &ToolArm,
        pose: &Rigid<Base, Tool>,
        before: &[Option<Place>],
        index: usize,
        why: &mut Unreachable,
    ) -> Option<Place> {
        let near =
            index.saturating_sub(STEPS_A_PIECE)..=(index + STEPS_A_PIECE).min(before.len() - 1);
        let mut best: Option<Place> = None;
        let mut solved: Option<(Joints, f64)> = None;
        for from in near {
            let Some(place) = before[from] else {
                continue;
            };
            // Most ways lead to the same branch.
            let known = solved
                .filter(|(joints, _)| largest_difference(joints, &place.joints).1 <= JUMP_RAD);
            let solve = || {
                let joints = arm.joints(pose, &place.joints)?;
                Ok((joints, self.comfort.margin(arm, &joints)))
            };
            let (joints, margin) = match known.map_or_else(solve, Ok) {
                Ok(found) => found,
                Err(unreachable) => {
                    *why = unreachable;
                    continue;
                }
            };
            solved = Some((joints, margin));
            if largest_difference(&joints, &place.joints).1 > JUMP_RAD || margin <= 0.0 {
                *why = Unreachable::JointLimit;
                continue;
            }
            let steps = index.abs_diff(from) as f64;
            let cost = place.cost + ((1.0 - margin) / margin).powi(2) + ROLL_COST * steps * steps;
            if best.is_none_or(|best| cost < best.cost) {
                best = Some(Place { cost, joints, from });
            }
        }
        best
    }

    /// Follows the smooth profile.
    fn walk(
        &self,
        arm: &ToolArm,
        path: impl Fn(f64) -> Rigid<Base, Tool>,
        start: &Joints,
        controls_rad: Vec<f64>,
    ) -> Result<Profile, NoRoll> {
        let steps = WALKED_A_PIECE * (controls_rad.len() - 1);
        let mut profile = Profile {
            controls_rad,
            margin: self.comfort.margin(arm, start),
            end: *start,
        };
        for step in 1..=steps {
            let s = step as f64 / steps as f64;
            let pose = rolled(&path(s), profile.roll_rad(s));
            let ends = |why| NoRoll::Ends {
                percent: 100.0 * s,
                most_rad: self.most_rad,
                why,
            };
            let joints = arm.joints(&pose, &profile.end).map_err(ends)?;
            if largest_difference(&joints, &profile.end).1 > JUMP_RAD {
                return Err(ends(Unreachable::JointLimit));
            }
            profile.margin = profile.margin.min(self.comfort.margin(arm, &joints));
            profile.end = joints;
        }
        Ok(profile)
    }
}

/// The indices of the cheapest way, from its end to its start and turned round.
fn backwards(stages: &[Vec<Option<Place>>]) -> Vec<usize> {
    let last = stages.last().into_iter().flatten().enumerate();
    let mut index = last
        .filter_map(|(index, place)| place.map(|place| (index, place.cost)))
        .min_by(|(_, a), (_, b)| a.total_cmp(b))
        .map_or(0, |(index, _)| index);
    let mut way: Vec<usize> = stages
        .iter()
        .rev()
        .map(|stage| {
            let here = index;
            index = stage[here].map_or(here, |place| place.from);
            here
        })
        .collect();
    way.reverse();
    way
}

impl Profile {
    /// The roll at `s`, rad.
    pub fn roll_rad(&self, s: f64) -> f64 {
        let last = self.controls_rad.len() - 1;
        let along = s.clamp(0.0, 1.0) * last as f64;
        let piece = (along.floor() as usize).min(last.saturating_sub(1));
        let t = along - piece as f64;
        // Beyond its ends the row goes on straight, so that the spline begins and ends on it.
        let control = |offset: usize| match (piece + offset).checked_sub(1) {
            None => 2.0 * self.controls_rad[0] - self.controls_rad[1.min(last)],
            Some(index) if index <= last => self.controls_rad[index],
            Some(_) => 2.0 * self.controls_rad[last] - self.controls_rad[last.saturating_sub(1)],
        };
        let (t2, t3) = (t * t, t * t * t);
        let weights = [
            (1.0 - t).powi(3),
            3.0 * t3 - 6.0 * t2 + 4.0,
            -3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0,
            t3,
        ];
        weights
            .iter()
            .enumerate()
            .map(|(offset, weight)| weight * control(offset) / 6.0)
            .sum()
    }

    /// The farthest roll from the start, rad: the spline stays within its control points.
    pub fn most_rad(&self) -> f64 {
        self.controls_rad
            .iter()
            .fold(0.0, |most, roll| most.max(roll.abs()))
    }

    /// The least margin along the way ([`Comfort::margin`]).
    pub fn margin(&self) -> f64 {
        self.margin
    }

    /// The joints at its end.
    pub fn end(&self) -> Joints {
        self.end
    }
}

#[cfg(test)]
mod tests;
