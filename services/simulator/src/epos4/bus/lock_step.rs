//! Faster than the wall clock, the bus waits for a heartbeat that a drive would miss: a host that is alive and had no
//! time yet is no dead host.

use std::time::Duration;

use tokio::time::{Instant, timeout_at};

use super::{Bus, Wire};
use crate::epos4::Node;

impl Bus {
    /// Lock step with whoever a drive expects heartbeats of: when one would be missed in the next `dt_s`, waits for it,
    /// at most for `bound` of the wall clock. Who does not send in time is not waited for until the next heartbeat.
    pub async fn wait_for_heartbeats(&self, dt_s: f64, bound: Duration) {
        let deadline = Instant::now() + bound;
        loop {
            let mut beat = std::pin::pin!(self.beat.notified());
            beat.as_mut().enable();
            if !self.wire().owed_a_heartbeat(dt_s) {
                return;
            }
            if timeout_at(deadline, beat).await.is_err() {
                self.wire().gave_up = true;
                return;
            }
        }
    }
}

impl Wire {
    fn owed_a_heartbeat(&self, dt_s: f64) -> bool {
        let runs_out = |node: &Node| {
            let patience_s = node.patience_s(self.now_s);
            patience_s.is_some_and(|patience_s| patience_s <= dt_s)
        };
        !self.gave_up
            && self.members.values().any(|host| !host.bus_off)
            && self.drives.nodes.iter().any(runs_out)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use epos4_link::canopen::heartbeat;
    use epos4_link::canopen::nmt::State;
    use epos4_link::frame::Frame;
    use epos4_link::objects;

    use super::*;
    use crate::epos4::{Drives, NodeConfig};

    const STEP_S: f64 = 0.008;

    /// A drive that expects node 127 every 300 ms, and has heard it once at 0.
    fn expecting() -> Arc<Bus> {
        let mut config = NodeConfig::new(2, 1);
        config
            .parameters
            .push((objects::CONSUMER_HEARTBEAT_1.address, 127 << 16 | 300));
        let bus = Bus::new(Drives::new(vec![Node::new(config)]));
        bus.tick(STEP_S, STEP_S, &[]);
        bus
    }

    fn beat() -> Frame {
        heartbeat::encode(127, State::Operational)
    }

    /// Ticks as a fast clock does; cell seconds until the drive missed a heartbeat, or `limit_s`.
    async fn run(bus: &Bus, limit_s: f64, bound: Duration) -> f64 {
        let mut now_s = STEP_S;
        while now_s < limit_s
            && bus
                .with_drives(|drives| drives.nodes[0].patience_s(now_s))
                .is_some()
        {
            bus.wait_for_heartbeats(STEP_S, bound).await;
            now_s += STEP_S;
            bus.tick(STEP_S, now_s, &[]);
        }
        now_s
    }

    #[tokio::test]
    async fn a_host_that_beats_by_the_wall_clock_is_not_outrun() {
        let bus = expecting();
        let host = bus.join();
        host.sender().send(&beat());
        let sending = tokio::spawn(async move {
            // Five seconds of the cell pass in the time of this.
            for _ in 0..50 {
                tokio::time::sleep(Duration::from_millis(5)).await;
                host.sender().send(&beat());
            }
            host
        });
        let now_s = run(&bus, 5.0, Duration::from_secs(30)).await;
        assert!(now_s >= 5.0, "missed at {now_s} s");
        drop(sending.await.unwrap());
    }

    #[tokio::test]
    async fn a_dead_host_is_waited_for_once_and_a_gone_one_not_at_all() {
        let bound = Duration::from_millis(50);
        for stays in [true, false] {
            let bus = expecting();
            let host = bus.join();
            host.sender().send(&beat());
            let host = stays.then_some(host);
            let start = Instant::now();
            let now_s = run(&bus, 5.0, bound).await;
            assert!((0.29..0.33).contains(&now_s), "{now_s}");
            let waited = start.elapsed() >= bound;
            assert_eq!(waited, stays);
            drop(host);
        }
    }
}
