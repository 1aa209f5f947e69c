//! Tells two nodes of one number by their heartbeats: together they send twice as many as one does.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use crate::canopen::nmt;

/// Heartbeats that are looked at together. One node sends them over four periods, two nodes over two. A node whose
/// heartbeat is told with a change of its state, out of turn, needs three.
const HEARTBEATS: usize = 5;

/// The heartbeats of all nodes.
#[derive(Debug)]
pub(super) struct Duplicates {
    period: Duration,
    recent: BTreeMap<u8, Recent>,
}

#[derive(Debug, Default)]
struct Recent {
    heartbeats: VecDeque<Duration>,
    boot_up: Option<Duration>,
}

impl Duplicates {
    /// Nodes send their heartbeats with this period.
    pub(super) fn new(period: Duration) -> Self {
        Self {
            period,
            recent: BTreeMap::new(),
        }
    }

    /// Takes a heartbeat or boot-up; whether it gives a second node away.
    pub(super) fn on_heartbeat(&mut self, node_id: u8, state: nmt::State, stamp: Duration) -> bool {
        let recent = self.recent.entry(node_id).or_default();
        if state == nmt::State::BootUp {
            recent.heartbeats.clear();
            let before = recent.boot_up.replace(stamp);
            return before.is_some_and(|before| stamp.saturating_sub(before) < self.period / 2);
        }
        recent.heartbeats.push_back(stamp);
        if recent.heartbeats.len() < HEARTBEATS {
            return false;
        }
        let first = recent.heartbeats.pop_front().unwrap_or(stamp);
        let span = stamp.saturating_sub(first);
        let told = stamp >= first && span < self.period * 5 / 2;
        if told {
            recent.heartbeats.clear();
        }
        told
    }

    /// The node's heartbeat is about to change by our own order: what came before does not count.
    pub(super) fn forget(&mut self, node_id: u8) {
        self.recent.remove(&node_id);
    }

    /// Likewise of all nodes.
    pub(super) fn forget_all(&mut self) {
        self.recent.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canopen::nmt::State;

    fn told(stamps_ms: &[u64]) -> bool {
        let mut duplicates = Duplicates::new(Duration::from_millis(100));
        let heartbeat = |ms| (ms, State::Operational);
        stamps_ms
            .iter()
            .copied()
            .map(heartbeat)
            .any(|(ms, state)| duplicates.on_heartbeat(1, state, Duration::from_millis(ms)))
    }

    #[test]
    fn twice_the_heartbeats_are_two_nodes() {
        assert!(told(&[0, 40, 100, 140, 200]));
        assert!(told(&[0, 1, 100, 101, 200]));
    }

    #[test]
    fn one_node_with_jitter_or_with_a_heartbeat_out_of_turn_is_one_node() {
        assert!(!told(&[0, 120, 190, 310, 395, 500, 610, 700]));
        assert!(!told(&[0, 100, 130, 200, 300, 400, 500]));
    }

    #[test]
    fn two_boot_ups_in_a_moment_are_two_nodes() {
        let mut duplicates = Duplicates::new(Duration::from_millis(100));
        let mut boot_up = |ms| duplicates.on_heartbeat(1, State::BootUp, Duration::from_millis(ms));
        assert!(!boot_up(0));
        assert!(!boot_up(900));
        assert!(boot_up(930));
    }
}
