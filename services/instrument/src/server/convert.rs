//! Requests of the proto as words of the domain, each value checked.

use arthro_proto::common::v1 as common;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::axis_position::Value;
use epos4_link::canopen::object::Address;

use super::field_of;
use crate::axis::{Axis, Unit};
use crate::bite::BiteSpec;
use crate::drives::Authorization;
use crate::error::Refusal;

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

/// The current that limits a bite, asked for as a current or as a force. A limit below contact would feel nothing.
pub(super) fn bite_limit_ma(
    bite: &BiteSpec,
    current_limit_ma: f64,
    force_limit_n: f64,
) -> Result<f64, Refusal> {
    let (lowest_ma, highest_ma) = (bite.contact.current_ma, bite.current_limit_ma);
    if force_limit_n == 0.0 {
        let field = "current_limit_ma";
        return optional_within(field, current_limit_ma, lowest_ma, highest_ma, highest_ma);
    }
    let field = "force_limit_n";
    if current_limit_ma != 0.0 {
        let problem = format!(
            "is {force_limit_n} and current_limit_ma is {current_limit_ma}; a bite has one limit"
        );
        return Err(invalid(field, problem));
    }
    let Some(table) = &bite.force else {
        let problem = format!(
            "is {force_limit_n}, but no force was calibrated (instrument.bite.force_table); give current_limit_ma"
        );
        return Err(invalid(field, problem));
    };
    let current_ma = table
        .current_ma(force_limit_n)
        .map_err(|outside| invalid(field, format!("is refused: {outside}")))?;
    if (lowest_ma..=highest_ma).contains(&current_ma) {
        return Ok(current_ma);
    }
    Err(invalid(
        field,
        format!(
            "is {force_limit_n} N, {current_ma:.0} mA; must be within {lowest_ma} to {highest_ma} mA{}",
            match (table.force_n(lowest_ma), table.force_n(highest_ma)) {
                (Some(lowest_n), Some(highest_n)) => format!(", {lowest_n:.1} to {highest_n:.1} N"),
                _ => String::new(),
            }
        ),
    ))
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
