//! Finding an axis' reference: the drive's methods, how long one may take, and when it has ended.

use std::fmt;
use std::time::Duration;

use epos4_link::cia402::{State, Statusword};

use crate::axis::AxisSpec;
use crate::switches::Function;

/// How an axis finds its reference. Positions and speeds are in the axis' unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct HomingSpec {
    /// The drive's method.
    pub method: Method,
    /// The position of the home point.
    pub position: f64,
    /// How far the home point lies from where switch, index or stop was found, signed: the axis goes there.
    pub offset: f64,
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

    /// The switch that the search needs: without it the axis would run into its end.
    pub const fn needed_function(self) -> Option<Function> {
        match self.0 {
            1 | 17 => Some(Function::NegativeLimit),
            2 | 18 => Some(Function::PositiveLimit),
            7 | 11 | 23 | 27 => Some(Function::Home),
            _ => None,
        }
    }

    /// Whether the axis moves at all.
    pub const fn searches(self) -> bool {
        self.0 != 37
    }

    /// Whether it looks for a switch or a stop over the travel.
    const fn searches_travel(self) -> bool {
        self.searches() && !matches!(self.0, 33 | 34)
    }

    /// Whether it backs off from a switch to find its edge.
    const fn searches_edge(self) -> bool {
        self.needed_function().is_some()
    }

    /// Whether it ends at the encoder's index, which comes within one turn of the motor.
    const fn searches_index(self) -> bool {
        matches!(self.0, 1 | 2 | 7 | 11 | 33 | 34 | -1 | -2)
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            1 => "negative limit switch, then index",
            2 => "positive limit switch, then index",
            7 => "home switch from positive speed, then index",
            11 => "home switch from negative speed, then index",
            17 => "edge of the negative limit switch",
            18 => "edge of the positive limit switch",
            23 => "edge of the home switch, from positive speed",
            27 => "edge of the home switch, from negative speed",
            33 => "index in the negative direction",
            34 => "index in the positive direction",
            37 => "the present position",
            -1 => "stop in the positive direction, by current, then index",
            -2 => "stop in the negative direction, by current, then index",
            -3 => "stop in the positive direction, by current",
            -4 => "stop in the negative direction, by current",
            _ => "unknown",
        })
    }
}

