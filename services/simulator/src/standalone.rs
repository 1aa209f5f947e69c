//! One device without a cell around it, for anybody's tests: `arthro-simulator ur5` and `arthro-simulator epos4`.

pub mod epos4;
mod flags;
pub mod ur5;

use std::time::Duration;

use tokio::time::Instant;

/// A device's clock against the wall clock: sleeps while it is ahead, and does not run after lost time.
#[derive(Debug)]
struct Pace {
    period: Duration,
    due: Instant,
}

/// Later than this, the clock takes the time as it is and does not catch up.
const MAX_LAG: Duration = Duration::from_millis(100);

impl Pace {
    /// Steps of the device's clock, `time_scale` times as fast as the wall clock.
    fn new(step_s: f64, time_scale: f64) -> Self {
        Self {
            period: Duration::from_secs_f64(step_s / time_scale),
            due: Instant::now(),
        }
    }

    /// Waits until the next step is due.
    async fn next(&mut self) {
        self.due += self.period;
        let now = Instant::now();
        if self.due > now {
            tokio::time::sleep_until(self.due).await;
        } else if now > self.due + MAX_LAG {
            self.due = now;
        }
    }
}
