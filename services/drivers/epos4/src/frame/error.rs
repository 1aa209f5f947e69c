//! What a CAN controller says of itself: the error frames of `linux/can/error.h`, typed.

use std::fmt;

use super::{Frame, Id};

/// The classes of an error frame, which are the bits of its identifier.
#[derive(Debug)]
pub struct Class;

impl Class {
    /// A frame was not sent in time.
    pub const TRANSMIT_TIMEOUT: u32 = 0x001;
    /// Another node won the arbitration.
    pub const LOST_ARBITRATION: u32 = 0x002;
    /// The controller's state or an overflow, detailed in data byte 1.
    pub const CONTROLLER: u32 = 0x004;
    /// A protocol violation, detailed in data bytes 2 and 3.
    pub const PROTOCOL: u32 = 0x008;
    /// The transceiver, detailed in data byte 4.
    pub const TRANSCEIVER: u32 = 0x010;
    /// Nobody acknowledged a frame.
    pub const NO_ACKNOWLEDGE: u32 = 0x020;
    /// The controller is bus-off.
    pub const BUS_OFF: u32 = 0x040;
    /// A bus error; there may be very many.
    pub const BUS_ERROR: u32 = 0x080;
    /// The controller was restarted after bus-off.
    pub const RESTARTED: u32 = 0x100;
    /// Data bytes 6 and 7 are the counters.
    pub const COUNTERS: u32 = 0x200;
}

/// Error states of a controller, ISO 11898-1.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum ControllerState {
    /// Both counters are below 96.
    ErrorActive,
    /// A counter is at least 96.
    ErrorWarning,
    /// A counter is at least 128: the controller may not destroy others' frames any more.
    ErrorPassive,
    /// The transmit counter passed 255: the controller takes no part in the bus until it is restarted.
    BusOff,
    /// The interface is down.
    Stopped,
    /// The controller sleeps.
    Sleeping,
}

/// Error counters of a controller, ISO 11898-1.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Counters {
    /// Failures to send, 8 each, minus successes.
    pub transmit: u16,
    /// Failures to receive, minus successes.
    pub receive: u16,
}

/// An error frame. Each part is there if the frame says something about it; by `socketcand` come the classes alone, so
/// that a change of state other than bus-off is known but not to which.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Report {
    classes: u32,
    data: [u8; 8],
    has_details: bool,
}

// Data byte 1.
const RECEIVE_OVERFLOW: u8 = 0x01;
const TRANSMIT_OVERFLOW: u8 = 0x02;
const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

impl Report {
    /// Reads an error frame; none if the frame is one of a node.
    pub fn decode(frame: &Frame) -> Option<Self> {
        let Id::Error(classes) = frame.id() else {
            return None;
        };
        let mut data = [0; 8];
        data[..frame.data().len()].copy_from_slice(frame.data());
        Some(Self {
            classes,
            data,
            has_details: !frame.data().is_empty(),
        })
    }

    /// The frame of a report as a controller makes it, for simulations of one: classes of [`Class`] and their details.
    pub fn frame(classes: u32, data: [u8; 8]) -> Frame {
        Frame {
            id: Id::Error(classes & Id::MAX_EXTENDED),
            data,
            len: 8,
        }
    }

    /// The bits of [`Class`].
    pub fn classes(&self) -> u32 {
        self.classes
    }

    /// Whether one of these classes is reported.
    pub fn has(&self, class: u32) -> bool {
        self.classes & class != 0
    }

    /// The state that the controller came to.
    pub fn state(&self) -> Option<ControllerState> {
        let detail = self.detail(Class::CONTROLLER, 1).unwrap_or(0);
        if self.has(Class::BUS_OFF) {
            Some(ControllerState::BusOff)
        } else if detail & PASSIVE != 0 {
            Some(ControllerState::ErrorPassive)
        } else if detail & WARNING != 0 {
            Some(ControllerState::ErrorWarning)
        } else if detail & ACTIVE != 0 || self.has(Class::RESTARTED) {
            Some(ControllerState::ErrorActive)
        } else {
            None
        }
    }

    /// The counters. Kernels before 6.0 have them with a change of state, without saying so.
    pub fn counters(&self) -> Option<Counters> {
        let [.., transmit, receive] = self.data;
        let told = self.has(Class::COUNTERS) && self.has_details;
        let untold = self.has(Class::CONTROLLER) && (transmit, receive) != (0, 0);
        (told || untold).then_some(Counters {
            transmit: transmit.into(),
            receive: receive.into(),
        })
    }

    /// Whether received frames were lost in the controller.
    pub fn lost_received(&self) -> bool {
        self.detail(Class::CONTROLLER, 1)
            .is_some_and(|detail| detail & RECEIVE_OVERFLOW != 0)
    }

    /// Whether frames to be sent were lost in the controller.
    pub fn lost_sent(&self) -> bool {
        self.detail(Class::CONTROLLER, 1)
            .is_some_and(|detail| detail & TRANSMIT_OVERFLOW != 0)
    }

