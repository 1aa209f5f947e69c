//! When the network's own periodic frames are due: by the time of the bus or by real time, whichever comes first, so that
//! a simulated cell that runs faster than real time is served as well as a bus on which nobody speaks.

use std::time::Duration;

use tokio::time::Instant;

/// The pace of one kind of frame.
#[derive(Clone, Debug)]
pub(super) struct Pace {
    period: Duration,
    last: Option<(Duration, Instant)>,
}

impl Pace {
    pub(super) fn new(period: Duration) -> Self {
        Self { period, last: None }
    }

    /// Whether a frame is due; it is then taken as sent.
    pub(super) fn is_due(&mut self, bus_now: Duration, now: Instant) -> bool {
        let Some((bus_last, last)) = self.last else {
            self.last = Some((bus_now, now));
            return true;
        };
        // A bus whose clock went back, or that was silent, is not owed what was missed.
        let on_pace = |late: Duration| late < self.period;
        let bus_due = bus_last + self.period;
        let due = last + self.period;
        if bus_now < bus_due && now < due && bus_now >= bus_last {
            return false;
        }
        let bus_base = if bus_now >= bus_due && on_pace(bus_now - bus_due) {
            bus_due
        } else {
            bus_now
        };
        let base = if now >= due && on_pace(now - due) {
            due
        } else {
            now
        };
        self.last = Some((bus_base, base));
        true
    }

    /// When a frame is due by real time.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.last.map(|(_, last)| last + self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_frame_is_due_by_whichever_clock_is_first() {
        let start = Instant::now();
        let mut pace = Pace::new(ms(100));
        assert!(pace.is_due(ms(0), start), "at once");
        assert!(!pace.is_due(ms(99), start + ms(5)));
        assert!(pace.is_due(ms(101), start + ms(5)), "a fast bus");
        assert!(!pace.is_due(ms(199), start + ms(10)));
        assert!(pace.is_due(ms(200), start + ms(10)), "without drift");
        assert!(pace.is_due(ms(201), start + ms(110)), "a silent bus");
        assert_eq!(pace.deadline(), Some(start + ms(210)));
    }

    #[test]
    fn what_was_missed_is_not_made_up_for() {
        let start = Instant::now();
        let mut pace = Pace::new(ms(100));
        assert!(pace.is_due(ms(0), start));
        assert!(pace.is_due(ms(1000), start));
        assert!(!pace.is_due(ms(1001), start));
        assert!(pace.is_due(ms(3), start), "the clock of the bus began anew");
    }
}
