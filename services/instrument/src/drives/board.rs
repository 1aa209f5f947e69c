//! What is known of the drives at this moment, for everybody to read.

use std::time::Duration;

use epos4_link::canopen::nmt;
use epos4_link::cia402::{State, Statusword};
use epos4_link::frame::error::Counters;
use tokio::sync::watch;

use crate::axis::Axis;
use crate::bite::Jaw;
use crate::config::Cell;
use crate::positioning::Sample;
use crate::supervisor::Fault;

pub use epos4_link::network::Identity;

/// The state of all axes, of the jaw and of the bus.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Snapshot {
    /// In the order of [`Axis::ALL`].
    pub axes: [AxisState; 4],
    /// The jaw.
    pub jaw: Jaw,
    /// The bus.
    pub bus: BusState,
    /// The newest time of the bus, on which samples are dated.
    pub now: Duration,
}

/// The state of one axis.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct AxisState {
    /// Whether its drive can be commanded.
    pub readiness: Readiness,
    /// Its drive's identity, once it was read.
    pub identity: Option<Identity>,
    /// The newest measurement.
    pub sample: Option<Sample>,
    /// The newest NMT state.
    pub nmt_state: Option<nmt::State>,
    /// Whether safe torque off is active, once it was read.
    pub safe_torque_off: Option<bool>,
    /// How far the thermal models are used up, once it was read.
    pub i2t: Option<I2t>,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// The operation under way.
    pub operation_id: Option<String>,
    /// Whether that operation moves the axis.
    pub moving: bool,
}

/// Object 0x3200: at 100 % the drive limits its current to the nominal one.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct I2t {
    /// Of the motor, percent.
    pub motor_percent: u16,
    /// Of the power stage, percent.
    pub power_stage_percent: u16,
}

/// The bus of the drives.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct BusState {
    /// Whether it can be used.
    pub condition: BusCondition,
    /// Why not, or what the controller reported last.
    pub detail: String,
    /// Of this host's controller, where it tells them.
    pub counters: Option<Counters>,
    /// The share of the last second in which the bus was taken at most, 0 to 1 and more.
    pub load: f64,
    /// Bits a second, as configured.
    pub bit_rate: u32,
}

/// Whether a bus can be used.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum BusCondition {
    /// Not connected.
    #[default]
    Down,
    /// Connected, and its controller takes part.
    Active,
    /// Connected, with many errors.
    ErrorPassive,
    /// Its controller has left the bus; it comes back when an operator recovers an axis.
    Off,
}

/// Whether a drive can be commanded.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Readiness {
    /// Identified, set up, and watched.
    Ready,
    /// Not, and why.
    NotReady {
        /// A stable SCREAMING_SNAKE word.
        reason: &'static str,
        /// What was found.
        detail: String,
    },
}

impl Default for Readiness {
    fn default() -> Self {
        Self::NotReady {
            reason: "BUS_LOST",
            detail: "the bus is not connected".to_owned(),
        }
    }
}

impl Snapshot {
    /// How old the newest measurement of an axis is, on the clock of the bus.
    pub fn age(&self, axis: Axis) -> Option<Duration> {
        let sample = self.axes[axis.index()].sample?;
        Some(self.now.saturating_sub(sample.stamp))
    }
}

impl AxisState {
    /// Whether its position refers to the home point.
    pub fn is_homed(&self) -> bool {
        self.sample
            .is_some_and(|sample| sample.statusword.has(Statusword::REFERENCED))
    }
}

/// Where the snapshot stands. Clones are the same board.
#[derive(Clone, Default)]
pub(super) struct Board(watch::Sender<Snapshot>);

impl Board {
    pub(super) fn snapshot(&self) -> Snapshot {
        self.0.borrow().clone()
    }

    /// The jaw as it was left, unless its axis contradicts.
    pub(super) fn jaw(&self, cell: &Cell) -> Jaw {
        let state = self.0.borrow();
        let feed = Axis::ForcepsFeed.index();
        let tolerance_mm = cell.axes[feed].spec.tolerance;
        let sample = state.axes[feed].sample.as_ref();
        state.jaw.held_against(&cell.bite, tolerance_mm, sample)
    }

    pub(super) fn subscribe(&self) -> watch::Receiver<Snapshot> {
        self.0.subscribe()
    }

    pub(super) fn update(&self, change: impl FnOnce(&mut Snapshot)) {
        self.0.send_modify(change);
    }

    pub(super) fn update_axis(&self, axis: Axis, change: impl FnOnce(&mut AxisState)) {
        self.0
            .send_modify(|snapshot| change(&mut snapshot.axes[axis.index()]));
    }

    pub(super) fn identity(&self, axis: Axis) -> Option<Identity> {
        self.0.borrow().axes[axis.index()].identity
    }

    pub(super) fn fault(&self, axis: Axis) -> Option<Fault> {
        self.0.borrow().axes[axis.index()].fault.clone()
    }

    pub(super) fn drive_state(&self, axis: Axis) -> Option<State> {
        let state = self.0.borrow();
        state.axes[axis.index()].sample?.statusword.state()
    }

    pub(super) fn is_ready(&self, axis: Axis) -> bool {
        self.0.borrow().axes[axis.index()].readiness == Readiness::Ready
    }

    pub(super) fn is_commanded(&self, axis: Axis) -> bool {
        self.0.borrow().axes[axis.index()].operation_id.is_some()
    }
}
