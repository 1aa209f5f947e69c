//! Judges what the drives report, or fail to report. Not knowing is a fault: a missed heartbeat, an emergency, a restart,
//! a statusword that no standard knows. A fault stays latched until a person has it recovered.

mod responses;

use std::time::Duration;

use epos4_link::canopen::emcy::{self, Emergency};
use epos4_link::canopen::heartbeat;
use epos4_link::canopen::nmt;
use epos4_link::frame::error::{ControllerState, Report};
use epos4_link::network::Evidence;

use self::responses::response;
use crate::axis::Axis;

/// Faults and heartbeats of all axes.
#[derive(Debug)]
pub struct Supervisor {
    /// Of the axes whose drives are set up.
    heartbeats: [Option<heartbeat::Consumer>; 4],
    faults: [Option<Fault>; 4],
    heartbeat_timeout: Duration,
}

/// Why an axis must not move.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{detail}")]
pub struct Fault {
    /// A stable SCREAMING_SNAKE word.
    pub reason: &'static str,
    /// What happened, with value and limit.
    pub detail: String,
    /// The drive's own error, from an emergency or object 0x603F.
    pub code: Option<u16>,
    /// What a person does about it.
    pub response: &'static str,
}

impl Fault {
    /// A fault with a reason and what happened.
    pub fn new(reason: &'static str, detail: impl Into<String>) -> Self {
        Self {
            reason,
            detail: detail.into(),
            code: None,
            response: response(reason),
        }
    }

    /// A boot-up that nobody expected may be that of a second drive with the same number.
    fn explains(&self, first: &Self) -> bool {
        (first.reason, self.reason) == ("UNEXPECTED_BOOT_UP", "DUPLICATE_NODE_ID")
    }

    /// Whether the drive may have lost its settings, so that they must be made again.
    pub fn loses_settings(&self) -> bool {
        matches!(
            self.reason,
            "HEARTBEAT_LOST"
                | "UNEXPECTED_BOOT_UP"
                | "NMT_STATE_LOST"
                | "SDO_NO_ANSWER"
                | "STALE_PROCESS_DATA"
                | "CAN_COMMUNICATION"
        )
    }

    /// The drive's own error, from an emergency or object 0x603F.
    pub fn of_drive(code: u16) -> Self {
        Self {
            reason: drive_reason(code),
            detail: format!("the drive reports 0x{code:04X}, {}", emcy::text(code)),
            code: Some(code),
            response: emcy::response(code),
        }
    }
}

/// What a drive's report, or silence, means for its axis.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Finding {
    /// A fault, whether or not the axis has one already.
    Fault(Axis, Fault),
    /// The drive has just started and has to be set up.
    Started(Axis),
}

impl Finding {
    /// More than one drive has the number of an axis.
    pub fn duplicate(axis: Axis, node_id: u8, evidence: Evidence) -> Self {
        let sign = match evidence {
            Evidence::Heartbeats => "heartbeats come twice as often as one drive sends them",
            Evidence::SecondAnswer => "a second answer came to one request",
        };
        let detail = format!("more than one node has the number {node_id}: {sign}");
        Self::Fault(axis, Fault::new("DUPLICATE_NODE_ID", detail))
    }
}

/// What a report of this host's CAN controller means: all drives are behind it.
pub fn on_report(report: &Report) -> Vec<Finding> {
    let reason = match report.state() {
        Some(ControllerState::BusOff) => "BUS_OFF",
        Some(ControllerState::ErrorPassive) => "BUS_ERROR_PASSIVE",
        _ => return Vec::new(),
    };
    let detail = format!("the can controller reports {report}");
    let fault = Fault::new(reason, detail);
    Axis::ALL
        .map(|axis| Finding::Fault(axis, fault.clone()))
        .into()
}

impl Supervisor {
    /// No axis is watched yet. The timeout is on the clock of the bus.
    pub fn new(heartbeat_timeout: Duration) -> Self {
        Self {
            heartbeats: [const { None }; 4],
            faults: [const { None }; 4],
            heartbeat_timeout,
        }
    }

