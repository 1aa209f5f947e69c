//! What is done to the drives and to the hosts' controllers.

use epos4_link::frame::Frame;
use epos4_link::frame::error::{Class, Report};

use super::{Bus, Wire};
use crate::epos4::fault::{Active, Fault};

/// Byte 1 of a controller's report: its counters are both beyond 127, or below 96 again.
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

impl Bus {
    /// Does something to one drive, to all, or to the bus; its number. None when too much is done already.
    pub fn inject(&self, node_id: Option<u8>, fault: Fault, seed: u64) -> Option<u64> {
        let mut wire = self.wire();
        let id = wire.drives.inject(node_id, fault, seed)?;
        match fault {
            Fault::BusOff => {
                wire.tell_hosts(fault, report(Class::BUS_OFF, 0));
                wire.members
                    .values_mut()
                    .for_each(|host| host.bus_off = true);
            }
            Fault::ErrorPassive => {
                wire.tell_hosts(fault, report(Class::CONTROLLER, PASSIVE));
            }
            _ => {}
        }
        self.tell_changes(&mut wire);
        Some(id)
    }

    /// Ends a fault, or all; how many.
    pub fn clear(&self, id: Option<u64>) -> usize {
        let mut wire = self.wire();
        let ended = wire.drives.clear(id);
        for active in &ended {
            match active.fault {
                Fault::BusOff => {
                    wire.members
                        .values_mut()
                        .for_each(|host| host.bus_off = false);
                    wire.tell_hosts(active.fault, report(Class::RESTARTED, 0));
                }
                Fault::ErrorPassive => {
                    wire.tell_hosts(active.fault, report(Class::CONTROLLER, ACTIVE));
                }
                _ => {}
            }
        }
        self.tell_changes(&mut wire);
        ended.len()
    }

    /// The faults in force.
    #[must_use]
    pub fn faults(&self) -> Vec<Active> {
        self.wire().drives.faults().list().to_vec()
    }

    /// Waits until a fault has met so many frames; how many. None when there is no fault of this number.
    pub async fn wait_for_fault(&self, id: u64, affected: u64) -> Option<u64> {
        loop {
            let mut changed = std::pin::pin!(self.changed.notified());
            changed.as_mut().enable();
            let faults = self.faults();
            let met = faults.iter().find(|active| active.id == id)?.affected;
            if met >= affected {
                return Some(met);
            }
            changed.await;
        }
    }
}

impl Wire {
    /// Tells every member what its controller reports.
    fn tell_hosts(&mut self, fault: Fault, frame: Frame) {
        let listening = self.members.values().filter(|host| !host.bus_off).count();
        self.publish(&[frame], None);
        self.drives.faults().meet(fault, listening as u64);
    }
}

/// What a controller reports; its state is byte 1.
fn report(class: u32, state: u8) -> Frame {
    Report::frame(class, [0, state, 0, 0, 0, 0, 0, 0])
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use epos4_link::frame::error::ControllerState;

    use super::*;
    use crate::epos4::bus::Member;
    use crate::epos4::{Drives, Node, NodeConfig};

    fn bus() -> Arc<Bus> {
        let bus = Bus::new(Drives::new(vec![Node::new(NodeConfig::new(2, 1))]));
        bus.tick(0.001, 0.001, &[]);
        bus
    }

    const READ: Frame = Frame::standard(0x602, [0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);

    /// The state that a host's controller reports next.
    async fn state(host: &mut Member) -> Option<ControllerState> {
        Report::decode(&host.heard().await?.frame)?.state()
    }

    #[tokio::test]
    async fn bus_off_lets_nothing_pass_until_it_is_cleared() {
        let bus = bus();
        let mut host = bus.join();
        let id = bus.inject(None, Fault::BusOff, 0).unwrap();
        assert_eq!(state(&mut host).await, Some(ControllerState::BusOff));
        host.sender().send(&READ);
        assert_eq!(
            bus.faults()[0].affected,
            2,
            "the report and the lost request"
        );
        assert_eq!(bus.clear(Some(id)), 1);
        assert_eq!(state(&mut host).await, Some(ControllerState::ErrorActive));
        host.sender().send(&READ);
        assert_eq!(host.heard().await.unwrap().frame.cob_id(), Some(0x582));
    }

    #[tokio::test]
    async fn a_host_that_joins_anew_has_a_restarted_controller() {
        let bus = bus();
        let old = bus.join();
        bus.inject(None, Fault::BusOff, 0).unwrap();
        drop(old);
        let mut new = bus.join();
        new.sender().send(&READ);
        assert_eq!(new.heard().await.unwrap().frame.cob_id(), Some(0x582));
    }

    #[tokio::test]
    async fn error_passive_is_reported_and_the_bus_goes_on() {
        let bus = bus();
        let mut host = bus.join();
        let id = bus.inject(None, Fault::ErrorPassive, 0).unwrap();
        assert_eq!(state(&mut host).await, Some(ControllerState::ErrorPassive));
        host.sender().send(&READ);
        assert_eq!(host.heard().await.unwrap().frame.cob_id(), Some(0x582));
        bus.clear(Some(id));
        assert_eq!(state(&mut host).await, Some(ControllerState::ErrorActive));
    }

    #[tokio::test]
    async fn who_waits_for_a_fault_is_told_when_it_has_met_enough_or_is_gone() {
        let bus = bus();
        let host = bus.join();
        let id = bus.inject(Some(2), Fault::SilentSdo, 0).unwrap();
        let waiting = tokio::spawn({
            let bus = Arc::clone(&bus);
            async move { bus.wait_for_fault(id, 2).await }
        });
        host.sender().send(&READ);
        host.sender().send(&READ);
        assert_eq!(waiting.await.unwrap(), Some(2));
        let waiting = tokio::spawn({
            let bus = Arc::clone(&bus);
            async move { bus.wait_for_fault(id, 99).await }
        });
        bus.clear(Some(id));
        assert_eq!(waiting.await.unwrap(), None);
    }
}
