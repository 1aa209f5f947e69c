//! Heartbeats: their frame, and a consumer that notices when one stays out (CiA 301, 7.2.8.3.2).

use std::time::Duration;

use super::nmt::State;
use crate::frame::Frame;

/// COB-ID of a node's heartbeat and boot-up.
pub const fn cob_id(node_id: u8) -> u16 {
    0x700 + node_id as u16
}

/// The frame of a node in a state; [`State::BootUp`] is the boot-up message.
pub const fn encode(node_id: u8, state: State) -> Frame {
    Frame::standard(cob_id(node_id), [state.code()])
}

/// Node and state in a frame; `None` when it is no heartbeat.
pub fn decode(frame: &Frame) -> Option<(u8, State)> {
    let cob_id = frame
        .cob_id()
        .filter(|cob_id| (0x701..=0x77F).contains(cob_id))?;
    let &[code] = frame.data() else { return None };
    Some(((cob_id - 0x700) as u8, State::from_code(code)?))
}

/// Watches the heartbeat of one node on the clock of the bus: the time that passes is the time that received frames,
/// of any node, carry.
#[derive(Clone, Debug)]
pub struct Consumer {
    timeout: Duration,
    last: Option<(Duration, State)>,
    lost: bool,
}

/// What a heartbeat, or its absence, means.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event {
    /// The first heartbeat, or the first after a loss.
    Appeared(State),
    /// The node started anew although it had been seen before.
    UnexpectedBootUp,
    /// The NMT state is another than before.
    Changed(State),
    /// Nothing came for longer than the timeout.
    Lost {
        /// How long nothing has come.
        silent: Duration,
    },
}

impl Consumer {
    /// Nothing seen yet; a node that never appears is not lost.
    pub fn new(timeout: Duration) -> Self {
        Self {
            timeout,
            last: None,
            lost: false,
        }
    }

    /// The state that the node reported last; `None` before the first heartbeat and after a loss.
    pub fn state(&self) -> Option<State> {
        self.last.filter(|_| !self.lost).map(|(_, state)| state)
    }

    /// Takes a heartbeat of the watched node.
    pub fn on_heartbeat(&mut self, state: State, stamp: Duration) -> Option<Event> {
        let before = self.last.replace((stamp, state)).map(|(_, state)| state);
        let was_lost = std::mem::replace(&mut self.lost, false);
        match before {
            Some(_) if state == State::BootUp => Some(Event::UnexpectedBootUp),
            None => Some(Event::Appeared(state)),
            Some(_) if was_lost => Some(Event::Appeared(state)),
            Some(before) if before != state => Some(Event::Changed(state)),
            Some(_) => None,
        }
    }

    /// Lets the bus time advance to `stamp`. A loss is told once.
    pub fn on_time(&mut self, stamp: Duration) -> Option<Event> {
        let silent = stamp.saturating_sub(self.last?.0);
        if self.lost || silent <= self.timeout {
            return None;
        }
        self.lost = true;
        Some(Event::Lost { silent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_heartbeat_that_stays_out_is_told_once() {
        let mut consumer = Consumer::new(ms(300));
        assert_eq!(
            consumer.on_time(ms(10_000)),
            None,
            "a node never seen is not lost"
        );
        assert_eq!(
            consumer.on_heartbeat(State::Operational, ms(10_000)),
            Some(Event::Appeared(State::Operational))
        );
        assert_eq!(consumer.on_time(ms(10_300)), None);
        assert_eq!(
            consumer.on_time(ms(10_301)),
            Some(Event::Lost { silent: ms(301) })
        );
        assert_eq!(consumer.state(), None);
        assert_eq!(consumer.on_time(ms(11_000)), None);
        assert_eq!(
            consumer.on_heartbeat(State::Operational, ms(11_000)),
            Some(Event::Appeared(State::Operational))
        );
    }

    #[test]
    fn a_second_boot_up_is_unexpected() {
        let mut consumer = Consumer::new(ms(300));
        assert_eq!(
            consumer.on_heartbeat(State::BootUp, ms(0)),
            Some(Event::Appeared(State::BootUp))
        );
        assert_eq!(
            consumer.on_heartbeat(State::PreOperational, ms(1)),
            Some(Event::Changed(State::PreOperational))
        );
        assert_eq!(
            consumer.on_heartbeat(State::BootUp, ms(2)),
            Some(Event::UnexpectedBootUp)
        );
    }

    #[test]
    fn a_heartbeat_survives_the_wire() {
        for state in [
            State::BootUp,
            State::Stopped,
            State::Operational,
            State::PreOperational,
        ] {
            assert_eq!(decode(&encode(4, state)), Some((4, state)));
        }
        assert_eq!(decode(&Frame::standard(0x700, [5])), None);
        assert_eq!(decode(&Frame::standard(0x704, [5, 0])), None);
    }
}
