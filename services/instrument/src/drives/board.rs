//! What is known of the drives at this moment, for everybody to read.

use std::time::Duration;

use epos4_link::canopen::nmt;
use epos4_link::cia402::Statusword;
use tokio::sync::watch;

use crate::axis::Axis;
use crate::bite::Jaw;
use crate::config::Cell;
use crate::positioning::Sample;
use crate::supervisor::Fault;

/// The state of all axes and of the jaw.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Snapshot {
    /// In the order of [`Axis::ALL`].
    pub axes: [AxisState; 4],
    /// The jaw.
    pub jaw: Jaw,
    /// The bus.
    pub bus: BusState,
}

/// The bus.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct BusState {
    /// How it does.
    pub condition: BusCondition,
    /// Why it is down.
    pub detail: String,
    /// Of this host's controller, where it tells them: transmit and receive.
    pub error_counters: Option<[u32; 2]>,
    /// The share of the bit rate that is used.
    pub load: Option<f64>,
    /// bit/s.
    pub bit_rate: u32,
    /// The newest time on its clock.
    pub now: Duration,
}

/// How the bus does.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum BusCondition {
    /// Not connected.
    #[default]
    Down,
    /// All is well.
    Active,
    /// Many errors.
    ErrorPassive,
    /// This host's controller has left it.
    Off,
}

/// What is read of a drive now and then.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Vitals {
    /// Object 0x3202:01: one of the two inputs has no voltage.
    pub safe_torque_off: Option<bool>,
    /// Object 0x3200:01.
    pub i2t_motor_percent: Option<u16>,
    /// Object 0x3200:02.
    pub i2t_power_stage_percent: Option<u16>,
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
    /// What is read now and then.
    pub vitals: Vitals,
    /// The newest NMT state.
    pub nmt_state: Option<nmt::State>,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// The operation under way.
    pub operation_id: Option<String>,
    /// Whether that operation moves the axis.
    pub moving: bool,
}

/// Whether a drive can be commanded.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Readiness {
    /// Identified, set up, and watched.
    Ready,
    /// Not, and why.
    NotReady(String),
}

/// Object 0x1018.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Identity {
    /// Subindex 1.
    pub vendor_id: u32,
    /// Subindex 2.
    pub product_code: u32,
    /// Subindex 3.
    pub revision: u32,
    /// Subindex 4.
    pub serial_number: u32,
}

impl Default for Readiness {
    fn default() -> Self {
        Self::NotReady("the bus is not connected".to_owned())
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

    pub(super) fn is_ready(&self, axis: Axis) -> bool {
        self.0.borrow().axes[axis.index()].readiness == Readiness::Ready
    }

    pub(super) fn is_commanded(&self, axis: Axis) -> bool {
        self.0.borrow().axes[axis.index()].operation_id.is_some()
    }
}
