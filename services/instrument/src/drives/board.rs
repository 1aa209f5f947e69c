//! What is known of the drives at this moment, for everybody to read.

use epos4_link::canopen::nmt;
use epos4_link::cia402::Statusword;
use tokio::sync::watch;

use crate::axis::Axis;
use crate::bite::Jaw;
use crate::positioning::Sample;
use crate::supervisor::Fault;

/// The state of all axes and of the jaw.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Snapshot {
    /// In the order of [`Axis::ALL`].
    pub axes: [AxisState; 4],
    /// The jaw.
    pub jaw: Jaw,
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
