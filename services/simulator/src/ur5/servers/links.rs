//! The connections of one controller, and the faults that hold on them.

use std::sync::{
    Arc, Mutex, Weak,
    atomic::{AtomicBool, AtomicU64, Ordering},
};

use tokio::sync::Notify;

use super::{lock, outlet::Outlet};
use crate::ur5::link_fault::{Active, Fate, Faults, Kind, Place, Service, Spec};

/// All connections, and what is wrong with them. Costs a load where nothing is.
#[derive(Debug, Default)]
pub struct Links {
    faults: Mutex<Faults>,
    /// A fault is in force.
    any: AtomicBool,
    /// A connection holds something back, so that the clock must look.
    held: AtomicBool,
    /// Bits of the controller's time, s.
    now_s: AtomicU64,
    outlets: Mutex<Vec<Weak<Outlet>>>,
    /// A fault came, went, or met a packet.
    changed: Notify,
}

impl Links {
    /// Puts a fault in force. False when there are too many.
    pub fn inject(&self, id: u64, spec: Spec) -> bool {
        let (reset, service) = (spec.kind == Kind::Reset, spec.service);
        let added = {
            let mut faults = lock(&self.faults);
            let added = faults.add(id, spec);
            self.any.store(!faults.list().is_empty(), Ordering::Release);
            added
        };
        if added && reset {
            self.reset(service);
        }
        self.changed.notify_waiters();
        added
    }

    /// Ends a fault, or all; how many.
    pub fn clear(&self, id: Option<u64>) -> usize {
        let cleared = {
            let mut faults = lock(&self.faults);
            let cleared = faults.clear(id);
            self.any.store(!faults.list().is_empty(), Ordering::Release);
            cleared
        };
        self.changed.notify_waiters();
        cleared
    }

    /// The faults in force, and those that have met their limit.
    pub fn list(&self) -> Vec<Active> {
        lock(&self.faults).list().to_vec()
    }

    /// Packets and connections that this fault has met; `None` when there is no such fault.
    pub fn affected(&self, id: u64) -> Option<u64> {
        let faults = lock(&self.faults);
        let fault = faults.list().iter().find(|fault| fault.id == id);
        fault.map(|fault| fault.affected)
    }

    /// Waits for the next change of any fault or its count. Enable it before looking.
    pub fn changed(&self) -> tokio::sync::futures::Notified<'_> {
        self.changed.notified()
    }

    /// Time goes on: what was delayed may be due.
    pub(super) fn ticked(&self, now_s: f64) {
        self.now_s.store(now_s.to_bits(), Ordering::Release);
        if !self.held.swap(false, Ordering::AcqRel) {
            return;
        }
        for outlet in self.living() {
            outlet.release(now_s);
        }
    }

    /// A connection holds something back.
    pub(super) fn hold(&self) {
        self.held.store(true, Ordering::Release);
    }

    pub(super) fn enter(&self, outlet: &Arc<Outlet>) {
        let mut outlets = lock(&self.outlets);
        outlets.retain(|outlet| outlet.strong_count() > 0);
        outlets.push(Arc::downgrade(outlet));
    }

    /// What becomes of a packet to a client.
    pub(super) fn outgoing(&self, service: Service, packet: &mut [u8], places: &[Place]) -> Fate {
        let now_s = f64::from_bits(self.now_s.load(Ordering::Acquire));
        let fate = lock(&self.faults).outgoing(service, packet, places, now_s);
        self.changed.notify_waiters();
        fate
    }

    /// Whether a packet from a client is taken in.
    pub(super) fn incoming(&self, service: Service, packet: &mut [u8]) -> bool {
        let taken = lock(&self.faults).incoming(service, packet);
        self.changed.notify_waiters();
        taken
    }

    pub(super) fn has_faults(&self) -> bool {
        self.any.load(Ordering::Acquire)
    }

    /// Answers must wait.
    pub(super) fn stalls(&self, service: Service) -> bool {
        self.has_faults() && lock(&self.faults).holds(service, &Kind::Stall)
    }

    /// A new connection meets a fault of this kind.
    pub(super) fn meets(&self, service: Service, kind: &Kind) -> bool {
        let met = self.has_faults() && lock(&self.faults).meet(service, kind);
        if met {
            self.changed.notify_waiters();
        }
        met
    }

    fn reset(&self, only: Option<Service>) {
        for outlet in self.living() {
            let service = outlet.service();
            if only.is_none_or(|only| only == service) && self.meets(service, &Kind::Reset) {
                outlet.reset();
            }
        }
    }

    fn living(&self) -> Vec<Arc<Outlet>> {
        lock(&self.outlets)
            .iter()
            .filter_map(Weak::upgrade)
            .collect()
    }
}
