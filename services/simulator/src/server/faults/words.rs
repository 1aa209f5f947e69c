//! The words of the API for faults, checked and turned into the simulator's own, and back.

use std::ops::RangeInclusive;
use std::time::Duration;

use arthro_bootstrap::status;
use arthro_proto::simulator::v1::{
    ControlPlace, JointNumbers, LinkFaultKind, LinkFaultSpec, PacketDirection, SafeguardState,
    StopButton, UrService, VersionClaim,
};
use tonic::Status;

use super::unknown;
use crate::ur5::link_fault::{Direction, Kind, MAX_DELAY, Service, Spec};
use crate::ur5::{Button, Control, Safeguard, Teller, Version};

/// Longest name of a field.
const MAX_FIELD: usize = 64;

pub(super) fn spec(fault: &LinkFaultSpec) -> Result<Spec, Status> {
    let kind = kind(fault)?;
    let service = service("fault.service", fault.service)?;
    let direction = match PacketDirection::try_from(fault.direction) {
        Ok(PacketDirection::Unspecified | PacketDirection::FromController) => {
            Direction::FromController
        }
        Ok(PacketDirection::ToController) => Direction::ToController,
        Err(_) => return Err(unknown("fault.direction", fault.direction)),
    };
    if direction == Direction::ToController && !matches!(kind, Kind::Drop | Kind::Corrupt) {
        let text = "TO_CONTROLLER is for DROP and CORRUPT only";
        return Err(status::invalid("fault.direction", text));
    }
    if matches!(kind, Kind::NotANumber { .. }) && !matches!(service, None | Some(Service::Rtde)) {
        let text = "must be RTDE, or none, for NAN";
        return Err(status::invalid("fault.service", text));
    }
    let whole = matches!(kind, Kind::Stall | Kind::Reset | Kind::HalfOpen);
    let share = if fault.share == 0.0 || whole {
        1.0
    } else {
        in_range("fault.share", fault.share, 0.0..=1.0, "0 .. 1")?;
        fault.share
    };
    Ok(Spec {
        service,
        direction,
        kind,
        share,
        limit: fault.limit,
        seed: fault.seed,
    })
}

fn kind(fault: &LinkFaultSpec) -> Result<Kind, Status> {
    let none = || status::invalid("fault.kind", "must be set");
    Ok(
        match LinkFaultKind::try_from(fault.kind).map_err(|_| unknown("fault.kind", fault.kind))? {
            LinkFaultKind::Unspecified => return Err(none()),
            LinkFaultKind::Drop => Kind::Drop,
            LinkFaultKind::Stall => Kind::Stall,
            LinkFaultKind::Reset => Kind::Reset,
            LinkFaultKind::HalfOpen => Kind::HalfOpen,
            LinkFaultKind::Reorder => Kind::Reorder,
            LinkFaultKind::Corrupt => Kind::Corrupt,
            LinkFaultKind::Nan => {
                if fault.field.len() > MAX_FIELD {
                    let text = format!("has {} bytes, at most {MAX_FIELD}", fault.field.len());
                    return Err(status::invalid("fault.field", text));
                }
                Kind::NotANumber {
                    field: (!fault.field.is_empty()).then(|| fault.field.clone()),
                }
            }
            LinkFaultKind::Delay => {
                in_range(
                    "fault.delay_s",
                    fault.delay_s,
                    1e-6..=5.0,
                    "0.000001 .. 5 s",
                )?;
                Kind::Delay(Duration::from_secs_f64(fault.delay_s).min(MAX_DELAY))
            }
        },
    )
}

pub(super) fn told(spec: &Spec) -> LinkFaultSpec {
    let (kind, delay_s, field) = match &spec.kind {
        Kind::Drop => (LinkFaultKind::Drop, 0.0, ""),
        Kind::Stall => (LinkFaultKind::Stall, 0.0, ""),
        Kind::Reset => (LinkFaultKind::Reset, 0.0, ""),
        Kind::HalfOpen => (LinkFaultKind::HalfOpen, 0.0, ""),
        Kind::Reorder => (LinkFaultKind::Reorder, 0.0, ""),
        Kind::Corrupt => (LinkFaultKind::Corrupt, 0.0, ""),
        Kind::NotANumber { field } => (
            LinkFaultKind::Nan,
            0.0,
            field.as_deref().unwrap_or_default(),
        ),
        Kind::Delay(by) => (LinkFaultKind::Delay, by.as_secs_f64(), ""),
    };
    let direction = match spec.direction {
        Direction::FromController => PacketDirection::FromController,
        Direction::ToController => PacketDirection::ToController,
    };
    LinkFaultSpec {
        service: told_service(spec.service).into(),
        direction: direction.into(),
        kind: kind.into(),
        share: spec.share,
        limit: spec.limit,
        seed: spec.seed,
        delay_s,
        field: field.to_owned(),
    }
}