    /// The latched fault of an axis.
    pub fn fault(&self, axis: Axis) -> Option<&Fault> {
        self.faults[axis.index()].as_ref()
    }

    /// Latches a fault; the first one stands, unless the new one explains it. `true` when it is latched now.
    pub fn latch(&mut self, axis: Axis, fault: Fault) -> bool {
        let slot = &mut self.faults[axis.index()];
        if slot.as_ref().is_some_and(|first| !fault.explains(first)) {
            return false;
        }
        *slot = Some(fault);
        true
    }

    /// A person had the fault recovered.
    pub fn clear(&mut self, axis: Axis) {
        self.faults[axis.index()] = None;
    }

    /// The drive is set up and OPERATIONAL: from now on its heartbeat must come.
    pub fn watch(&mut self, axis: Axis, stamp: Duration) {
        let mut consumer = heartbeat::Consumer::new(self.heartbeat_timeout);
        consumer.on_heartbeat(nmt::State::Operational, stamp);
        self.heartbeats[axis.index()] = Some(consumer);
    }

    /// The drive is to be set up anew: nothing is expected of it until then.
    pub fn unwatch(&mut self, axis: Axis) {
        self.heartbeats[axis.index()] = None;
    }

    /// Takes a heartbeat.
    pub fn on_heartbeat(
        &mut self,
        axis: Axis,
        state: nmt::State,
        stamp: Duration,
    ) -> Option<Finding> {
        let Some(consumer) = &mut self.heartbeats[axis.index()] else {
            return (state == nmt::State::BootUp).then_some(Finding::Started(axis));
        };
        let fault = match consumer.on_heartbeat(state, stamp)? {
            heartbeat::Event::Appeared(_) | heartbeat::Event::Changed(nmt::State::Operational) => {
                return None;
            }
            heartbeat::Event::UnexpectedBootUp => Fault::new(
                "UNEXPECTED_BOOT_UP",
                "the drive restarted and has lost its settings and its reference",
            ),
            heartbeat::Event::Changed(state) => Fault::new(
                "NMT_STATE_LOST",
                format!("the drive left OPERATIONAL and is in {state}"),
            ),
            heartbeat::Event::Lost { silent } => self.lost(silent),
        };
        Some(Finding::Fault(axis, fault))
    }

    /// Lets the time of the bus advance.
    pub fn on_time(&mut self, stamp: Duration) -> Vec<Finding> {
        let mut findings = Vec::new();
        for axis in Axis::ALL {
            let event = self.heartbeats[axis.index()]
                .as_mut()
                .and_then(|consumer| consumer.on_time(stamp));
            if let Some(heartbeat::Event::Lost { silent }) = event {
                findings.push(Finding::Fault(axis, self.lost(silent)));
            }
        }
        findings
    }

    /// Takes an emergency. One that says that errors are gone recovers nothing.
    pub fn on_emergency(&self, axis: Axis, emergency: Emergency) -> Option<Finding> {
        if emergency.code == Emergency::RESET {
            return None;
        }
        Some(Finding::Fault(axis, Fault::of_drive(emergency.code)))
    }

    fn lost(&self, silent: Duration) -> Fault {
        let (silent_s, limit_s) = (silent.as_secs_f64(), self.heartbeat_timeout.as_secs_f64());
        Fault::new(
            "HEARTBEAT_LOST",
            format!("no heartbeat for {silent_s:.3} s, limit {limit_s:.3} s"),
        )
    }
}

