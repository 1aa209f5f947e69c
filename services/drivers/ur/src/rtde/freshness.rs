//! Judges whether a state is new, what was missed before it, and how late it came, by the controller's clock and ours.

use std::time::Duration;

/// The quickest package is looked for among those of this long; clocks drift apart by less than half a millisecond in it.
const WINDOW: Duration = Duration::from_secs(10);

/// Watches the timestamps of one connection.
#[derive(Clone, Debug)]
pub struct Freshness {
    /// Between two packages by the controller's clock, s.
    period_s: f64,
    last_s: Option<f64>,
    quickest: Quickest,
}

/// A state that is new.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fresh {
    /// Packages that should have come between the last fresh state and this one.
    pub skipped: u64,
    /// How much longer it took than the quickest package of the last seconds.
    pub lateness: Duration,
}

/// A state that must not be taken for a new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stale {
    /// Its timestamp is that of an earlier state, or lies before it.
    Old,
    /// Its timestamp is not a number.
    NoTime,
}

impl Freshness {
    /// For packages that come at this rate, > 0.
    pub fn new(frequency_hz: f64) -> Self {
        Self {
            period_s: 1.0 / frequency_hz,
            last_s: None,
            quickest: Quickest::default(),
        }
    }

    /// Judges a state of this time of the controller that was received now, told as time since any fixed moment.
    ///
    /// # Errors
    /// It is not a new state.
    pub fn judge(&mut self, timestamp_s: f64, now: Duration) -> Result<Fresh, Stale> {
        if !timestamp_s.is_finite() {
            return Err(Stale::NoTime);
        }
        let skipped = match self.last_s {
            Some(last_s) if timestamp_s <= last_s => return Err(Stale::Old),
            // Saturates; a gap of less than one and a half periods is none.
            Some(last_s) => ((timestamp_s - last_s) / self.period_s - 0.5) as u64,
            None => 0,
        };
        self.last_s = Some(timestamp_s);
        let offset_s = now.as_secs_f64() - timestamp_s;
        let lateness_s = offset_s - self.quickest.with(offset_s, now);
        Ok(Fresh {
            skipped,
            lateness: Duration::try_from_secs_f64(lateness_s).unwrap_or_default(),
        })
    }
}

/// The smallest offset between the clocks in the last one to two windows.
#[derive(Clone, Copy, Debug, Default)]
struct Quickest {
    began: Duration,
    now_s: Option<f64>,
    before_s: Option<f64>,
}

impl Quickest {
    fn with(&mut self, offset_s: f64, now: Duration) -> f64 {
        if now.saturating_sub(self.began) > WINDOW {
            (self.began, self.before_s, self.now_s) = (now, self.now_s, None);
        }
        let least = self.now_s.map_or(offset_s, |least| least.min(offset_s));
        self.now_s = Some(least);
        self.before_s.map_or(least, |before| before.min(least))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    #[test]
    fn missing_packages_are_counted_by_the_controllers_clock() {
        let mut freshness = Freshness::new(125.0);
        let mut skipped = |timestamp_s| freshness.judge(timestamp_s, at(0.0)).unwrap().skipped;
        assert_eq!(skipped(10.0), 0);
        assert_eq!(skipped(10.008), 0);
        assert_eq!(skipped(10.017), 0);
        assert_eq!(skipped(10.032), 1);
        assert_eq!(skipped(10.432), 49);
    }

    #[test]
    fn a_state_that_is_not_later_than_the_last_is_stale() {
        let mut freshness = Freshness::new(500.0);
        assert!(freshness.judge(5.0, at(1.0)).is_ok());
        assert_eq!(freshness.judge(5.0, at(1.1)), Err(Stale::Old));
        assert_eq!(freshness.judge(4.0, at(1.2)), Err(Stale::Old));
        assert_eq!(freshness.judge(f64::NAN, at(1.2)), Err(Stale::NoTime));
        assert_eq!(freshness.judge(f64::INFINITY, at(1.2)), Err(Stale::NoTime));
        assert!(freshness.judge(5.002, at(1.3)).is_ok());
    }

    #[test]
    fn a_state_that_waited_somewhere_is_late() {
        let mut freshness = Freshness::new(125.0);
        for cycle in 0..100 {
            let sent = f64::from(cycle) * 0.008;
            let fresh = freshness.judge(sent, at(20.0 + sent)).unwrap();
            assert!(fresh.lateness < at(1e-6), "{fresh:?}");
        }
        let late = freshness.judge(0.8, at(20.85)).unwrap().lateness;
        assert!((late.as_secs_f64() - 0.05).abs() < 1e-6, "{late:?}");
    }

    #[test]
    fn a_drift_of_the_clocks_is_forgotten() {
        let mut freshness = Freshness::new(125.0);
        let mut late = Duration::ZERO;
        for cycle in 0..200_000 {
            let sent = f64::from(cycle) * 0.008;
            late = freshness.judge(sent, at(sent * 1.000_05)).unwrap().lateness;
        }
        assert!(late < at(0.0011), "{late:?}");
    }
}
