//! Where all bodies of an arm sweep along on the way of a move, to keep it clear of the other arm and within
//! the planes.
//!
//! Between two samples no body is farther from where it is at the nearer one than half of what the bodies
//! move in that step; so much more room is asked for.

use crate::bodies::Bodies;
use crate::cell::Berth;
use crate::clearance::Keep;
use crate::error::Error;
use crate::kinematics::{Joints, ToolArm};
use crate::limits::Limits;
use crate::trajectory::Trajectory;
use crate::way::Way;
use crate::workspace::least_room;

/// The bodies shall move by no more than this from sample to sample, mm.
const STEP_MM: f64 = 1.0;
/// Most samples of a way, whatever that makes of its steps.
const SAMPLES_MAX: usize = 400;
/// Most samples of a way when it is held against another way.
const COARSE_SAMPLES_MAX: usize = 64;
/// Samples of the first look at a way, from which its length is judged.
const FIRST_LOOK: usize = 16;
/// What a stretch of way may be longer than a first look at it shows.
const LENGTH_SURPLUS: f64 = 1.3;

/// Bodies along a way, in the common frame of the cell.
#[derive(Clone, Debug)]
pub struct Sweep {
    fine: Vec<Sample>,
    coarse: Vec<Sample>,
}

#[derive(Clone, Debug)]
struct Sample {
    /// Share of the way, 0 .. 1.
    s: f64,
    bodies: Bodies,
    /// No body has moved farther since the first sample, mm.
    way_mm: f64,
    /// Half of the longer step to a neighbouring sample, mm.
    slack_mm: f64,
}

/// The arm whose way it is.
#[derive(Clone, Copy, Debug)]
pub struct Walker<'a> {
    /// The arm and its tool.
    pub arm: &'a ToolArm,
    /// Its limits.
    pub limits: &'a Limits,
    /// Where it stands.
    pub berth: &'a Berth,
    /// Free room to its planes that it must keep at least, mm: 0 unless it begins beyond one.
    pub plane_room_mm: f64,
}

impl Walker<'_> {
    /// The sweep of a way that begins at the joints `start`. Refused with WORKSPACE where it leads beyond a plane.
    pub fn sweep(&self, way: &Way, start: &Joints) -> Result<Sweep, Error> {
        self.walk(start, way.duration_s(), |time_s, before| {
            Ok((way.fraction(time_s), way.sample(time_s, before)?))
        })
    }

    /// The sweep of one trajectory.
    pub fn sweep_of(&self, trajectory: &Trajectory, start: &Joints) -> Result<Sweep, Error> {
        self.walk(start, trajectory.duration_s(), |time_s, before| {
            Ok((
                trajectory.fraction(time_s),
                trajectory.sample(time_s, before)?,
            ))
        })
    }

    /// `at` gives the share of the way and the joints at a time, nearest to those before.
    fn walk(
        &self,
        start: &Joints,
        duration_s: f64,
        at: impl Fn(f64, &Joints) -> Result<(f64, Joints), Error>,
    ) -> Result<Sweep, Error> {
        let look = |samples: usize| -> Result<Vec<(f64, Bodies)>, Error> {
            let mut before = *start;
            (0..=samples)
                .map(|index| {
                    let (s, joints) = at(duration_s * index as f64 / samples as f64, &before)?;
                    before = joints;
                    Ok((s, self.bodies(s, &joints)?))
                })
                .collect()
        };
        let first = look(FIRST_LOOK)?;
        // The fastest step decides: samples are even in time, steps are not.
        let fastest_mm = first
            .windows(2)
            .map(|pair| pair[0].1.moved_mm(&pair[1].1))
            .fold(0.0, f64::max);
        let wanted = fastest_mm * LENGTH_SURPLUS * FIRST_LOOK as f64 / STEP_MM;
        let samples = (wanted.ceil() as usize).clamp(FIRST_LOOK, SAMPLES_MAX);
        let fine = look(samples)?;
        let every = fine.len().div_ceil(COARSE_SAMPLES_MAX);
        let last = fine.len() - 1;
        let coarse: Vec<_> = fine
            .iter()
            .enumerate()
            .filter(|(index, _)| index % every == 0 || *index == last)
            .map(|(_, sample)| *sample)
            .collect();
        Ok(Sweep {
            fine: with_slack(&fine),
            coarse: with_slack(&coarse),
        })
    }

    /// The bodies at one place of the way, which must be within the planes.
    fn bodies(&self, s: f64, joints: &Joints) -> Result<Bodies, Error> {
        let pose = self.arm.base_from_tool(joints);
        let bodies = self.berth.bodies(joints, &pose);
        if let Some(beyond) = least_room(&self.limits.planes, &pose.origin(), &bodies)
            && beyond.room_mm < self.plane_room_mm
        {
            return Err(Error::Workspace {
                plane: beyond.plane.to_owned(),
                body: beyond.body,
                room_mm: beyond.room_mm,
                limit_mm: self.plane_room_mm,
                percent: 100.0 * s,
            });
        }
        Ok(self.berth.in_common(&bodies))
    }
}

