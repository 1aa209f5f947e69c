//! The cell's clock: ticks controllers, drives and the truth in lock step, at a chosen multiple of
//! the wall clock or as near to it as the machine and the clients allow.
//!
//! Above real time every tick waits for the clients that close a loop over it, and for a heartbeat that
//! a drive would miss, so that they are never outrun. Ahead of its time the clock sleeps; behind it, it does not run after lost time.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use crate::cell::{Cell, TICK_S};
use crate::epos4::Bus;
use crate::ur5;

/// How fast the clock shall run and how long it waits for a client.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Cell seconds a wall second.
    pub time_scale: f64,
    /// Bound of the wait for clients in each tick.
    pub client_wait: Duration,
}

/// What the clock drives.
#[derive(Debug)]
pub struct Driven {
    /// The truth.
    pub cell: Arc<Mutex<Cell>>,
    /// Both controllers, forceps first.
    pub arms: [Arm; 2],
    /// The drives.
    pub bus: Arc<Bus>,
}

/// A controller and the services that show it.
#[derive(Debug)]
pub struct Arm {
    /// The controller.
    pub controller: ur5::Shared,
    /// Its services.
    pub servers: ur5::Servers,
}

/// What anybody may read off the clock.
#[derive(Clone, Debug)]
pub struct Handle {
    asked: f64,
    reached: Arc<Mutex<f64>>,
}

impl Handle {
    /// The speed asked for.
    pub fn time_scale(&self) -> f64 {
        self.asked
    }

    /// The speed of the last two seconds.
    pub fn time_scale_reached(&self) -> f64 {
        *lock(&self.reached)
    }
}

/// A wake-up nearer than this is not worth a sleep: the timer's grain is a millisecond.
const GRAIN: Duration = Duration::from_millis(1);
/// Later than this, the clock takes the time as it is and does not catch up.
const MAX_LAG: Duration = Duration::from_millis(100);
/// The speed is measured over this.
const MEASURED: Duration = Duration::from_secs(2);
/// And anew this often.
const MEASURE_EVERY: Duration = Duration::from_millis(100);

/// Starts the clock; it runs until the task is aborted.
pub fn start(options: Options, driven: Driven) -> (Handle, tokio::task::JoinHandle<()>) {
    let handle = Handle {
        asked: options.time_scale,
        reached: Arc::new(Mutex::new(0.0)),
    };
    let task = tokio::spawn(run(options, driven, Arc::clone(&handle.reached)));
    (handle, task)
}

async fn run(options: Options, driven: Driven, reached: Arc<Mutex<f64>>) {
    let steps = driven.steps();
    let period = Duration::from_secs_f64(TICK_S / f64::from(steps) / options.time_scale);
    let mut step = 0;
    let mut due = Instant::now();
    let mut speedometer = Speedometer::default();
    loop {
        due += period;
        let now = Instant::now();
        if due > now + GRAIN {
            tokio::time::sleep_until(due).await;
        } else if now > due + MAX_LAG {
            due = now;
        }
        step = step % steps + 1;
        driven.step(step, steps);
        if options.time_scale > 1.0 {
            let [forceps, arthroscope] = &driven.arms;
            tokio::join!(
                forceps.servers.wait_for_clients(options.client_wait),
                arthroscope.servers.wait_for_clients(options.client_wait),
                driven.bus.wait_for_heartbeats(TICK_S, options.client_wait),
            );
        }
        // The connections of the wires are tasks of the same runtime.
        tokio::task::yield_now().await;
        if step == steps
            && let Some(speed) = speedometer.tick(Instant::now())
        {
            *lock(&reached) = speed;
        }
    }
}

impl Driven {
    /// Steps of a tick: as many as the fastest controller has cycles in it.
    fn steps(&self) -> u32 {
        let cycles = self.arms.iter().map(Arm::cycles);
        cycles.max().unwrap_or(1)
    }

    /// One step of a tick; the last one completes it.
    fn step(&self, step: u32, steps: u32) {
        let due = self.arms.each_ref().map(|arm| {
            let every = steps / arm.cycles();
            step.is_multiple_of(every)
        });
        for (arm, due) in self.arms.iter().zip(due) {
            if due {
                lock(&arm.controller).tick();
            }
        }
        if step == steps {
            self.tick_cell();
        }
        for (arm, due) in self.arms.iter().zip(due) {
            if due {
                arm.servers.ticked();
            }
        }
    }

    fn tick_cell(&self) {
        let joints_rad = self
            .arms
            .each_ref()
            .map(|arm| lock(&arm.controller).joints_rad());
        lock(&self.cell).tick(&joints_rad, |dt_s, now_s, mechanics| {
            self.bus.tick(dt_s, now_s, mechanics);
            self.bus.with_drives(|drives| {
                let mut shafts_qc = [0.0; 4];
                for (shaft_qc, node) in shafts_qc.iter_mut().zip(&drives.nodes) {
                    *shaft_qc = node.position_quadcounts();
                }
                shafts_qc
            })
        });
    }
}

impl Arm {
    /// Controller cycles in a tick: 1 of a CB3, 4 of an e-Series.
    fn cycles(&self) -> u32 {
        (TICK_S / lock(&self.controller).step_s()).round() as u32
    }
}

/// Measures the speed of the cell's clock against the wall clock.
#[derive(Debug, Default)]
struct Speedometer {
    ticks: u64,
    marks: VecDeque<(Instant, u64)>,
}

impl Speedometer {
    /// Counts a tick; now and then the speed.
    fn tick(&mut self, now: Instant) -> Option<f64> {
        self.ticks += 1;
        let newest = self.marks.back();
        if newest.is_some_and(|(at, _)| now - *at < MEASURE_EVERY) {
            return None;
        }
        self.marks.push_back((now, self.ticks));
        while self.marks.len() > 2 && now - self.marks[0].0 > MEASURED {
            self.marks.pop_front();
        }
        let (from, ticks) = self.marks[0];
        let wall_s = (now - from).as_secs_f64();
        (wall_s > 0.0).then(|| (self.ticks - ticks) as f64 * TICK_S / wall_s)
    }
}

/// A value behind a lock stays whole if a thread panics with it: every change is a plain store or a
/// tick that the next one continues.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speedometer_shows_cell_time_over_wall_time() {
        let mut speedometer = Speedometer::default();
        let start = Instant::now();
        let mut shown = None;
        for tick in 0..5000_u32 {
            // 1 ms of wall for 8 ms of cell.
            shown = speedometer
                .tick(start + Duration::from_millis(tick.into()))
                .or(shown);
        }
        assert!((shown.unwrap() - 8.0).abs() < 1e-9, "{shown:?}");
    }
}
