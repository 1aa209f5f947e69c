//! When a profile position move has ended, and how.

use std::time::Duration;

use epos4_link::cia402::{State, Statusword};

use crate::axis::AxisSpec;

/// One look at an axis. The position is in the axis' unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// Object 0x6041.
    pub statusword: Statusword,
    /// Object 0x6064.
    pub position: f64,
    /// Object 0x30D1:02.
    pub current_ma: f64,
    /// Object 0x60FD: what the drive takes for active, by function.
    pub inputs: u32,
    /// When statusword and position were on the bus, on its clock.
    pub stamp: Duration,
}

/// Watches a move whose set point the drive has taken.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    target: f64,
    tolerance: f64,
    started: Duration,
    limit: Duration,
}

/// How a move ended without success.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum MoveError {
    /// The drive does not obey any more.
    #[error("the drive left operation at {position:.3}, statusword {statusword}")]
    LeftOperation {
        /// Where.
        position: f64,
        /// What it reports.
        statusword: Statusword,
    },
    /// The position does not refer to the home point any more.
    #[error("the reference was lost at {position:.3}, statusword {statusword}")]
    ReferenceLost {
        /// Where.
        position: f64,
        /// What it reports.
        statusword: Statusword,
    },
    /// It goes on for too long, or ended elsewhere.
    #[error("at {position:.3} after {} s instead of within {tolerance} of {target:.3}", .limit.as_secs_f64())]
    NotReached {
        /// Where.
        position: f64,
        /// Where it should be.
        target: f64,
        /// How near.
        tolerance: f64,
        /// The time it had.
        limit: Duration,
    },
}

impl Watch {
    /// A move from `start`, begun at this time of the bus. It may take half as long again as its profile, and a second.
    pub fn new(spec: &AxisSpec, start: f64, target: f64, speed: f64, started: Duration) -> Self {
        let limit =
            Duration::from_secs_f64(1.5 * spec.move_duration_s(target - start, speed) + 1.0);
        Self {
            target,
            tolerance: spec.tolerance,
            started,
            limit,
        }
    }

    /// When the move began, on the clock of the bus.
    pub fn started(&self) -> Duration {
        self.started
    }

    /// Takes a sample; an answer when the move is over.
    pub fn observe(&self, sample: &Sample) -> Option<Result<(), MoveError>> {
        let Sample {
            statusword,
            position,
            ..
        } = *sample;
        if statusword.state() != Some(State::OperationEnabled) {
            return Some(Err(MoveError::LeftOperation {
                position,
                statusword,
            }));
        }
        if !statusword.has(Statusword::REFERENCED) {
            return Some(Err(MoveError::ReferenceLost {
                position,
                statusword,
            }));
        }
        let near = (position - self.target).abs() <= self.tolerance;
        if near && statusword.has(Statusword::TARGET_REACHED) {
            return Some(Ok(()));
        }
        let late = sample.stamp.saturating_sub(self.started) > self.limit;
        late.then_some(Err(MoveError::NotReached {
            position,
            target: self.target,
            tolerance: self.tolerance,
            limit: self.limit,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::config::Config;

    fn watch() -> Watch {
        let spec = &Config::default().check().unwrap().axes[Axis::ForcepsFeed.index()].spec;
        Watch::new(spec, 0.0, 10.0, 5.0, Duration::from_secs(100))
    }

    fn sample(statusword: u16, position: f64, seconds: f64) -> Sample {
        let stamp = Duration::from_secs_f64(100.0 + seconds);
        Sample {
            statusword: Statusword(statusword),
            position,
            current_ma: 50.0,
            inputs: 0,
            stamp,
        }
    }

    #[test]
    fn a_move_ends_when_the_profile_has_ended_and_the_axis_is_there() {
        assert_eq!(
            watch().observe(&sample(0x8027, 9.99, 2.0)),
            None,
            "the profile still runs"
        );
        assert_eq!(
            watch().observe(&sample(0x8427, 9.9, 2.2)),
            None,
            "the axis still lags"
        );
        assert_eq!(watch().observe(&sample(0x8427, 9.99, 2.2)), Some(Ok(())));
    }

    #[test]
    fn a_move_that_does_not_arrive_is_told_with_value_and_limit() {
        // 10 mm at 5 mm/s with 50 mm/s^2 take 2.1 s.
        assert_eq!(watch().observe(&sample(0x8427, 9.5, 4.1)), None);
        let error = watch()
            .observe(&sample(0x8427, 9.5, 4.2))
            .unwrap()
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "at 9.500 after 4.15 s instead of within 0.02 of 10.000"
        );
    }

    #[test]
    fn a_drive_that_leaves_operation_ends_the_move() {
        let error = watch()
            .observe(&sample(0x8007, 3.0, 1.0))
            .unwrap()
            .unwrap_err();
        assert!(matches!(error, MoveError::LeftOperation { .. }));
    }

    #[test]
    fn a_reference_that_falls_ends_the_move() {
        let error = watch()
            .observe(&sample(0x0027, 3.0, 1.0))
            .unwrap()
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the reference was lost at 3.000, statusword 0x0027"
        );
    }
}
