//! Between the messages of the proto and the words of the domain.

use arthro_authority::{Lease, OperationState};
use arthro_proto::common::v1 as common;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::axis_position::Value;
use epos4_link::canopen::object::Address;

use super::field_of;
use crate::axis::{Axis, AxisSpec, Unit};
use crate::bite::Jaw;
use crate::drives::{Authorization, AxisState, Readiness, Report, Snapshot};
use crate::error::Refusal;

// === into the domain ===

pub(super) fn authorization(
    given: Option<common::Authorization>,
) -> Result<Authorization, Refusal> {
    let common::Authorization {
        fencing_token,
        operation_id,
    } = given.ok_or_else(|| {
        invalid(
            "authorization",
            "is missing; a command needs a lease's fencing token and an id",
        )
    })?;
    Ok(Authorization {
        fencing_token,
        operation_id,
    })
}

pub(super) fn axis(field: &'static str, given: i32) -> Result<Axis, Refusal> {
    match proto::Axis::try_from(given) {
        Ok(proto::Axis::ForcepsRotation) => Ok(Axis::ForcepsRotation),
        Ok(proto::Axis::ForcepsFeed) => Ok(Axis::ForcepsFeed),
        Ok(proto::Axis::ArthroscopeRotation) => Ok(Axis::ArthroscopeRotation),
        Ok(proto::Axis::ArthroscopeFeed) => Ok(Axis::ArthroscopeFeed),
        Ok(proto::Axis::Unspecified) | Err(_) => {
            Err(invalid(field, format!("is {given}; there are axes 1 to 4")))
        }
    }
}

/// None means all, feeds first: an instrument is drawn back before it is turned.
pub(super) fn axes_to_home(given: &[i32]) -> Result<Vec<Axis>, Refusal> {
    if given.is_empty() {
        return Ok(vec![
            Axis::ForcepsFeed,
            Axis::ArthroscopeFeed,
            Axis::ForcepsRotation,
            Axis::ArthroscopeRotation,
        ]);
    }
    let mut axes = Vec::new();
    for number in given {
        let axis = axis("axes", *number)?;
        if axes.contains(&axis) {
            return Err(invalid("axes", format!("names {axis} twice")));
        }
        axes.push(axis);
    }
    Ok(axes)
}

pub(super) fn target(axis: Axis, given: Option<proto::AxisPosition>) -> Result<f64, Refusal> {
    match (axis.unit(), given.and_then(|position| position.value)) {
        (Unit::Degree, Some(Value::AngleDeg(value)))
        | (Unit::Millimetre, Some(Value::FeedMm(value))) => Ok(value),
        (unit, Some(Value::AngleDeg(_))) => Err(wrong_unit(axis, unit, "angle_deg")),
        (unit, Some(Value::FeedMm(_))) => Err(wrong_unit(axis, unit, "feed_mm")),
        (unit, None) => Err(invalid(
            "target",
            format!("is missing; {axis} takes {}", field_of(unit)),
        )),
    }
}

fn wrong_unit(axis: Axis, unit: Unit, given: &str) -> Refusal {
    invalid(
        "target",
        format!("is {given}; {axis} takes {}", field_of(unit)),
    )
}

pub(super) fn object_address(index: u32, subindex: u32) -> Result<Address, Refusal> {
    let index = u16::try_from(index)
        .ok()
        .filter(|index| *index >= 0x1000)
        .ok_or_else(|| {
            invalid(
                "index",
                format!("is 0x{index:X}; objects are 0x1000 to 0xFFFF"),
            )
        })?;
    let subindex = u8::try_from(subindex)
        .map_err(|_| invalid("subindex", format!("is {subindex}; at most 255")))?;
    Ok(Address::new(index, subindex))
}

/// A number within limits; 0 stands for the default.
pub(super) fn optional_within(
    field: &'static str,
    given: f64,
    lowest: f64,
    highest: f64,
    default: f64,
) -> Result<f64, Refusal> {
    if given == 0.0 {
        return Ok(default);
    }
    if (lowest..=highest).contains(&given) {
        return Ok(given);
    }
    Err(invalid(
        field,
        format!("is {given}; must be within {lowest} to {highest}, or 0 for {default}"),
    ))
}

fn invalid(field: &'static str, problem: impl Into<String>) -> Refusal {
    Refusal::Invalid {
        field,
        problem: problem.into(),
    }
}