/// The stable word for an error code of the drive. Errors that ask different things of a person have different reasons.
pub fn drive_reason(code: u16) -> &'static str {
    match code {
        0x2310 | 0x2320 => "OVERCURRENT",
        0x3210 | 0x3220 | 0x5113 => "SUPPLY_VOLTAGE",
        0x4210 | 0x4380 => "OVERTEMPERATURE",
        0x7300..=0x73FF => "POSITION_SENSOR",
        0x8110..=0x82FF => "CAN_COMMUNICATION",
        0x8611 => "FOLLOWING_ERROR",
        0x8A80 | 0x8A81 => "LIMIT_SWITCH",
        0x8A82 => "SOFTWARE_POSITION_LIMIT",
        0x8A88 => "SAFE_TORQUE_OFF",
        _ => "DRIVE_ERROR",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: Axis = Axis::ForcepsFeed;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn watching() -> Supervisor {
        let mut supervisor = Supervisor::new(ms(300));
        supervisor.watch(AXIS, ms(1000));
        supervisor
    }

    fn reason(finding: Option<Finding>) -> &'static str {
        match finding {
            Some(Finding::Fault(AXIS, fault)) => fault.reason,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_missed_heartbeat_is_a_fault_of_that_axis_alone() {
        let mut supervisor = watching();
        assert_eq!(
            supervisor.on_heartbeat(AXIS, nmt::State::Operational, ms(1100)),
            None
        );
        assert_eq!(supervisor.on_time(ms(1400)), []);
        let fault = Fault::new("HEARTBEAT_LOST", "no heartbeat for 0.401 s, limit 0.300 s");
        assert_eq!(supervisor.on_time(ms(1501)), [Finding::Fault(AXIS, fault)]);
        assert_eq!(supervisor.on_time(ms(9000)), [], "told once");
    }

    #[test]
    fn an_emergency_is_a_fault_and_its_end_is_no_recovery() {
        let supervisor = watching();
        let following_error = Emergency::new(0x8611, 0x80);
        assert_eq!(
            reason(supervisor.on_emergency(AXIS, following_error)),
            "FOLLOWING_ERROR"
        );
        assert_eq!(
            supervisor.on_emergency(AXIS, Emergency::new(Emergency::RESET, 0)),
            None
        );
    }

    #[test]
    fn the_first_fault_stands_until_it_is_cleared() {
        let mut supervisor = watching();
        assert!(supervisor.latch(AXIS, Fault::of_drive(0x8611)));
        assert!(!supervisor.latch(AXIS, Fault::of_drive(0x8130)));
        assert_eq!(supervisor.fault(Axis::ForcepsRotation), None);
        let detail = supervisor.fault(AXIS).map(|fault| fault.detail.as_str());
        assert_eq!(detail, Some("the drive reports 0x8611, following error"));
        supervisor.clear(AXIS);
        assert_eq!(supervisor.fault(AXIS), None);
    }

    #[test]
    fn a_second_drive_of_the_number_explains_the_boot_up_that_was_seen_first() {
        let mut supervisor = watching();
        assert!(supervisor.latch(AXIS, Fault::new("UNEXPECTED_BOOT_UP", "restarted")));
        let Finding::Fault(_, duplicate) = Finding::duplicate(AXIS, 2, Evidence::SecondAnswer)
        else {
            panic!("a second drive is a fault")
        };
        assert!(supervisor.latch(AXIS, duplicate.clone()));
        assert_eq!(supervisor.fault(AXIS), Some(&duplicate));
        assert!(!supervisor.latch(AXIS, Fault::new("UNEXPECTED_BOOT_UP", "restarted")));
    }

    #[test]
    fn a_restart_is_a_fault_when_the_drive_was_set_up_and_a_start_when_not() {
        let mut supervisor = watching();
        assert_eq!(
            reason(supervisor.on_heartbeat(AXIS, nmt::State::BootUp, ms(1050))),
            "UNEXPECTED_BOOT_UP"
        );
        supervisor.unwatch(AXIS);
        let started = supervisor.on_heartbeat(AXIS, nmt::State::BootUp, ms(1060));
        assert_eq!(started, Some(Finding::Started(AXIS)));
        assert_eq!(
            supervisor.on_heartbeat(AXIS, nmt::State::PreOperational, ms(1070)),
            None
        );
        assert_eq!(
            supervisor.on_time(ms(9000)),
            [],
            "nothing is expected of it"
        );
    }

    #[test]
    fn a_drive_that_leaves_operational_is_a_fault() {
        let finding = watching().on_heartbeat(AXIS, nmt::State::PreOperational, ms(1050));
        assert_eq!(reason(finding), "NMT_STATE_LOST");
    }
}
