//! Lets the recorded time pass, and tells what stood at each moment.
//!
//! A thread reads, one line ahead of what is due; a task waits until a line is due and publishes it. What lies before the
//! beginning that was asked for is taken in at once, so that everything stands as it stood then.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use arthro_proto::{gateway, instrument, motion};
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;

use super::Config;
use crate::recording::read::{Lines, ReadError};
use crate::recording::segment::Line;
use crate::recording::topics::Topic;

/// Lines that are read ahead.
const AHEAD: usize = 256;
/// A pause between two files, or between two lines, is shown no longer than this, recorded time: a night between an
/// interruption and its recovery is not waited for.
const PAUSE_MAX_NS: u64 = 5_000_000_000;

/// A recording that goes on; clones show the same.
#[derive(Clone, Debug)]
pub struct Player {
    /// The procedure as it goes on; gone when the recording is at its end.
    pub procedure: watch::Receiver<Option<gateway::v1::Procedure>>,
    /// Both arms, with the recorded time, ns.
    pub arms: watch::Receiver<(u64, motion::v1::WatchStateResponse)>,
    /// All axes, likewise.
    pub axes: watch::Receiver<(u64, instrument::v1::WatchStateResponse)>,
    shown: Arc<Mutex<Shown>>,
}

/// Everything else that stood at this moment.
#[derive(Clone, Debug, Default)]
pub struct Shown {
    /// By sequence.
    pub steps: BTreeMap<u32, gateway::v1::Step>,
    /// By bite and by when it was taken: a bite that was repeated is there twice.
    pub bites: Vec<gateway::v1::BiteOutcome>,
    /// The arms' limits and portals.
    pub cell: Option<motion::v1::GetCellResponse>,
    /// The axes' travels.
    pub axes: Option<instrument::v1::ListAxesResponse>,
}

/// The ends that publish.
struct Stage {
    procedure: watch::Sender<Option<gateway::v1::Procedure>>,
    arms: watch::Sender<(u64, motion::v1::WatchStateResponse)>,
    axes: watch::Sender<(u64, instrument::v1::WatchStateResponse)>,
    shown: Arc<Mutex<Shown>>,
}

impl Player {
    /// Begins to play files that were checked. Must be called within a Tokio runtime.
    pub fn start(config: Config, begins_ns: u64) -> Self {
        let stage = Stage {
            procedure: watch::Sender::default(),
            arms: watch::Sender::default(),
            axes: watch::Sender::default(),
            shown: Arc::default(),
        };
        let player = Self {
            procedure: stage.procedure.subscribe(),
            arms: stage.arms.subscribe(),
            axes: stage.axes.subscribe(),
            shown: stage.shown.clone(),
        };
        let (ahead, lines) = mpsc::channel(AHEAD);
        let (files, repeat) = (config.files.clone(), config.repeat);
        tokio::task::spawn_blocking(move || read_on(&files, repeat, &ahead));
        tokio::spawn(play(config, begins_ns, lines, stage));
        player
    }

