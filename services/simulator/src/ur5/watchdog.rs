//! Watchdogs that a program sets on RTDE inputs (`rtde_set_watchdog`).

use super::registers::Input;

/// What happens when the input is not written in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WatchdogAction {
    /// The program waits.
    Pause,
    /// The program ends.
    Stop,
    /// Nothing.
    Ignore,
}

/// All watchdogs of a program.
#[derive(Debug, Default)]
pub struct Watchdogs(Vec<Watchdog>);

#[derive(Debug)]
struct Watchdog {
    input: Input,
    period_s: f64,
    last_s: f64,
    action: WatchdogAction,
}

impl Watchdogs {
    /// Sets one; an input has at most one.
    pub fn set(&mut self, input: Input, period_s: f64, now_s: f64, action: WatchdogAction) {
        self.0.retain(|watchdog| watchdog.input != input);
        self.0.push(Watchdog {
            input,
            period_s,
            last_s: now_s,
            action,
        });
    }

    /// The input was written.
    pub fn feed(&mut self, input: Input, now_s: f64) {
        self.0
            .iter_mut()
            .filter(|watchdog| watchdog.input == input)
            .for_each(|watchdog| watchdog.last_s = now_s);
    }

    /// The action of one whose input was not written in time.
    pub fn bite(&self, now_s: f64) -> Option<WatchdogAction> {
        let late = |watchdog: &&Watchdog| now_s - watchdog.last_s > watchdog.period_s + 1e-9;
        self.0.iter().find(late).map(|watchdog| watchdog.action)
    }

    /// Nothing of them stays.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}
