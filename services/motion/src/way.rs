//! The way of a move: what is driven sample by sample, and what is looked at beforehand. Both are the same.

use crate::error::Error;
use crate::free_way::FreeWay;
use crate::kinematics::Joints;
use crate::trajectory::Trajectory;

/// A way with its time law.
#[derive(Clone, Debug)]
pub enum Way {
    /// With the shaft on the portal.
    Portal(Box<Trajectory>),
    /// Outside.
    Outside(Box<FreeWay>),
}

impl Way {
    /// Time from rest to rest, s.
    pub fn duration_s(&self) -> f64 {
        match self {
            Self::Portal(trajectory) => trajectory.duration_s(),
            Self::Outside(way) => way.duration_s(),
        }
    }

    /// The share done at `time_s`.
    pub fn fraction(&self, time_s: f64) -> f64 {
        match self {
            Self::Portal(trajectory) => trajectory.fraction(time_s),
            Self::Outside(way) => way.fraction(time_s),
        }
    }

    /// The joints at `time_s`, nearest to the sample before.
    ///
    /// # Errors
    /// What the arm cannot reach.
    pub fn sample(&self, time_s: f64, before: &Joints) -> Result<Joints, Error> {
        match self {
            Self::Portal(trajectory) => trajectory.sample(time_s, before),
            Self::Outside(way) => way.sample(time_s, before),
        }
    }
}
