//! How fast a path is run through: s over time, with limited speed, acceleration and jerk; the fastest
//! such law, by Ruckig (Berscheid and Kroeger 2021) in one dimension.

use rsruckig::prelude::{InputParameter, Ruckig, ThrowErrorHandler, Trajectory};

use crate::error::Error;

/// Limits of s, which runs from 0 to 1: per s, s2 and s3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLimits {
    /// Largest ds/dt, 1/s.
    pub speed: f64,
    /// Largest second derivative, 1/s2.
    pub acceleration: f64,
    /// Largest third derivative, 1/s3.
    pub jerk: f64,
}

/// The state of s at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rate {
    /// The share of the path done, 0 .. 1.
    pub s: f64,
    /// Its first derivative, 1/s.
    pub speed: f64,
    /// Its second, 1/s2.
    pub acceleration: f64,
    /// Its third, 1/s3; constant within a phase.
    pub jerk: f64,
}

/// Phases of constant jerk: up to two that brake what is too fast at the start, and seven to the end.
const PHASES: usize = 9;

/// The fastest s(t) to 1 within the limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeLaw {
    phases: [Phase; PHASES],
    duration_s: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Phase {
    /// Since the start of the law, s.
    begins_s: f64,
    at: Rate,
}

impl RateLimits {
    /// The limits of the same law run through `by` times as slowly.
    pub fn dilated(&self, by: f64) -> Self {
        Self {
            speed: self.speed / by,
            acceleration: self.acceleration / by.powi(2),
            jerk: self.jerk / by.powi(3),
        }
    }
}

impl TimeLaw {
    /// From rest at 0 to rest at 1.
    ///
    /// # Errors
    /// NO_TIMING unless all limits are finite and greater than zero.
    pub fn new(limits: &RateLimits) -> Result<Self, Error> {
        Self::from(&Rate::default(), limits)
    }

    /// From a state under way, whose jerk does not matter, to rest at 1. What is too fast is braked first.
    ///
    /// # Errors
    /// NO_TIMING unless the limits are finite and greater than zero and the state finite.
    pub fn from(start: &Rate, limits: &RateLimits) -> Result<Self, Error> {
        let failed = |detail: String| Error::NoTiming { detail };
        let RateLimits {
            speed,
            acceleration,
            jerk,
        } = *limits;
        for (name, limit) in [
            ("speed", speed),
            ("acceleration", acceleration),
            ("jerk", jerk),
        ] {
            if !(f64::MIN_POSITIVE..f64::INFINITY).contains(&limit) {
                return Err(failed(format!(
                    "the limit of the path's {name} is {limit}; must be greater than 0"
                )));
            }
        }
        // Ruckig compares with absolute tolerances: time is counted in a unit in which the jerk is 1.
        let unit_s = jerk.cbrt().recip();
        let mut input = InputParameter::<1>::new(None);
        input.current_position[0] = start.s;
        input.current_velocity[0] = start.speed * unit_s;
        input.current_acceleration[0] = start.acceleration * unit_s.powi(2);
        input.target_position[0] = 1.0;
        input.max_velocity[0] = speed * unit_s;
        input.max_acceleration[0] = acceleration * unit_s.powi(2);
        input.max_jerk[0] = 1.0;
        let mut found = Trajectory::<1>::new(None);
        Ruckig::<1, ThrowErrorHandler>::new(None, unit_s)
            .calculate(&input, &mut found)
            .map_err(|error| failed(error.to_string()))?;
        let profile = found
            .get_profiles()
            .first()
            .map(|profiles| profiles[0])
            .ok_or_else(|| failed("there is no profile".to_owned()))?;

        let brake = profile.brake;
        let braking = (0..2).map(|i| (brake.t[i], brake.p[i], brake.v[i], brake.a[i], brake.j[i]));
        let going = (0..7).map(|i| {
            let (p, v, a) = (profile.p[i], profile.v[i], profile.a[i]);
            (profile.t[i], p, v, a, profile.j[i])
        });
        let mut phases = [Phase::default(); PHASES];
        let mut begins_s = 0.0;
        for (phase, (lasts, s, speed, acceleration, jerk)) in
            phases.iter_mut().zip(braking.chain(going))
        {
            *phase = Phase {
                begins_s,
                at: Rate {
                    s,
                    speed: speed / unit_s,
                    acceleration: acceleration / unit_s.powi(2),
                    jerk: jerk / unit_s.powi(3),
                },
            };
            begins_s += lasts * unit_s;
        }
        Ok(Self {
            phases,
            duration_s: begins_s,
        })
    }

    /// To the end, s.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// s at `time_s` after the start; the start's before, and 1 after the motion.
    pub fn at(&self, time_s: f64) -> f64 {
        self.rate(time_s).s
    }

    /// The state at `time_s` after the start; at rest at 1 after the motion.
    pub fn rate(&self, time_s: f64) -> Rate {
        if !(..self.duration_s).contains(&time_s) {
            return Rate {
                s: 1.0,
                ..Rate::default()
            };
        }
        let phase = self
            .phases
            .iter()
            .rev()
            .find(|phase| phase.begins_s <= time_s)
            .unwrap_or(&self.phases[0]);
        let t = (time_s - phase.begins_s).max(0.0);
        let Rate {
            s,
            speed,
            acceleration,
            jerk,
        } = phase.at;
        Rate {
            s: s + t * (speed + t * (acceleration / 2.0 + t * jerk / 6.0)),
            speed: speed + t * (acceleration + t * jerk / 2.0),
            acceleration: acceleration + t * jerk,
            jerk,
        }
    }

    /// When the jerk changes, in order; some of the phases between may be empty.
    pub fn phases_s(&self) -> impl Iterator<Item = f64> + '_ {
        self.phases.iter().map(|phase| phase.begins_s)
    }
}

#[cfg(test)]
mod tests;