    /// Everything else that stands now.
    pub fn shown(&self) -> Shown {
        self.shown
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

/// `None` stands between two rounds.
fn read_on(files: &[PathBuf], repeat: bool, ahead: &mpsc::Sender<Option<Line>>) {
    loop {
        for path in files {
            if let Err(error) = read_one(path, ahead) {
                tracing::error!(%error, "the recording cannot be read on");
                return;
            }
        }
        if !repeat || ahead.blocking_send(None).is_err() {
            return;
        }
    }
}

fn read_one(path: &std::path::Path, ahead: &mpsc::Sender<Option<Line>>) -> Result<(), ReadError> {
    let mut lines = Lines::open(path)?;
    while let Some(line) = lines.next_line()? {
        if ahead.blocking_send(Some(line)).is_err() {
            // Nobody looks any more.
            break;
        }
    }
    Ok(())
}

async fn play(
    config: Config,
    begins_ns: u64,
    mut lines: mpsc::Receiver<Option<Line>>,
    stage: Stage,
) {
    let skipped_ns = (config.from_s * 1e9) as u64;
    let from_ns = begins_ns.saturating_add(skipped_ns);
    let mut clock = Clock::new(config.speed);
    while let Some(line) = lines.recv().await {
        let Some(line) = line else {
            tracing::info!("the recording begins again");
            stage.clear();
            clock = Clock::new(config.speed);
            continue;
        };
        if line.at_ns >= from_ns {
            tokio::time::sleep_until(clock.due(line.at_ns, Instant::now())).await;
        }
        stage.take(&line);
    }
    tracing::info!("the recording is at its end");
    // What stands last goes on being shown to those who ask; watches of the procedure end.
    let Stage {
        procedure,
        arms,
        axes,
        ..
    } = stage;
    drop(procedure);
    tokio::join!(arms.closed(), axes.closed());
}

/// Recorded time on the clock of this machine.
struct Clock {
    speed: f64,
    last: Option<(u64, Instant)>,
}

impl Clock {
    fn new(speed: f64) -> Self {
        Self { speed, last: None }
    }

    /// When a line is due, counted from the one before; the first one is due now.
    fn due(&mut self, at_ns: u64, now: Instant) -> Instant {
        let (last_ns, last_due) = *self.last.get_or_insert((at_ns, now));
        let recorded_ns = at_ns.saturating_sub(last_ns).min(PAUSE_MAX_NS);
        let due = last_due + Duration::from_nanos(recorded_ns).div_f64(self.speed);
        self.last = Some((at_ns.max(last_ns), due));
        due
    }
}

impl Stage {
    fn take(&self, line: &Line) {
        let message = line.message.as_slice();
        let taken = match line.topic {
            Topic::Procedure => decode(message).map(|procedure| {
                self.procedure.send_replace(Some(procedure));
            }),
            Topic::Arms => decode(message).map(|arms| {
                self.arms.send_replace((line.at_ns, arms));
            }),
            Topic::Axes => decode(message).map(|axes| {
                self.axes.send_replace((line.at_ns, axes));
            }),
            Topic::Step => decode(message).map(|step: gateway::v1::Step| {
                self.show(|shown| shown.steps.insert(step.sequence, step));
            }),
            Topic::Bite => decode(message).map(|bite| {
                self.show(|shown| {
                    // A following file begins with the bites before it.
                    if !shown.bites.contains(&bite) {
                        shown.bites.push(bite);
                    }
                });
            }),
            Topic::Cell => decode(message).map(|cell| self.show(|shown| shown.cell = Some(cell))),
            Topic::AxisList => {
                decode(message).map(|axes| self.show(|shown| shown.axes = Some(axes)))
            }
            // For people and viewers.
            Topic::Recording | Topic::Event | Topic::Transforms | Topic::Scene => Ok(()),
        };
        if let Err(error) = taken {
            tracing::warn!(topic = line.topic.name(), %error, "a line cannot be shown");
        }
    }

    fn show<T>(&self, change: impl FnOnce(&mut Shown) -> T) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut shown);
    }

    fn clear(&self) {
        self.show(|shown| {
            shown.steps.clear();
            shown.bites.clear();
        });
    }
}

fn decode<M: prost::Message + Default>(message: &[u8]) -> Result<M, prost::DecodeError> {
    M::decode(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_time_passes_at_the_speed_asked_for_and_long_pauses_are_cut() {
        let began = Instant::now();
        let after = |millis| began + Duration::from_millis(millis);
        let night_ns = 40_000_000_000_000;
        let mut clock = Clock::new(2.0);
        let lines = [
            (1_000_000_000, 0),
            (3_000_000_000, 1000),
            (night_ns, 3500),
            // Out of order: at once.
            (5, 3500),
            (night_ns + 1_000_000_000, 4000),
        ];
        for (at_ns, due_ms) in lines {
            assert_eq!(clock.due(at_ns, began), after(due_ms), "{at_ns}");
        }
    }
}
