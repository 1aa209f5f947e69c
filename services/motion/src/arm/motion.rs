//! A move under way: what to command next, how far it is, and when it has arrived.
//!
//! Every move is a stream of joint samples, one for each controller cycle of its nominal time. Sample n is a function of
//! n alone: whatever the speed slider, late packages or the pace of a simulated clock do, the arm is commanded the same
//! samples in the same order, and only the time that they take differs.

use tokio::sync::watch;
use ur_link::{Command, State, Stream};

use crate::command::{Authorization, Progress};
use crate::error::Error;
use crate::kinematics::{Joints, largest_difference};
use crate::plan::Plan;
use crate::supervisor::{Observation, Regime};
use crate::way::Way;

/// A joint this near to its target has arrived, rad: 0.1 mm at a lever of 300 mm.
const ARRIVED_RAD: f64 = 3e-4;
/// A joint slower than this stands, rad/s.
pub const STANDING_RAD_S: f64 = 0.005;
/// Controller time at nominal speed for arriving once the last sample was commanded, s.
const SETTLE_S: f64 = 2.0;
/// Longest move, in samples: an hour at 500 a second.
const SAMPLES_MAX: f64 = 1_800_000.0;

/// One move of one arm.
pub struct Motion {
    /// Who asked for it.
    pub by: Authorization,
    way: Way,
    regime: Regime,
    stream: Stream,
    period_s: f64,
    /// Number of the last sample.
    last: i32,
    /// The sample pushed last.
    joints: Joints,
    progress: watch::Sender<Progress>,
    fraction: f64,
    rcm_deviation_max_mm: f64,
    /// Time at nominal speed since the last sample was commanded, s.
    settling_s: f64,
}

/// What a controller cycle of a motion comes to.
pub enum Step {
    /// Send this.
    Go(Command),
    /// It is there.
    Arrived,
    /// It cannot go on: reason and detail.
    Failed(&'static str, String),
}

impl Motion {
    /// Begins a plan from the commanded joints `start`, for a controller with this period.
    ///
    /// # Errors
    /// A way that takes too long.
    pub fn new(
        by: Authorization,
        plan: Plan,
        start: Joints,
        period_s: f64,
    ) -> Result<(Self, watch::Receiver<Progress>), Error> {
        let Plan { way, regime } = plan;
        // A tenth of a sample of rounding must not add another.
        let samples = (way.duration_s() / period_s - 0.1).ceil();
        if !(..=SAMPLES_MAX).contains(&samples) {
            return Err(Error::TooSlow {
                duration_s: way.duration_s(),
                limit_s: SAMPLES_MAX * period_s,
            });
        }
        let (progress, follow) = watch::channel(Progress {
            operation: by.running(),
            fraction: 0.0,
            rcm_deviation_max_mm: 0.0,
        });
        let motion = Self {
            by,
            way,
            regime,
            stream: Stream::new(),
            period_s,
            last: (samples as i32).max(1),
            joints: start,
            progress,
            fraction: 0.0,
            rcm_deviation_max_mm: 0.0,
            settling_s: 0.0,
        };
        Ok((motion, follow))
    }

    /// Which rules hold for it.
    pub fn regime(&self) -> Regime {
        self.regime
    }

    /// Takes note of what was measured, and decides what to command.
    pub fn step(&mut self, state: &State, seen: &Observation) -> Step {
        if let Some(placement) = seen.placement.filter(|_| seen.inside) {
            self.rcm_deviation_max_mm = self.rcm_deviation_max_mm.max(placement.deviation_mm());
        }
        let consumed = state.program.sample_consumed;
        if let Err(error) = self.stream.consume(consumed) {
            return Step::Failed("STREAM_BROKEN", error.to_string());
        }
        if let Err(error) = self.fill() {
            return Step::Failed("NO_SAMPLE", error.to_string());
        }
        self.fraction = self.way.fraction(f64::from(consumed) * self.period_s);
        self.publish();
        let Some(window) = self.stream.window() else {
            // Filled above.
            return Step::Failed("NO_SAMPLE", "the window is not full".to_owned());
        };
        let command = Command::Stream(window);
        if !self.stream.is_consumed() {
            return Step::Go(command);
        }
        let arrived = largest_difference(&self.joints, &state.actual_q).1 <= ARRIVED_RAD;
        if arrived && stands(state) {
            self.fraction = 1.0;
            return Step::Arrived;
        }
        // A slider far down makes the rest of the way as slow as the way before it.
        self.settling_s += seen.gap_s * state.speed_scaling.clamp(0.0, 1.0);
        // A NaN is in no range.
        if !(..=SETTLE_S).contains(&self.settling_s) {
            let detail = format!("the arm has not come to stand at its target within {SETTLE_S} s");
            return Step::Failed("TARGET_MISSED", detail);
        }
        Step::Go(command)
    }

    /// Computes the samples that the window lacks.
    fn fill(&mut self) -> Result<(), Error> {
        while self.stream.wants() {
            let number = self.stream.next_number();
            let is_last = number >= self.last;
            let time_s = if is_last {
                self.way.duration_s()
            } else {
                f64::from(number) * self.period_s
            };
            self.joints = self.way.sample(time_s, &self.joints)?;
            self.stream.push(self.joints);
            if is_last {
                self.stream.end();
            }
        }
        Ok(())
    }

    /// For people: what was measured on the way.
    pub fn summary(&self) -> String {
        match self.regime() {
            Regime::Standing | Regime::Outside => {
                format!("{:.0} % of the way", 100.0 * self.fraction)
            }
            Regime::Inward | Regime::Outward => format!(
                "{:.0} % of the way, the shaft at most {:.4} mm from the portal while inside",
                100.0 * self.fraction,
                self.rcm_deviation_max_mm
            ),
        }
    }

    /// Tells those that follow how it ended.
    pub fn end(self, operation: arthro_authority::Operation) {
        self.progress.send_replace(Progress {
            operation,
            fraction: self.fraction,
            rcm_deviation_max_mm: self.rcm_deviation_max_mm,
        });
    }

    fn publish(&self) {
        self.progress.send_modify(|progress| {
            progress.fraction = self.fraction;
            progress.rcm_deviation_max_mm = self.rcm_deviation_max_mm;
        });
    }
}

/// Whether no joint moves.
pub fn stands(state: &State) -> bool {
    state
        .actual_qd
        .iter()
        .all(|speed| speed.abs() <= STANDING_RAD_S)
}

#[cfg(test)]
mod tests;