    fn detail(&self, class: u32, byte: usize) -> Option<u8> {
        (self.has(class) && self.has_details).then_some(self.data[byte])
    }
}

impl fmt::Display for ControllerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ErrorActive => "error-active",
            Self::ErrorWarning => "error-warning",
            Self::ErrorPassive => "error-passive",
            Self::BusOff => "bus-off",
            Self::Stopped => "stopped",
            Self::Sleeping => "sleeping",
        })
    }
}

impl fmt::Display for Counters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "transmit errors {}, receive errors {}",
            self.transmit, self.receive
        )
    }
}

impl fmt::Display for Report {
    /// All that is reported: `error-passive, no acknowledge, transmit errors 128, receive errors 0`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = self.state();
        let unknown_state = self.has(Class::CONTROLLER)
            && state.is_none()
            && !self.lost_received()
            && !self.lost_sent();
        let words = [
            (self.has(Class::RESTARTED), "restarted"),
            (unknown_state, "controller state changed"),
            (self.lost_received(), "receive overflow"),
            (self.lost_sent(), "transmit overflow"),
            (self.has(Class::NO_ACKNOWLEDGE), "no acknowledge"),
            (self.has(Class::TRANSMIT_TIMEOUT), "transmit timeout"),
            (self.has(Class::LOST_ARBITRATION), "lost arbitration"),
            (self.has(Class::PROTOCOL), "protocol violation"),
            (self.has(Class::TRANSCEIVER), "transceiver"),
            (self.has(Class::BUS_ERROR), "bus error"),
        ];
        let words = words
            .into_iter()
            .filter(|(told, _)| *told)
            .map(|(_, word)| word.to_owned());
        let all: Vec<String> = state
            .map(|state| state.to_string())
            .into_iter()
            .chain(words)
            .chain(self.counters().map(|counters| counters.to_string()))
            .collect();
        if all.is_empty() {
            return write!(f, "error class {:#X}", self.classes);
        }
        f.write_str(&all.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(classes: u32, data: &[u8]) -> Report {
        Report::decode(&Frame::new(Id::Error(classes), data).unwrap()).unwrap()
    }

    #[test]
    fn states_are_those_of_the_kernels_header() {
        for (classes, detail, state) in [
            (Class::BUS_OFF, 0, Some(ControllerState::BusOff)),
            (Class::CONTROLLER, 0x04, Some(ControllerState::ErrorWarning)),
            (Class::CONTROLLER, 0x08, Some(ControllerState::ErrorWarning)),
            (Class::CONTROLLER, 0x10, Some(ControllerState::ErrorPassive)),
            (Class::CONTROLLER, 0x2C, Some(ControllerState::ErrorPassive)),
            (Class::CONTROLLER, 0x40, Some(ControllerState::ErrorActive)),
            (Class::CONTROLLER, 0x01, None),
            (Class::RESTARTED, 0, Some(ControllerState::ErrorActive)),
            (Class::NO_ACKNOWLEDGE, 0x20, None),
        ] {
            let data = [0, detail, 0, 0, 0, 0, 0, 0];
            assert_eq!(
                report(classes, &data).state(),
                state,
                "{classes:#X} {detail:#X}"
            );
        }
    }

    #[test]
    fn counters_come_with_their_class_or_with_a_state() {
        let data = [0, 0x20, 0, 0, 0, 0, 128, 3];
        let counters = Some(Counters {
            transmit: 128,
            receive: 3,
        });
        assert_eq!(report(Class::CONTROLLER, &data).counters(), counters);
        assert_eq!(report(Class::COUNTERS, &data).counters(), counters);
        assert_eq!(report(Class::BUS_ERROR, &data).counters(), None);
        assert_eq!(report(Class::CONTROLLER, &[0; 8]).counters(), None);
    }

    #[test]
    fn classes_alone_say_no_more_than_they_know() {
        let report = report(Class::CONTROLLER | Class::COUNTERS, &[]);
        assert_eq!((report.state(), report.counters()), (None, None));
        assert_eq!(report.to_string(), "controller state changed");
    }

    #[test]
    fn a_report_reads_as_a_sentence() {
        let passive = report(
            Class::CONTROLLER | Class::NO_ACKNOWLEDGE | Class::COUNTERS,
            &[0, 0x20, 0, 0, 0, 0, 128, 0],
        );
        assert_eq!(
            passive.to_string(),
            "error-passive, no acknowledge, transmit errors 128, receive errors 0"
        );
        assert_eq!(report(Class::BUS_OFF, &[]).to_string(), "bus-off");
        assert_eq!(
            report(Class::CONTROLLER, &[0, 1, 0, 0, 0, 0, 0, 0]).to_string(),
            "receive overflow"
        );
        assert_eq!(report(0x800, &[]).to_string(), "error class 0x800");
    }

    #[test]
    fn a_node_reports_nothing() {
        assert_eq!(Report::decode(&Frame::standard(0x040, [0x20; 8])), None);
    }
}
