//! The circuit breaker of one replica: after a few failures in a row it is left alone for a while, then one call tries it.
//!
//! Time comes in as an argument; nothing here waits.

use std::time::{Duration, Instant};

/// Failures in a row that open the circuit.
pub const FAILURES_TO_OPEN: u32 = 3;
/// How long the circuit stays open at first; each trial that fails doubles it.
pub const COOL_DOWN: Duration = Duration::from_secs(1);
/// It is never open for longer.
pub const COOL_DOWN_MAX: Duration = Duration::from_secs(30);

/// Whether calls go through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Circuit {
    /// Calls go through.
    Closed {
        /// Failures since the last success.
        failures: u32,
    },
    /// No call goes through before that time; then one may try.
    Open {
        /// When the next trial may begin.
        until: Instant,
    },
    /// One call tries; the others do not go through.
    HalfOpen,
}

/// The circuit and how patient it has become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Breaker {
    circuit: Circuit,
    cool_down: Duration,
}

impl Default for Breaker {
    fn default() -> Self {
        Self {
            circuit: Circuit::Closed { failures: 0 },
            cool_down: COOL_DOWN,
        }
    }
}

impl Breaker {
    /// Where the circuit stands.
    pub fn circuit(&self) -> Circuit {
        self.circuit
    }

    /// Whether a call may go through now.
    pub fn admits(&self, now: Instant) -> bool {
        match self.circuit {
            Circuit::Closed { .. } => true,
            Circuit::Open { until } => now >= until,
            Circuit::HalfOpen => false,
        }
    }

    /// A call that was admitted goes through.
    pub fn enter(&mut self) {
        if let Circuit::Open { .. } = self.circuit {
            self.circuit = Circuit::HalfOpen;
        }
    }

    /// A call was answered, or the replica came back as a new one.
    pub fn succeeded(&mut self) {
        *self = Self::default();
    }

    /// A call was not answered, or its answer broke off.
    pub fn failed(&mut self, now: Instant) {
        match self.circuit {
            Circuit::Closed { failures } if failures + 1 < FAILURES_TO_OPEN => {
                self.circuit = Circuit::Closed {
                    failures: failures + 1,
                };
            }
            Circuit::Closed { .. } => {
                self.circuit = Circuit::Open {
                    until: now + self.cool_down,
                };
            }
            Circuit::HalfOpen => {
                self.cool_down = (self.cool_down * 2).min(COOL_DOWN_MAX);
                self.circuit = Circuit::Open {
                    until: now + self.cool_down,
                };
            }
            // A call from before the circuit opened; it says nothing new.
            Circuit::Open { .. } => {}
        }
    }

    /// A call was given up by its caller before anything was known; a trial may then begin anew.
    pub fn abandoned(&mut self, now: Instant) {
        if self.circuit == Circuit::HalfOpen {
            self.circuit = Circuit::Open { until: now };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(now: Instant) -> Breaker {
        let mut breaker = Breaker::default();
        for _ in 0..FAILURES_TO_OPEN {
            assert!(breaker.admits(now));
            breaker.failed(now);
        }
        breaker
    }

    #[test]
    fn failures_in_a_row_open_the_circuit_and_a_success_between_does_not() {
        let now = Instant::now();
        let mut breaker = Breaker::default();
        for _ in 0..100 {
            for _ in 1..FAILURES_TO_OPEN {
                breaker.failed(now);
            }
            assert!(breaker.admits(now));
            breaker.succeeded();
        }
        assert!(!opened(now).admits(now));
    }

    #[test]
    fn after_the_cool_down_one_call_tries_and_the_others_wait() {
        let now = Instant::now();
        let mut breaker = opened(now);
        assert!(!breaker.admits(now + COOL_DOWN - Duration::from_nanos(1)));
        assert!(breaker.admits(now + COOL_DOWN));
        breaker.enter();
        assert_eq!(breaker.circuit(), Circuit::HalfOpen);
        assert!(!breaker.admits(now + COOL_DOWN * 100));
        breaker.succeeded();
        assert!(breaker.admits(now + COOL_DOWN));
    }

    #[test]
    fn every_failed_trial_doubles_the_cool_down_up_to_its_limit() {
        let mut now = Instant::now();
        let mut breaker = opened(now);
        let mut waited = Vec::new();
        for _ in 0..7 {
            let Circuit::Open { until } = breaker.circuit() else {
                panic!("{breaker:?} is open");
            };
            waited.push((until - now).as_secs());
            now = until;
            breaker.enter();
            breaker.failed(now);
        }
        assert_eq!(waited, [1, 2, 4, 8, 16, 30, 30]);
    }

    #[test]
    fn a_trial_that_its_caller_gave_up_leaves_room_for_the_next() {
        let now = Instant::now();
        let mut breaker = opened(now);
        breaker.enter();
        breaker.abandoned(now + COOL_DOWN);
        assert!(breaker.admits(now + COOL_DOWN));
    }

    #[test]
    fn a_late_failure_of_an_older_call_does_not_prolong_the_cool_down() {
        let now = Instant::now();
        let mut breaker = opened(now);
        breaker.failed(now + COOL_DOWN / 2);
        assert!(breaker.admits(now + COOL_DOWN));
    }
}
