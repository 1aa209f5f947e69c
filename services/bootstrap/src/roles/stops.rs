//! Keeps a flood of stops from one caller within bounds, without ever losing a stop.
//!
//! Each caller has a bucket of stops. When it is empty, a stop is answered without being carried out only if that changes
//! nothing: the same stop of the same caller was carried out within the last second, and no command was taken since.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytes::Bytes;

/// Stops that a caller may ask for in a second.
const PER_SECOND: f64 = 20.0;
/// And at once.
const BURST: f64 = 20.0;
/// For how long a stop counts as just carried out.
const JUST: Duration = Duration::from_secs(1);
/// Stops remembered of each caller.
const REMEMBERED_MAX: usize = 8;
/// Callers remembered.
const CALLERS_MAX: usize = 1024;

/// Memory of the stops of one server.
#[derive(Debug, Default)]
pub(crate) struct Stops {
    commands: AtomicU64,
    callers: Mutex<HashMap<String, Bucket>>,
}

/// How many commands a server had taken at some moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mark(u64);

/// What becomes of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It is carried out.
    CarryOut,
    /// It is answered: it was just carried out and has nothing left to halt.
    JustDone,
}

#[derive(Debug)]
struct Bucket {
    stops: f64,
    at: Duration,
    done: VecDeque<Done>,
}

#[derive(Debug)]
struct Done {
    method: String,
    words: Bytes,
    begun: Mark,
    at: Duration,
}

// === impl Stops ===

impl Stops {
    /// A command was taken: what was stopped before may move again.
    pub(crate) fn commanded(&self) {
        self.commands.fetch_add(1, Ordering::SeqCst);
    }

    /// To be taken before a stop is carried out.
    pub(crate) fn mark(&self) -> Mark {
        Mark(self.commands.load(Ordering::SeqCst))
    }

    /// A caller asks for a stop at `now`.
    pub(crate) fn asked(
        &self,
        caller: &str,
        method: &str,
        words: &Bytes,
        now: Duration,
    ) -> Verdict {
        let mark = self.mark();
        let mut callers = self.callers();
        if callers.len() >= CALLERS_MAX {
            // Whoever has a full bucket is as good as new.
            callers.retain(|_, bucket| bucket.refilled(now) < BURST);
        }
        let bucket = callers
            .entry(caller.to_owned())
            .or_insert_with(|| Bucket::full(now));
        if bucket.take(now) || !bucket.has_done(method, words, mark, now) {
            Verdict::CarryOut
        } else {
            Verdict::JustDone
        }
    }

    /// A stop was carried out; `begun` was marked before.
    pub(crate) fn done(
        &self,
        caller: &str,
        method: &str,
        words: Bytes,
        begun: Mark,
        now: Duration,
    ) {
        if let Some(bucket) = self.callers().get_mut(caller) {
            bucket
                .done
                .retain(|done| done.method != method || done.words != words);
            if bucket.done.len() >= REMEMBERED_MAX {
                bucket.done.pop_front();
            }
            bucket.done.push_back(Done {
                method: method.to_owned(),
                words,
                begun,
                at: now,
            });
        }
    }

    fn callers(&self) -> MutexGuard<'_, HashMap<String, Bucket>> {
        // Nothing panics while it is held, and what it guards is whole at any time.
        self.callers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

// === impl Bucket ===

impl Bucket {
    fn full(now: Duration) -> Self {
        Self {
            stops: BURST,
            at: now,
            done: VecDeque::new(),
        }
    }

    fn refilled(&self, now: Duration) -> f64 {
        let since_s = now.saturating_sub(self.at).as_secs_f64();
        (self.stops + since_s * PER_SECOND).min(BURST)
    }

    fn take(&mut self, now: Duration) -> bool {
        self.stops = self.refilled(now);
        self.at = now;
        let there = self.stops >= 1.0;
        if there {
            self.stops -= 1.0;
        }
        there
    }

    fn has_done(&self, method: &str, words: &Bytes, mark: Mark, now: Duration) -> bool {
        self.done.iter().any(|done| {
            done.method == method
                && done.words == *words
                && done.begun == mark
                && now.saturating_sub(done.at) <= JUST
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOP: &str = "/arthro.motion.v1.MotionService/Stop";

    struct Site {
        stops: Stops,
        now: Duration,
    }

    impl Site {
        fn new() -> Self {
            Self {
                stops: Stops::default(),
                now: Duration::ZERO,
            }
        }

        fn asks(&self, caller: &str, words: &'static str) -> Verdict {
            let words = Bytes::from_static(words.as_bytes());
            let verdict = self.stops.asked(caller, STOP, &words, self.now);
            if verdict == Verdict::CarryOut {
                let begun = self.stops.mark();
                self.stops.done(caller, STOP, words, begun, self.now);
            }
            verdict
        }

        fn flood(&self, caller: &str, count: usize) -> usize {
            (0..count)
                .filter(|_| self.asks(caller, "halt") == Verdict::CarryOut)
                .count()
        }
    }

    #[test]
    fn a_flood_is_carried_out_at_the_rate_of_the_bucket() {
        let mut site = Site::new();
        assert_eq!(site.flood("a", 500), 20);
        for _ in 0..10 {
            site.now += Duration::from_millis(100);
            assert_eq!(site.flood("a", 500), 2);
        }
    }

    #[test]
    fn a_stop_after_a_command_is_carried_out_whatever_came_before() {
        let site = Site::new();
        site.flood("a", 500);
        assert_eq!(site.asks("a", "halt"), Verdict::JustDone);
        site.stops.commanded();
        assert_eq!(site.asks("a", "halt"), Verdict::CarryOut);
    }

    #[test]
    fn a_command_during_a_stop_makes_the_next_one_count() {
        let site = Site::new();
        site.flood("a", 500);
        site.stops.commanded();
        let begun = site.stops.mark();
        site.stops.commanded();
        let words = Bytes::from_static(b"halt");
        site.stops.done("a", STOP, words, begun, site.now);
        assert_eq!(site.asks("a", "halt"), Verdict::CarryOut);
    }

    #[test]
    fn another_caller_and_another_stop_are_not_held_back() {
        let site = Site::new();
        site.flood("a", 500);
        assert_eq!(site.asks("a", "halt the other arm"), Verdict::CarryOut);
        assert_eq!(site.asks("b", "halt"), Verdict::CarryOut);
    }

    #[test]
    fn a_stop_that_failed_is_tried_again() {
        let site = Site::new();
        let words = Bytes::from_static(b"halt");
        for _ in 0..500 {
            let verdict = site.stops.asked("a", STOP, &words, site.now);
            assert_eq!(verdict, Verdict::CarryOut);
        }
    }

    #[test]
    fn many_callers_do_not_fill_the_memory() {
        let mut site = Site::new();
        for caller in 0..10 * CALLERS_MAX {
            site.now += Duration::from_millis(100);
            site.asks(&caller.to_string(), "halt");
        }
        assert!(site.stops.callers().len() <= CALLERS_MAX);
    }
}
