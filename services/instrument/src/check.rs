//! What a drive must be before it is commanded: its identity, and the stored settings that decide where an axis goes, how
//! hard it presses and which switch stops it. A drive that is another one, or was set up for another axis, is refused.

use std::fmt;

use epos4_link::canopen::object::{Address, Object};
use epos4_link::cia402::Mode;
use epos4_link::objects::{self, INPUT_COUNT};

use crate::axis::{AxisSpec, Ratio};
use crate::config::{AxisSettings, Cell};

/// How far the drive's own position limits stand beyond the travel, as a share of it: the service refuses first.
const LIMIT_MARGIN: f64 = 0.01;

/// What was read of a drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Found {
    /// Object 0x1018:01.
    pub vendor_id: u32,
    /// Object 0x1018:02.
    pub product_code: u32,
    /// Object 0x3000:05, quadcounts a turn.
    pub main_sensor_resolution: u32,
    /// Object 0x3010:01, pulses a turn.
    pub encoder_pulses: u32,
    /// Object 0x3003:01.
    pub gear_numerator: u32,
    /// Object 0x3003:02.
    pub gear_denominator: u32,
    /// Object 0x3001:02, mA.
    pub output_current_limit_ma: u32,
    /// Object 0x607D:01, quadcounts.
    pub min_position_limit: i32,
    /// Object 0x607D:02, quadcounts.
    pub max_position_limit: i32,
    /// Objects 0x3142:01 to :08.
    pub input_functions: [u8; INPUT_COUNT as usize],
    /// Object 0x3141:02.
    pub input_polarity: u16,
    /// Object 0x6502.
    pub supported_drive_modes: u32,
}

/// An object that is not as configured.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Mismatch {
    /// Whether it says that the drive is another one.
    pub kind: Kind,
    /// Which object.
    pub object: Address,
    /// Its name.
    pub name: &'static str,
    /// What it is.
    pub found: String,
    /// What it should be.
    pub expected: String,
}

/// What a mismatch says of the drive.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// Another maker or product.
    Identity,
    /// The right product with other settings.
    Configuration,
}

impl Mismatch {
    fn new<T>(
        kind: Kind,
        object: Object<T>,
        found: impl fmt::Display,
        expected: impl fmt::Display,
    ) -> Self {
        Self {
            kind,
            object: object.address,
            name: object.name,
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            object,
            name,
            found,
            expected,
            ..
        } = self;
        write!(f, "{name} ({object}) is {found}, configured is {expected}")
    }
}

/// The stable word for what is wrong with a drive: WRONG_DEVICE or CONFIGURATION_MISMATCH; `None` when nothing is.
pub fn reason(mismatches: &[Mismatch]) -> Option<&'static str> {
    let is_other = |mismatch: &Mismatch| mismatch.kind == Kind::Identity;
    match mismatches {
        [] => None,
        mismatches if mismatches.iter().any(is_other) => Some("WRONG_DEVICE"),
        _ => Some("CONFIGURATION_MISMATCH"),
    }
}

/// The drive's own position limits for an axis, object 0x607D, lower and upper, quadcounts.
pub fn position_limits(spec: &AxisSpec) -> [i32; 2] {
    let margin = LIMIT_MARGIN * spec.travel.span();
    let [a, b] = [spec.travel.lowest - margin, spec.travel.highest + margin]
        .map(|end| spec.drivetrain.to_quadcounts(end));
    [a.min(b), a.max(b)]
}

/// Everything that is not as configured.
pub fn mismatches(found: &Found, cell: &Cell, settings: &AxisSettings) -> Vec<Mismatch> {
    let mut mismatches = identity(found, cell);
    mismatches.extend(drivetrain(found, &settings.spec));
    mismatches.extend(limits(found, cell, &settings.spec));
    mismatches.extend(inputs(found, settings));
    mismatches
}

fn identity(found: &Found, cell: &Cell) -> Vec<Mismatch> {
    let mut mismatches = Vec::new();
    for (object, is, expected) in [
        (objects::VENDOR_ID, found.vendor_id, cell.vendor_id),
        (objects::PRODUCT_CODE, found.product_code, cell.product_code),
    ] {
        if is != expected {
            mismatches.push(Mismatch::new(
                Kind::Identity,
                object,
                format_args!("0x{is:08X}"),
                format_args!("0x{expected:08X}"),
            ));
        }
    }
    // Bit n - 1 is mode n (CiA 402, 6502).
    let missing = [Mode::ProfilePosition, Mode::Homing]
        .into_iter()
        .any(|mode| found.supported_drive_modes >> (mode.code() - 1) & 1 == 0);
    if missing {
        mismatches.push(Mismatch::new(
            Kind::Identity,
            objects::SUPPORTED_DRIVE_MODES,
            format_args!("0x{:08X}", found.supported_drive_modes),
            "profile position (bit 0) and homing (bit 5)",
        ));
    }
    mismatches
}

