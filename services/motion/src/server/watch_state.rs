//! The stream of states, paced by the controllers' clock.

use arthro_proto::motion::v1 as proto;
use tokio::sync::{mpsc, watch};
use tonic::Status;

use super::{Which, fields};
use crate::arm::Published;
use crate::error::Error;

/// Shortest and longest period, and the one when none is given, s.
const PERIOD_MIN_S: f64 = 0.008;
const PERIOD_MAX_S: f64 = 10.0;
const PERIOD_DEFAULT_S: f64 = 0.1;

/// The period asked for, s.
pub fn period_s(asked_s: f64) -> Result<f64, Error> {
    if asked_s == 0.0 {
        return Ok(PERIOD_DEFAULT_S);
    }
    if (PERIOD_MIN_S..=PERIOD_MAX_S).contains(&asked_s) {
        return Ok(asked_s);
    }
    Err(Error::invalid(
        "period_s",
        format!("is {asked_s} s; must be 0 or within {PERIOD_MIN_S} .. {PERIOD_MAX_S} s"),
    ))
}

/// Sends a first message at once, then one whenever an arm's clock has advanced by the period, a link
/// came or went, or a fault or a warning came or went, until nobody listens.
pub async fn tell(
    mut arms: [(Which, watch::Receiver<Published>); 2],
    period_s: f64,
    sender: mpsc::Sender<Result<proto::WatchStateResponse, Status>>,
) {
    let mut told: Option<[Mark; 2]> = None;
    loop {
        let marks = [Mark::of(&mut arms[0].1), Mark::of(&mut arms[1].1)];
        let due = told
            .as_ref()
            .is_none_or(|told| (0..2).any(|arm| marks[arm].is_due(&told[arm], period_s)));
        if due {
            told = Some(marks);
            let states = arms.iter().filter_map(|(which, published)| {
                let published = published.borrow();
                let state = published.state.as_ref()?;
                Some(fields::arm_state(*which, state))
            });
            let arms = states.collect();
            if sender
                .send(Ok(proto::WatchStateResponse { arms }))
                .await
                .is_err()
            {
                return;
            }
        }
        let [(_, forceps), (_, arthroscope)] = &mut arms;
        let changed = tokio::select! {
            changed = forceps.changed() => changed,
            changed = arthroscope.changed() => changed,
            () = sender.closed() => return,
        };
        if changed.is_err() {
            return;
        }
    }
}

/// What a message is due by.
struct Mark {
    time_s: f64,
    connected: bool,
    faulty: bool,
    warned: bool,
}

impl Mark {
    fn of(published: &mut watch::Receiver<Published>) -> Self {
        let published = published.borrow_and_update();
        let state = published.state.as_ref();
        Self {
            time_s: state.map_or(0.0, |state| state.time_s),
            connected: published.connected,
            faulty: state.is_some_and(|state| state.fault.is_some()),
            warned: state.is_some_and(|state| state.warning.is_some()),
        }
    }

    /// A clock that runs backwards is that of a controller that was started again.
    fn is_due(&self, told: &Self, period_s: f64) -> bool {
        // Sums of periods are not exact: half a controller cycle of grace.
        let elapsed_s = self.time_s - told.time_s + 0.5 * PERIOD_MIN_S;
        elapsed_s >= period_s
            || self.time_s < told.time_s
            || self.connected != told.connected
            || self.faulty != told.faulty
            || self.warned != told.warned
    }
}
