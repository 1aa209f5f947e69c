//! Finding an axis' reference: the drive's methods, how long one may take, and when it has ended.

use std::time::Duration;

use epos4_link::cia402::Statusword;

use crate::axis::AxisSpec;

/// How an axis finds its reference. Positions and speeds are in the axis' unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct HomingSpec {
    /// The drive's method.
    pub method: Method,
    /// The position of the home point.
    pub position: f64,
    /// Speed of the search for switch or stop.
    pub search_speed: f64,
    /// Speed of the search for edge or index.
    pub approach_speed: f64,
    /// The current that ends a method by current threshold, mA.
    pub current_threshold_ma: u16,
}

/// A homing method of the EPOS4 (object 0x60E3).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Method(i8);

impl Method {
    const SUPPORTED: [i8; 15] = [37, 34, 33, 27, 23, 18, 17, 11, 7, 2, 1, -1, -2, -3, -4];

    /// By its number; `None` for one that the drive has not.
    pub fn from_code(code: i8) -> Option<Self> {
        Self::SUPPORTED.contains(&code).then_some(Self(code))
    }

    /// Its number.
    pub const fn code(self) -> i8 {
        self.0
    }

    /// The input function (object 0x3142) that the search needs: without it the axis would run into its end. 0 negative
    /// limit, 1 positive limit, 2 home switch.
    pub const fn needed_input_function(self) -> Option<u8> {
        match self.0 {
            1 | 17 => Some(0),
            2 | 18 => Some(1),
            7 | 11 | 23 | 27 => Some(2),
            _ => None,
        }
    }

    /// Whether the axis moves at all.
    const fn searches(self) -> bool {
        self.0 != 37
    }
}

impl HomingSpec {
    /// How long the drive may take, on its own clock: over the whole travel and a tenth more at the speed of the
    /// search, then one turn of the motor and a twentieth of the travel at the speed of the approach.
    pub fn time_limit(&self, spec: &AxisSpec) -> Duration {
        const SETTLE_S: f64 = 2.0;
        if !self.method.searches() {
            return Duration::from_secs_f64(SETTLE_S);
        }
        let motor_turn = f64::from(spec.drivetrain.quadcounts_per_motor_turn)
            / spec.drivetrain.quadcounts_per_unit().abs();
        let search_s = 1.1 * spec.travel.span() / self.search_speed;
        let approach_s = (motor_turn + 0.05 * spec.travel.span()) / self.approach_speed;
        Duration::from_secs_f64(search_s + approach_s + SETTLE_S)
    }
}

/// Watches a homing that has been started.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    started: Duration,
    limit: Duration,
    /// The bits of an earlier homing are gone.
    cleared: bool,
}

/// How a homing ended without success.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum HomingError {
    /// Bit 13.
    #[error("the drive reports a homing error, statusword {0}")]
    Reported(Statusword),
    /// It goes on for too long.
    #[error("no reference was found within {} s", .0.as_secs_f64())]
    TimeLimit(Duration),
    /// It ended, and yet the position is not referenced.
    #[error("the drive ended without a reference, statusword {0}")]
    NotReferenced(Statusword),
}

impl Watch {
    /// A drive clears the bits of an earlier homing within this time.
    const CLEARS_WITHIN: Duration = Duration::from_millis(50);

    /// Homing began at this time of the bus.
    pub fn new(started: Duration, limit: Duration) -> Self {
        Self {
            started,
            limit,
            cleared: false,
        }
    }

    /// Takes a statusword; an answer when homing is over.
    pub fn observe(
        &mut self,
        statusword: Statusword,
        stamp: Duration,
    ) -> Option<Result<(), HomingError>> {
        let elapsed = stamp.saturating_sub(self.started);
        self.cleared |=
            !statusword.has(Statusword::HOMING_ATTAINED) || elapsed > Self::CLEARS_WITHIN;
        if statusword.has(Statusword::HOMING_ERROR) {
            return Some(Err(HomingError::Reported(statusword)));
        }
        if self.cleared && statusword.has(Statusword::HOMING_ATTAINED | Statusword::TARGET_REACHED)
        {
            let referenced = statusword.has(Statusword::REFERENCED);
            return Some(if referenced {
                Ok(())
            } else {
                Err(HomingError::NotReferenced(statusword))
            });
        }
        (elapsed > self.limit).then_some(Err(HomingError::TimeLimit(self.limit)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::config::Config;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    const ATTAINED: Statusword = Statusword(0x9427);
    const SEARCHING: Statusword = Statusword(0x0027);

    #[test]
    fn the_time_limit_follows_from_travel_and_speed() {
        let settings = Config::default().check().unwrap().axes[Axis::ForcepsFeed.index()].clone();
        // 16.5 mm at 4 mm/s, 0.095 + 0.75 mm at 0.5 mm/s, 2 s.
        let limit_s = settings.homing.time_limit(&settings.spec).as_secs_f64();
        assert!((limit_s - 7.815).abs() < 0.01, "{limit_s}");
        let slow = HomingSpec {
            search_speed: 1.0,
            ..settings.homing
        };
        assert!(slow.time_limit(&settings.spec).as_secs_f64() > 20.0);
    }

    #[test]
    fn the_bits_of_an_earlier_homing_are_not_taken_for_this_one() {
        let mut watch = Watch::new(ms(1000), ms(5000));
        assert_eq!(watch.observe(ATTAINED, ms(1001)), None);
        assert_eq!(watch.observe(SEARCHING, ms(1002)), None);
        assert_eq!(watch.observe(ATTAINED, ms(1003)), Some(Ok(())));
    }

    #[test]
    fn a_homing_that_is_done_at_once_is_seen_as_done() {
        let mut watch = Watch::new(ms(1000), ms(5000));
        assert_eq!(watch.observe(ATTAINED, ms(1051)), Some(Ok(())));
    }

    #[test]
    fn a_homing_ends_by_error_by_time_or_without_reference() {
        let error = Statusword(0x2027);
        assert_eq!(
            Watch::new(ms(0), ms(100)).observe(error, ms(1)),
            Some(Err(HomingError::Reported(error)))
        );
        let late = Watch::new(ms(0), ms(100)).observe(SEARCHING, ms(101));
        assert_eq!(late, Some(Err(HomingError::TimeLimit(ms(100)))));
        let without = Statusword(0x1427);
        let ended = Watch::new(ms(0), ms(100)).observe(without, ms(60));
        assert_eq!(ended, Some(Err(HomingError::NotReferenced(without))));
    }

    #[test]
    fn methods_that_need_a_switch_say_which() {
        let function = |code| Method::from_code(code).unwrap().needed_input_function();
        assert_eq!(
            [17, 18, 23, 37, 34, -4].map(function),
            [Some(0), Some(1), Some(2), None, None, None]
        );
        assert_eq!(Method::from_code(3), None);
    }
}