// === out of the domain ===

pub(super) fn lease(lease: &Lease) -> common::Lease {
    common::Lease {
        fencing_token: lease.fencing_token,
        holder: lease.holder.clone(),
        ttl_s: lease.ttl.as_secs_f64(),
    }
}

pub(super) fn operation(report: &Report, repeated: bool) -> common::Operation {
    let operation = &report.operation;
    let state = match operation.state {
        OperationState::Running => common::OperationState::Running,
        OperationState::Done => common::OperationState::Done,
        OperationState::Failed => common::OperationState::Failed,
        OperationState::Stopped => common::OperationState::Stopped,
        OperationState::InDoubt => common::OperationState::InDoubt,
    };
    common::Operation {
        operation_id: operation.id.clone(),
        state: state.into(),
        reason: operation.reason.clone(),
        detail: operation.detail.clone(),
        repeated,
    }
}

pub(super) fn jaw(jaw: Jaw) -> proto::JawState {
    match jaw {
        Jaw::Open => proto::JawState::Open,
        Jaw::Moving => proto::JawState::Moving,
        Jaw::ClosedEmpty => proto::JawState::ClosedEmpty,
        Jaw::ClosedOnTissue => proto::JawState::ClosedOnTissue,
        Jaw::Unknown => proto::JawState::Unknown,
    }
}

pub(super) fn state(snapshot: &Snapshot) -> proto::WatchStateResponse {
    proto::WatchStateResponse {
        axes: Axis::ALL
            .into_iter()
            .map(|axis| axis_state(axis, snapshot))
            .collect(),
        jaw: jaw(snapshot.jaw).into(),
    }
}

pub(super) fn axis_state(axis: Axis, snapshot: &Snapshot) -> proto::AxisState {
    let state = &snapshot.axes[axis.index()];
    let sample = state.sample;
    let drive_state = sample.and_then(|sample| sample.statusword.state());
    let (fault_reason, fault_detail) = match (&state.fault, &state.readiness) {
        (Some(fault), _) => (fault.reason.to_owned(), fault.detail.clone()),
        (None, Readiness::NotReady { detail, .. }) => ("AXIS_NOT_READY".to_owned(), detail.clone()),
        (None, Readiness::Ready) => Default::default(),
    };
    proto::AxisState {
        axis: axis_number(axis),
        position: sample.map(|sample| position(axis, sample.position)),
        statusword: sample.map_or(0, |sample| sample.statusword.0.into()),
        drive_state: drive_state.map_or_else(|| "UNKNOWN".to_owned(), |state| state.to_string()),
        nmt_state: state
            .nmt_state
            .map_or_else(|| "UNKNOWN".to_owned(), |state| state.to_string()),
        current_ma: sample.map_or(0.0, |sample| sample.current_ma),
        homed: state.is_homed(),
        moving: state.moving,
        fault_reason,
        fault_detail,
        operation_id: state.operation_id.clone().unwrap_or_default(),
    }
}

pub(super) fn description(spec: &AxisSpec, state: &AxisState) -> proto::AxisDescription {
    let identity = state.identity.unwrap_or_default();
    proto::AxisDescription {
        axis: axis_number(spec.axis),
        node_id: spec.node_id.into(),
        vendor_id: identity.vendor_id,
        product_code: identity.product_code,
        revision: identity.revision,
        serial_number: identity.serial_number,
        lowest: Some(position(spec.axis, spec.travel.lowest)),
        highest: Some(position(spec.axis, spec.travel.highest)),
        quadcounts_per_unit: spec.drivetrain.quadcounts_per_unit(),
    }
}

fn position(axis: Axis, value: f64) -> proto::AxisPosition {
    let value = match axis.unit() {
        Unit::Degree => Value::AngleDeg(value),
        Unit::Millimetre => Value::FeedMm(value),
    };
    proto::AxisPosition { value: Some(value) }
}

fn axis_number(axis: Axis) -> i32 {
    let axis = match axis {
        Axis::ForcepsRotation => proto::Axis::ForcepsRotation,
        Axis::ForcepsFeed => proto::Axis::ForcepsFeed,
        Axis::ArthroscopeRotation => proto::Axis::ArthroscopeRotation,
        Axis::ArthroscopeFeed => proto::Axis::ArthroscopeFeed,
    };
    axis.into()
}