fn service(field: &str, number: i32) -> Result<Option<Service>, Status> {
    Ok(
        match UrService::try_from(number).map_err(|_| unknown(field, number))? {
            UrService::Unspecified => None,
            UrService::Dashboard => Some(Service::Dashboard),
            UrService::Primary => Some(Service::Primary),
            UrService::Secondary => Some(Service::Secondary),
            UrService::Realtime => Some(Service::Realtime),
            UrService::Rtde => Some(Service::Rtde),
            UrService::PrimaryReadOnly => Some(Service::PrimaryReadOnly),
            UrService::SecondaryReadOnly => Some(Service::SecondaryReadOnly),
            UrService::RealtimeReadOnly => Some(Service::RealtimeReadOnly),
        },
    )
}

fn told_service(service: Option<Service>) -> UrService {
    match service {
        None => UrService::Unspecified,
        Some(Service::Dashboard) => UrService::Dashboard,
        Some(Service::Primary) => UrService::Primary,
        Some(Service::Secondary) => UrService::Secondary,
        Some(Service::Realtime) => UrService::Realtime,
        Some(Service::Rtde) => UrService::Rtde,
        Some(Service::PrimaryReadOnly) => UrService::PrimaryReadOnly,
        Some(Service::SecondaryReadOnly) => UrService::SecondaryReadOnly,
        Some(Service::RealtimeReadOnly) => UrService::RealtimeReadOnly,
    }
}

pub(super) fn button(number: i32) -> Result<Button, Status> {
    match StopButton::try_from(number) {
        Ok(StopButton::Unspecified | StopButton::Robot) => Ok(Button::Robot),
        Ok(StopButton::System) => Ok(Button::System),
        Err(_) => Err(unknown("emergency_stop.button", number)),
    }
}

pub(super) fn safeguard(number: i32) -> Result<Safeguard, Status> {
    match SafeguardState::try_from(number) {
        Ok(SafeguardState::Clear) => Ok(Safeguard::Clear),
        Ok(SafeguardState::Open) => Ok(Safeguard::Open),
        Ok(SafeguardState::AwaitsReset) => Ok(Safeguard::AwaitsReset),
        Ok(SafeguardState::Unspecified) | Err(_) => Err(unknown("safeguard", number)),
    }
}

pub(super) fn told_safeguard(safeguard: Safeguard) -> SafeguardState {
    match safeguard {
        Safeguard::Clear => SafeguardState::Clear,
        Safeguard::Open => SafeguardState::Open,
        Safeguard::AwaitsReset => SafeguardState::AwaitsReset,
    }
}

pub(super) fn control(number: i32) -> Result<Control, Status> {
    match ControlPlace::try_from(number) {
        Ok(ControlPlace::Remote) => Ok(Control::Remote),
        Ok(ControlPlace::Local) => Ok(Control::Local),
        Ok(ControlPlace::Unspecified) | Err(_) => Err(unknown("control", number)),
    }
}

pub(super) fn told_control(control: Control) -> ControlPlace {
    match control {
        Control::Remote => ControlPlace::Remote,
        Control::Local => ControlPlace::Local,
    }
}

pub(super) fn claim(claim: &VersionClaim) -> Result<(Teller, Option<Version>), Status> {
    let teller = match service("version.service", claim.service)? {
        Some(Service::Rtde) => Teller::Rtde,
        Some(Service::Dashboard) => Teller::Dashboard,
        Some(Service::Primary) => Teller::Primary,
        _ => {
            let text = "must be RTDE, DASHBOARD or PRIMARY";
            return Err(status::invalid("version.service", text));
        }
    };
    if claim.version.is_empty() {
        return Ok((teller, None));
    }
    let version = claim.version.parse();
    let version = version.map_err(|error: crate::ur5::NotAVersion| {
        status::invalid("version.version", error.to_string())
    })?;
    Ok((teller, Some(version)))
}

pub(super) fn joints(
    field: &str,
    numbers: &JointNumbers,
    range: RangeInclusive<f64>,
    limit: &str,
) -> Result<[f64; 6], Status> {
    let values: [f64; 6] = numbers.values[..].try_into().map_err(|_| {
        let text = format!("has {} values, must have 6", numbers.values.len());
        status::invalid(field, text)
    })?;
    for value in values {
        in_range(field, value, range.clone(), limit)?;
    }
    Ok(values)
}

pub(in crate::server) fn in_range(
    field: &str,
    value: f64,
    range: RangeInclusive<f64>,
    limit: &str,
) -> Result<(), Status> {
    if range.contains(&value) {
        Ok(())
    } else {
        Err(status::invalid(
            field,
            format!("{value} must be within {limit}"),
        ))
    }
}