impl Sweep {
    /// Refused with ARMS_TOO_NEAR where a body comes too near to another arm that stands still.
    pub fn keeps_clear_of(&self, other: &Bodies, keep: &Keep) -> Result<(), Error> {
        walk(&self.fine, |sample| {
            let nearest = sample.bodies.nearest(other).less(sample.slack_mm);
            match keep.missed(&nearest) {
                None => Ok(keep.surplus_mm(&nearest)),
                Some((distance, limit_mm)) => Err(Error::ArmsTooNear {
                    mm: distance.mm,
                    limit_mm,
                    bodies: distance.bodies.map(|body| body.as_str()),
                    percent: 100.0 * sample.s,
                }),
            }
        })?;
        Ok(())
    }

    /// Refused with ARM_BUSY_NEARBY where a body comes too near to any place of the way that another arm is on: where
    /// on it that arm is meanwhile is not counted on.
    pub fn keeps_clear_of_sweep(&self, other: &Self, keep: &Keep) -> Result<(), Error> {
        walk(&self.coarse, |sample| {
            walk(&other.coarse, |theirs| {
                let slack_mm = sample.slack_mm + theirs.slack_mm;
                let nearest = sample.bodies.nearest(&theirs.bodies).less(slack_mm);
                match keep.missed(&nearest) {
                    None => Ok(keep.surplus_mm(&nearest)),
                    Some((distance, limit_mm)) => Err(Error::ArmBusyNearby {
                        mm: distance.mm,
                        limit_mm,
                        bodies: distance.bodies.map(|body| body.as_str()),
                        percent: 100.0 * sample.s,
                    }),
                }
            })
        })?;
        Ok(())
    }
}

/// Asks for the surplus of room along a way, mm, and leaves out the samples to which the bodies move by less than half
/// of it: there the other half is left. Returns half of the least surplus found, which is what every sample has.
fn walk(
    samples: &[Sample],
    mut surplus_mm: impl FnMut(&Sample) -> Result<f64, Error>,
) -> Result<f64, Error> {
    let mut clear_until_mm = f64::NEG_INFINITY;
    let mut least_mm = f64::INFINITY;
    for sample in samples {
        if sample.way_mm + sample.slack_mm > clear_until_mm {
            let half_mm = 0.5 * surplus_mm(sample)?;
            clear_until_mm = sample.way_mm + half_mm;
            least_mm = least_mm.min(half_mm);
        }
    }
    Ok(least_mm)
}

fn with_slack(samples: &[(f64, Bodies)]) -> Vec<Sample> {
    let steps: Vec<f64> = samples
        .windows(2)
        .map(|pair| pair[0].1.moved_mm(&pair[1].1))
        .collect();
    let mut way_mm = 0.0;
    let step = |index: Option<usize>| index.and_then(|index| steps.get(index)).copied();
    samples
        .iter()
        .enumerate()
        .map(|(index, (s, bodies))| {
            let before = step(index.checked_sub(1)).unwrap_or(0.0);
            let after = step(Some(index)).unwrap_or(0.0);
            way_mm += before;
            Sample {
                s: *s,
                bodies: *bodies,
                way_mm,
                slack_mm: 0.5 * before.max(after),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests;