fn drivetrain(found: &Found, spec: &AxisSpec) -> Vec<Mismatch> {
    let mut mismatches = Vec::new();
    let quadcounts = spec.drivetrain.quadcounts_per_motor_turn;
    if found.main_sensor_resolution != quadcounts {
        mismatches.push(Mismatch::new(
            Kind::Configuration,
            objects::MAIN_SENSOR_RESOLUTION,
            found.main_sensor_resolution,
            quadcounts,
        ));
    }
    if u64::from(found.encoder_pulses) * 4 != u64::from(quadcounts) {
        mismatches.push(Mismatch::new(
            Kind::Configuration,
            objects::ENCODER_PULSES,
            found.encoder_pulses,
            f64::from(quadcounts) / 4.0,
        ));
    }
    let gear = Ratio {
        numerator: found.gear_numerator,
        denominator: found.gear_denominator,
    };
    if gear.denominator == 0 || !gear.equals(spec.drivetrain.gear) {
        mismatches.push(Mismatch::new(
            Kind::Configuration,
            objects::GEAR_NUMERATOR,
            gear,
            spec.drivetrain.gear,
        ));
    }
    mismatches
}

/// The current limit is the configured one, or what a bite leaves. The position limits are off, as stored, or those that
/// this service sets after homing.
fn limits(found: &Found, cell: &Cell, spec: &AxisSpec) -> Vec<Mismatch> {
    let mut mismatches = Vec::new();
    let configured_ma = spec.current_limit_ma.round() as u32;
    let bite_ma = cell.bite.current_limit_ma.round() as u32;
    let limit_ma = found.output_current_limit_ma;
    let is_left_by_bite = spec.axis.closes_jaw() && (1..=bite_ma).contains(&limit_ma);
    if limit_ma != configured_ma && !is_left_by_bite {
        let expected = if spec.axis.closes_jaw() {
            format!("{configured_ma} mA, or at most the {bite_ma} mA of a bite")
        } else {
            format!("{configured_ma} mA")
        };
        mismatches.push(Mismatch::new(
            Kind::Configuration,
            objects::OUTPUT_CURRENT_LIMIT,
            format_args!("{limit_ma} mA"),
            expected,
        ));
    }
    let is = [found.min_position_limit, found.max_position_limit];
    let own = position_limits(spec);
    if is != [0, 0] && is != own {
        mismatches.push(Mismatch::new(
            Kind::Configuration,
            objects::MIN_POSITION_LIMIT,
            format_args!("{} to {} qc", is[0], is[1]),
            format_args!("0 to 0 or {} to {} qc", own[0], own[1]),
        ));
    }
    mismatches
}

