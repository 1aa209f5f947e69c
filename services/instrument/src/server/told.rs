//! What the domain tells, as messages of the proto.

use arthro_authority::{Lease, OperationState};
use arthro_proto::common::v1 as common;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::axis_position::Value;
use epos4_link::cia402::Statusword;

use crate::axis::{Axis, Unit};
use crate::bite::{BiteResult, Jaw};
use crate::config::{AxisSettings, Cell};
use crate::drives::{AxisState, BusCondition, BusState, Readiness, Report, Snapshot};
use crate::positioning::Sample;
use crate::switches::commissioning::{Progress, Step};
use crate::switches::{Function, Level, SwitchSpec};

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

pub(super) fn state(cell: &Cell, snapshot: &Snapshot) -> proto::WatchStateResponse {
    proto::WatchStateResponse {
        axes: axes(cell, snapshot),
        jaw: jaw(snapshot.jaw).into(),
        bus: Some(bus(cell, &snapshot.bus)),
    }
}

pub(super) fn axes(cell: &Cell, snapshot: &Snapshot) -> Vec<proto::AxisState> {
    Axis::ALL
        .into_iter()
        .map(|axis| axis_state(cell, axis, snapshot))
        .collect()
}

fn bus(cell: &Cell, bus: &BusState) -> proto::BusState {
    let condition = match bus.condition {
        BusCondition::Down => proto::BusCondition::Down,
        BusCondition::Active => proto::BusCondition::Active,
        BusCondition::ErrorPassive => proto::BusCondition::ErrorPassive,
        BusCondition::Off => proto::BusCondition::Off,
    };
    proto::BusState {
        address: cell.bus.to_string(),
        condition: condition.into(),
        detail: bus.detail.clone(),
        transmit_errors: bus.counters.map(|counters| counters.transmit.into()),
        receive_errors: bus.counters.map(|counters| counters.receive.into()),
        load_percent: 100.0 * bus.load,
        bit_rate: bus.bit_rate,
    }
}

pub(super) fn axis_state(cell: &Cell, axis: Axis, snapshot: &Snapshot) -> proto::AxisState {
    let state = &snapshot.axes[axis.index()];
    let sample = state.sample;
    let statusword = sample.map_or(Statusword::default(), |sample| sample.statusword);
    let drive_state = sample.and_then(|sample| sample.statusword.state());
    let fault = state.fault.as_ref();
    let (fault_reason, fault_detail) = match (fault, &state.readiness) {
        (Some(fault), _) => (fault.reason.to_owned(), fault.detail.clone()),
        (None, Readiness::NotReady { detail, .. }) => ("AXIS_NOT_READY".to_owned(), detail.clone()),
        (None, Readiness::Ready) => Default::default(),
    };
    proto::AxisState {
        axis: axis_number(axis),
        position: sample.map(|sample| position(axis, sample.position)),
        statusword: statusword.0.into(),
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
        error_code: fault.and_then(|fault| fault.code).map_or(0, u32::from),
        operator_response: fault.map_or_else(String::new, |fault| fault.response.to_owned()),
        safe_torque_off: state.safe_torque_off,
        internal_limit: statusword.has(Statusword::INTERNAL_LIMIT),
        i2t_motor_percent: state.i2t.map(|i2t| i2t.motor_percent.into()),
        i2t_power_stage_percent: state.i2t.map(|i2t| i2t.power_stage_percent.into()),
        switches: switch_states(&cell.axes[axis.index()], sample.as_ref()),
        age_s: snapshot.age(axis).map(|age| age.as_secs_f64()),
    }
}

fn switch_states(settings: &AxisSettings, sample: Option<&Sample>) -> Vec<proto::SwitchState> {
    let Some(sample) = sample else {
        return Vec::new();
    };
    let state = |switch: &SwitchSpec| proto::SwitchState {
        function: function(switch.function).into(),
        active: sample.inputs >> switch.function.code() & 1 == 1,
    };
    settings.switches.iter().map(state).collect()
}

pub(super) fn description(
    cell: &Cell,
    settings: &AxisSettings,
    state: &AxisState,
) -> proto::AxisDescription {
    let AxisSettings {
        spec,
        switches,
        homing,
    } = settings;
    let identity = state.identity.unwrap_or_default();
    let (not_ready_reason, not_ready_detail) = match &state.readiness {
        Readiness::Ready => Default::default(),
        Readiness::NotReady { reason, detail } => ((*reason).to_owned(), detail.clone()),
    };
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
        expected_vendor_id: cell.vendor_id,
        expected_product_code: cell.product_code,
        homing_method: homing.method.code().into(),
        homing_description: homing.method.to_string(),
        ready: state.readiness == Readiness::Ready,
        not_ready_reason,
        not_ready_detail,
        switches: switches.iter().map(switch).collect(),
    }
}

fn switch(switch: &SwitchSpec) -> proto::SwitchDescription {
    proto::SwitchDescription {
        input: switch.input.into(),
        function: function(switch.function).into(),
        active_high: switch.active == Level::High,
        normally_closed: switch.normally_closed,
    }
}

fn function(function: Function) -> proto::SwitchFunction {
    match function {
        Function::NegativeLimit => proto::SwitchFunction::NegativeLimit,
        Function::PositiveLimit => proto::SwitchFunction::PositiveLimit,
        Function::Home => proto::SwitchFunction::Home,
    }
}

pub(super) fn bite(
    cell: &Cell,
    report: &Report,
    repeated: bool,
    snapshot: &Snapshot,
) -> proto::BiteResponse {
    let state = axis_state(cell, Axis::ForcepsFeed, snapshot);
    let mut response = proto::BiteResponse {
        operation: Some(operation(report, repeated)),
        jaw: jaw(snapshot.jaw).into(),
        peak_current_ma: state.current_ma.abs(),
        state: Some(state),
        ..proto::BiteResponse::default()
    };
    if let Some(end) = report.bite {
        let result = match end.result {
            BiteResult::ClosedEmpty => proto::BiteResult::ClosedEmpty,
            BiteResult::ClosedOnTissue => proto::BiteResult::ClosedOnTissue,
            BiteResult::NotClosed => proto::BiteResult::NotClosed,
            BiteResult::Stalled => proto::BiteResult::Stalled,
        };
        response.set_result(result);
        response.jaw = jaw(end.result.jaw()).into();
        response.peak_current_ma = end.peak_current_ma;
        response.contact_mm = end.contact_mm;
        response.force_n = end.force_n;
    }
    response
}

pub(super) fn commissioning(progress: &Progress) -> proto::SwitchCommissioning {
    let (step, error) = match progress.step {
        Step::Waiting => (proto::SwitchStep::Waiting, None),
        Step::Press => (proto::SwitchStep::Press, None),
        Step::Release => (proto::SwitchStep::Release, None),
        Step::Passed => (proto::SwitchStep::Passed, None),
        Step::Failed(error) => (proto::SwitchStep::Failed, Some(error)),
    };
    proto::SwitchCommissioning {
        switch: Some(switch(&progress.switch)),
        active: progress.active,
        step: step.into(),
        reason: error.map_or_else(String::new, |error| error.reason().to_owned()),
        detail: error.map_or_else(String::new, |error| format!("{} {error}", progress.switch)),
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