impl HomingSpec {
    /// How long the drive may take, on its own clock, by what the method does: the whole travel and a tenth more at the
    /// speed of the search; a twentieth of the travel to find an edge, a turn of the motor and a tenth more to find the
    /// index, and the way to the home point, at the speed of the approach; four accelerations, and 2 s.
    pub fn time_limit(&self, spec: &AxisSpec) -> Duration {
        const SETTLE_S: f64 = 2.0;
        let if_so = |does: bool, distance: f64| if does { distance } else { 0.0 };
        let (method, span) = (self.method, spec.travel.span());
        let searched = if_so(method.searches_travel(), 1.1 * span);
        let approached = if_so(method.searches_edge(), 0.05 * span)
            + if_so(
                method.searches_index(),
                1.1 * spec.drivetrain.travel_per_motor_turn(),
            )
            + self.offset.abs();
        let accelerated_s = 4.0 * self.search_speed.max(self.approach_speed) / spec.acceleration;
        Duration::from_secs_f64(
            searched / self.search_speed
                + approached / self.approach_speed
                + if_so(method.searches(), accelerated_s)
                + SETTLE_S,
        )
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
    /// The drive stands, and neither found nor failed; or it does not obey any more.
    #[error("homing was interrupted or did not start, statusword {0}")]
    Interrupted(Statusword),
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
        let attained = statusword.has(Statusword::HOMING_ATTAINED);
        let stands = statusword.has(Statusword::TARGET_REACHED);
        let failed = statusword.has(Statusword::HOMING_ERROR);
        self.cleared |= !(attained || stands || failed) || elapsed > Self::CLEARS_WITHIN;
        if statusword.state() != Some(State::OperationEnabled) {
            return Some(Err(HomingError::Interrupted(statusword)));
        }
        // The error of an earlier homing may be what was sent last.
        if self.cleared && failed {
            return Some(Err(HomingError::Reported(statusword)));
        }
        if self.cleared && stands {
            return Some(match (attained, statusword.has(Statusword::REFERENCED)) {
                (true, true) => Ok(()),
                (true, false) => Err(HomingError::NotReferenced(statusword)),
                (false, _) => Err(HomingError::Interrupted(statusword)),
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

    fn limit_s(change: impl FnOnce(&mut HomingSpec)) -> f64 {
        let settings = Config::default().check().unwrap().axes[Axis::ForcepsFeed.index()].clone();
        let mut homing = settings.homing;
        change(&mut homing);
        homing.time_limit(&settings.spec).as_secs_f64()
    }

    #[test]
    fn the_time_limit_follows_from_method_travel_and_speed() {
        // 16.5 mm at 4 mm/s, 0.75 mm at 0.5 mm/s, 4 x 0.08 s of acceleration, 2 s.
        assert!((limit_s(|_| {}) - 7.945).abs() < 1e-9);
        assert!(limit_s(|homing| homing.search_speed = 1.0) > 20.0);
        let method = |code| limit_s(|homing| homing.method = Method::from_code(code).unwrap());
        assert!((method(37) - 2.0).abs() < 1e-9);
        // The index within a turn of the motor, 2/21 mm.
        let index_s = 1.1 * 2.0 / 21.0 / 0.5;
        assert!((method(34) - (index_s + 0.32 + 2.0)).abs() < 1e-9);
        assert!((method(-4) - (4.125 + 0.32 + 2.0)).abs() < 1e-9);
        assert!((method(-2) - method(-4) - index_s).abs() < 1e-9);
        assert!((method(1) - method(17) - index_s).abs() < 1e-9);
        let away_s = limit_s(|homing| homing.offset = -2.0) - limit_s(|_| {});
        assert!((away_s - 4.0).abs() < 1e-9);
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
        let mut watch = Watch::new(ms(0), ms(100));
        assert_eq!(watch.observe(error, ms(1)), None, "of an earlier homing");
        assert_eq!(watch.observe(SEARCHING, ms(2)), None);
        assert_eq!(
            watch.observe(error, ms(3)),
            Some(Err(HomingError::Reported(error)))
        );
        assert_eq!(
            Watch::new(ms(0), ms(100)).observe(error, ms(51)),
            Some(Err(HomingError::Reported(error)))
        );
        let late = Watch::new(ms(0), ms(100)).observe(SEARCHING, ms(101));
        assert_eq!(late, Some(Err(HomingError::TimeLimit(ms(100)))));
        let without = Statusword(0x1427);
        let ended = Watch::new(ms(0), ms(100)).observe(without, ms(60));
        assert_eq!(ended, Some(Err(HomingError::NotReferenced(without))));
    }

    #[test]
    fn a_homing_that_stands_without_an_answer_or_leaves_operation_was_interrupted() {
        let stands = Statusword(0x0427);
        let mut watch = Watch::new(ms(0), ms(5000));
        assert_eq!(watch.observe(stands, ms(1)), None, "not yet started");
        assert_eq!(watch.observe(SEARCHING, ms(2)), None);
        let interrupted = Some(Err(HomingError::Interrupted(stands)));
        assert_eq!(watch.observe(stands, ms(900)), interrupted);
        let stopped = Statusword(0x0007);
        assert_eq!(
            Watch::new(ms(0), ms(5000)).observe(stopped, ms(10)),
            Some(Err(HomingError::Interrupted(stopped)))
        );
    }

    #[test]
    fn methods_that_need_a_switch_say_which() {
        let function = |code| {
            let needed = Method::from_code(code).unwrap().needed_function();
            needed.map(Function::code)
        };
        assert_eq!(
            [17, 18, 23, 37, 34, -4].map(function),
            [Some(0), Some(1), Some(2), None, None, None]
        );
        assert_eq!(Method::from_code(3), None);
    }
}