fn inputs(found: &Found, settings: &AxisSettings) -> Vec<Mismatch> {
    let mut mismatches = Vec::new();
    for switch in &settings.switches {
        let place = usize::from(switch.input) - 1;
        let function = found.input_functions[place];
        if function != switch.function.code() {
            mismatches.push(Mismatch::new(
                Kind::Configuration,
                objects::digital_input_function(switch.input),
                function,
                format_args!("{}, {}", switch.function.code(), switch.function),
            ));
        }
        let own_bit = 1 << place;
        if (found.input_polarity ^ switch.polarity_mask()) & own_bit != 0 {
            let active = |mask: u16| match mask & own_bit {
                0 => "high",
                _ => "low",
            };
            mismatches.push(Mismatch::new(
                Kind::Configuration,
                objects::INPUT_POLARITY,
                format_args!(
                    "0x{:04X}: input {} is active {}",
                    found.input_polarity,
                    switch.input,
                    active(found.input_polarity)
                ),
                format_args!("active {}", active(switch.polarity_mask())),
            ));
        }
    }
    mismatches
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::config::Config;

    fn cell() -> Cell {
        Config::default().check().unwrap()
    }

    /// A drive that is set up for an axis.
    fn drive(axis: Axis) -> Found {
        let cell = cell();
        let settings = &cell.axes[axis.index()];
        let mut input_functions = [255; INPUT_COUNT as usize];
        let mut input_polarity = 0;
        for switch in &settings.switches {
            input_functions[usize::from(switch.input) - 1] = switch.function.code();
            input_polarity |= switch.polarity_mask();
        }
        Found {
            vendor_id: 0xFB,
            product_code: 0x6050_0000,
            main_sensor_resolution: 2048,
            encoder_pulses: 512,
            gear_numerator: 21,
            gear_denominator: 1,
            output_current_limit_ma: 800,
            min_position_limit: 0,
            max_position_limit: 0,
            input_functions,
            input_polarity,
            supported_drive_modes: 0x3A5,
        }
    }

    fn told(axis: Axis, found: &Found) -> (Option<&'static str>, Vec<String>) {
        let cell = cell();
        let mismatches = mismatches(found, &cell, &cell.axes[axis.index()]);
        let texts = mismatches.iter().map(Mismatch::to_string).collect();
        (reason(&mismatches), texts)
    }

    #[test]
    fn a_drive_as_configured_is_taken_also_after_homing_and_a_bite() {
        for axis in Axis::ALL {
            assert_eq!(told(axis, &drive(axis)), (None, vec![]));
            let [min_position_limit, max_position_limit] =
                position_limits(&cell().axes[axis.index()].spec);
            let homed = Found {
                min_position_limit,
                max_position_limit,
                ..drive(axis)
            };
            assert_eq!(told(axis, &homed), (None, vec![]));
        }
        let bitten = Found {
            output_current_limit_ma: 500,
            ..drive(Axis::ForcepsFeed)
        };
        assert_eq!(told(Axis::ForcepsFeed, &bitten), (None, vec![]));
    }

    #[test]
    fn another_product_is_the_wrong_device_whatever_else_it_is() {
        let other = Found {
            product_code: 0x6150_0000,
            gear_numerator: 1,
            ..drive(Axis::ForcepsFeed)
        };
        let (reason, texts) = told(Axis::ForcepsFeed, &other);
        assert_eq!(reason, Some("WRONG_DEVICE"));
        assert_eq!(
            texts,
            [
                "product code (0x1018:02) is 0x61500000, configured is 0x60500000",
                "gear reduction numerator (0x3003:01) is 1/1, configured is 21/1",
            ]
        );
        let without_homing = Found {
            supported_drive_modes: 0x1,
            ..drive(Axis::ForcepsFeed)
        };
        assert_eq!(
            told(Axis::ForcepsFeed, &without_homing).0,
            Some("WRONG_DEVICE")
        );
    }

    #[test]
    fn each_setting_that_differs_is_named_with_found_and_expected() {
        type Spoil = fn(&mut Found);
        let spoilt: [(Spoil, &str); 7] = [
            (
                |found| found.main_sensor_resolution = 8192,
                "main sensor resolution (0x3000:05) is 8192, configured is 2048",
            ),
            (
                |found| found.encoder_pulses = 500,
                "encoder number of pulses (0x3010:01) is 500, configured is 512",
            ),
            (
                |found| found.gear_denominator = 0,
                "gear reduction numerator (0x3003:01) is 21/0, configured is 21/1",
            ),
            (
                |found| found.output_current_limit_ma = 1500,
                "output current limit (0x3001:02) is 1500 mA, configured is 800 mA, or at most the 500 mA of a bite",
            ),
            (
                |found| found.max_position_limit = 1000,
                "min position limit (0x607D:01) is 0 to 1000 qc, configured is 0 to 0 or -24730 to 304282 qc",
            ),
            (
                |found| found.input_functions[0] = 255,
                "digital input function (0x3142:01) is 255, configured is 0, negative limit switch",
            ),
            (
                |found| found.input_polarity = 0,
                "digital input polarity (0x3141:02) is 0x0000: input 1 is active high, configured is active low",
            ),
        ];
        for (spoil, text) in spoilt {
            let mut found = drive(Axis::ForcepsFeed);
            spoil(&mut found);
            let told = told(Axis::ForcepsFeed, &found);
            assert_eq!(
                told,
                (Some("CONFIGURATION_MISMATCH"), vec![text.to_owned()])
            );
        }
        let rotation = Found {
            output_current_limit_ma: 500,
            ..drive(Axis::ForcepsRotation)
        };
        assert_eq!(
            told(Axis::ForcepsRotation, &rotation).1,
            ["output current limit (0x3001:02) is 500 mA, configured is 800 mA"]
        );
    }
}
