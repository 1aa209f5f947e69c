//! What can be set: the bus, the axes, homing and bite; and the check that turns it into a [`Cell`].

use std::time::Duration;

use epos4_link::bus;
use serde::{Deserialize, Serialize};

use crate::axis::{Axis, AxisSpec, Drivetrain, Travel};
use crate::bite::BiteSpec;
use crate::homing::{HomingSpec, Method};

/// The section `[instrument]`.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// `socketcan:can0` or `socketcand://host:port/can0`.
    pub bus: String,
    /// What object 0x1018:01 of every drive must be.
    pub vendor_id: u32,
    /// What object 0x1018:02 of every drive must be.
    pub product_code: u32,
    /// Period of the drives' heartbeats, ms.
    pub heartbeat_ms: u16,
    /// A drive is lost when no heartbeat came for this long on the clock of the bus, ms.
    pub heartbeat_timeout_ms: u16,
    /// The number of this host on the bus, for its heartbeat, 1 to 127 and none of a drive.
    pub host_node_id: u8,
    /// Of the bus, bits a second: what its load is measured against.
    pub bit_rate: u32,
    /// The bus is lost when nothing at all came for this long in real time, s.
    pub bus_silence_s: f64,
    /// How long an SDO answer is waited for in real time, s.
    pub sdo_timeout_s: f64,
    /// The axes.
    pub axes: Axes,
    /// The bite.
    pub bite: BiteConfig,
}

/// One section an axis.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Turns the jaw.
    pub forceps_rotation: AxisConfig,
    /// Closes the jaw.
    pub forceps_feed: AxisConfig,
    /// Turns the view.
    pub arthroscope_rotation: AxisConfig,
    /// Moves the arthroscope.
    pub arthroscope_feed: AxisConfig,
}

/// An axis: mm and mm/s for feeds, degrees and degrees/s for rotations.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisConfig {
    /// 1 to 127.
    pub node_id: u8,
    /// Lowest position.
    pub lowest: f64,
    /// Highest position.
    pub highest: f64,
    /// Four times the encoder's pulses.
    pub quadcounts_per_motor_turn: u32,
    /// Motor turns for one of the gear's output, numerator.
    pub gear_numerator: u32,
    /// Denominator.
    pub gear_denominator: u32,
    /// Lead of the screw, mm, or 360 degrees times the belt's ratio. Negative reverses the axis.
    pub travel_per_gear_turn: f64,
    /// Speed of moves.
    pub speed: f64,
    /// Acceleration of moves.
    pub acceleration: f64,
    /// Deceleration of a quick stop.
    pub quick_stop_deceleration: f64,
    /// What the drive may draw at most, mA.
    pub current_limit_ma: f64,
    /// How far the motor may lag behind its profile.
    pub following_error: f64,
    /// How near to its target a move must end.
    pub tolerance: f64,
    /// How its reference is found.
    pub homing: HomingConfig,
}

/// Homing of an axis.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HomingConfig {
    /// Number of the EPOS4's method: 17 negative limit switch, -4 current threshold at the negative stop, 33 and 34
    /// index, 37 the present position, ...
    pub method: i8,
    /// The position of the home point.
    pub position: f64,
    /// Speed of the search.
    pub search_speed: f64,
    /// Speed of the exact approach.
    pub approach_speed: f64,
    /// The current that ends the methods -1 to -4, mA.
    pub current_threshold_ma: u16,
}

/// The bite of the forceps feed.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BiteConfig {
    /// Where the jaw is open, mm.
    pub open_mm: f64,
    /// Where the empty jaws touch, mm.
    pub closed_mm: f64,
    /// Closing speed, mm/s.
    pub speed_mm_s: f64,
    /// The highest current of a bite, mA.
    pub current_limit_ma: f64,
    /// A current above this while closing means that something is between the jaws, mA.
    pub contact_current_ma: f64,
}

/// The checked configuration.
#[derive(Clone, PartialEq, Debug)]
pub struct Cell {
    /// Where the drives are.
    pub bus: bus::Address,
    /// What every drive must be.
    pub vendor_id: u32,
    /// What every drive must be.
    pub product_code: u32,
    /// Of the drives.
    pub heartbeat_ms: u16,
    /// Bus time.
    pub heartbeat_timeout: Duration,
    /// Of this host.
    pub host_node_id: u8,
    /// Bits a second.
    pub bit_rate: u32,
    /// Real time.
    pub bus_silence: Duration,
    /// Real time.
    pub sdo_timeout: Duration,
    /// In the order of [`Axis::ALL`].
    pub axes: [AxisSettings; 4],
    /// The bite.
    pub bite: BiteSpec,
}

/// One axis, checked.
#[derive(Clone, PartialEq, Debug)]
pub struct AxisSettings {
    /// As built.
    pub spec: AxisSpec,
    /// How its reference is found.
    pub homing: HomingSpec,
}

/// A value that cannot be used.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
#[error("instrument.{key}: {problem}")]
pub struct ConfigError {
    /// Which key of the section.
    pub key: String,
    /// What is wrong, with value and limit.
    pub problem: String,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            bus: "socketcan:can0".to_owned(),
            vendor_id: 0x0000_00FB,
            // EPOS4 Compact 24/1.5 CAN, part 546714.
            product_code: 0x6050_0000,
            heartbeat_ms: 100,
            heartbeat_timeout_ms: 300,
            host_node_id: 127,
            bit_rate: 1_000_000,
            bus_silence_s: 3.0,
            sdo_timeout_s: 2.0,
            axes: Axes {
                forceps_rotation: AxisConfig::rotation(1, -180.0, 180.0),
                forceps_feed: AxisConfig::feed(2),
                arthroscope_rotation: AxisConfig::rotation(3, -45.0, 180.0),
                arthroscope_feed: AxisConfig::feed(4),
            },
            bite: BiteConfig::default(),
        }
    }
}

impl Default for BiteConfig {
    fn default() -> Self {
        Self {
            open_mm: 0.0,
            closed_mm: 10.0,
            speed_mm_s: 5.0,
            current_limit_ma: 500.0,
            contact_current_ma: 120.0,
        }
    }
}

impl AxisConfig {
    fn rotation(node_id: u8, lowest: f64, highest: f64) -> Self {
        Self {
            node_id,
            lowest,
            highest,
            quadcounts_per_motor_turn: 2048,
            gear_numerator: 21,
            gear_denominator: 1,
            travel_per_gear_turn: 360.0,
            speed: 90.0,
            acceleration: 360.0,
            quick_stop_deceleration: 1440.0,
            current_limit_ma: 800.0,
            following_error: 17.0,
            tolerance: 0.2,
            // These axes have no switch: the instrument is put into its socket at zero.
            homing: HomingConfig {
                method: 37,
                position: 0.0,
                search_speed: 20.0,
                approach_speed: 5.0,
                current_threshold_ma: 400,
            },
        }
    }

    fn feed(node_id: u8) -> Self {
        Self {
            node_id,
            lowest: -1.0,
            highest: 14.0,
            quadcounts_per_motor_turn: 2048,
            gear_numerator: 21,
            gear_denominator: 1,
            travel_per_gear_turn: 2.0,
            speed: 10.0,
            acceleration: 50.0,
            quick_stop_deceleration: 200.0,
            current_limit_ma: 800.0,
            following_error: 0.1,
            tolerance: 0.02,
            // The optoelectronic and the proximity switch stand at the retracted end.
            homing: HomingConfig {
                method: 17,
                position: -1.0,
                search_speed: 4.0,
                approach_speed: 0.5,
                current_threshold_ma: 400,
            },
        }
    }
}

impl Config {
    /// Checks every value.
    pub fn check(&self) -> Result<Cell, ConfigError> {
        let bus = self
            .bus
            .parse()
            .map_err(|error: bus::Error| bad("bus", error.to_string()))?;
        if self.heartbeat_ms == 0 || self.heartbeat_timeout_ms < 2 * self.heartbeat_ms {
            let problem = format!(
                "{} ms is less than two heartbeats of {} ms, of which there must be some",
                self.heartbeat_timeout_ms, self.heartbeat_ms
            );
            return Err(bad("heartbeat_timeout_ms", problem));
        }
        let axes = &self.axes;
        let axes = [
            axes.forceps_rotation.check(Axis::ForcepsRotation)?,
            axes.forceps_feed.check(Axis::ForcepsFeed)?,
            axes.arthroscope_rotation.check(Axis::ArthroscopeRotation)?,
            axes.arthroscope_feed.check(Axis::ArthroscopeFeed)?,
        ];
        for (i, axis) in axes.iter().enumerate() {
            if axes[..i]
                .iter()
                .any(|other| other.spec.node_id == axis.spec.node_id)
            {
                let problem = format!("{} belongs to another axis already", axis.spec.node_id);
                return Err(bad(format!("axes.{}.node_id", axis.spec.axis), problem));
            }
        }
        if !(1..=127).contains(&self.host_node_id)
            || axes
                .iter()
                .any(|axis| axis.spec.node_id == self.host_node_id)
        {
            let problem = format!(
                "{} is not within 1 to 127, or belongs to a drive",
                self.host_node_id
            );
            return Err(bad("host_node_id", problem));
        }
        if !(10_000..=1_000_000).contains(&self.bit_rate) {
            let problem = format!("{} is not within 10000 to 1000000", self.bit_rate);
            return Err(bad("bit_rate", problem));
        }
        let bite = self.bite.check(&axes[Axis::ForcepsFeed.index()].spec)?;
        Ok(Cell {
            bus,
            vendor_id: self.vendor_id,
            product_code: self.product_code,
            heartbeat_ms: self.heartbeat_ms,
            heartbeat_timeout: Duration::from_millis(self.heartbeat_timeout_ms.into()),
            host_node_id: self.host_node_id,
            bit_rate: self.bit_rate,
            bus_silence: Duration::from_secs_f64(within(
                "bus_silence_s",
                self.bus_silence_s,
                0.1,
                60.0,
            )?),
            sdo_timeout: Duration::from_secs_f64(within(
                "sdo_timeout_s",
                self.sdo_timeout_s,
                0.01,
                10.0,
            )?),
            axes,
            bite,
        })
    }
}

impl AxisConfig {
    fn check(&self, axis: Axis) -> Result<AxisSettings, ConfigError> {
        let key = |name: &str| format!("axes.{axis}.{name}");
        let positive = |name: &str, value: f64| within(key(name), value, f64::MIN_POSITIVE, 1e6);
        if !(1..=127).contains(&self.node_id) {
            return Err(bad(
                key("node_id"),
                format!("{} is not within 1 to 127", self.node_id),
            ));
        }
        let lowest = within(key("lowest"), self.lowest, -1e4, 1e4)?;
        let highest = within(key("highest"), self.highest, -1e4, 1e4)?;
        if lowest >= highest {
            return Err(bad(
                key("highest"),
                format!("{highest} is not above lowest, which is {lowest}"),
            ));
        }
        if self.quadcounts_per_motor_turn == 0
            || self.gear_numerator == 0
            || self.gear_denominator == 0
        {
            return Err(bad(
                key("gear_numerator"),
                "encoder and gear must not be 0".to_owned(),
            ));
        }
        positive("travel_per_gear_turn", self.travel_per_gear_turn.abs())?;
        let drivetrain = Drivetrain {
            quadcounts_per_motor_turn: self.quadcounts_per_motor_turn,
            gear_numerator: self.gear_numerator,
            gear_denominator: self.gear_denominator,
            travel_per_gear_turn: self.travel_per_gear_turn,
        };
        let farthest = lowest.abs().max(highest.abs()) * drivetrain.quadcounts_per_unit().abs();
        if farthest > f64::from(i32::MAX) / 2.0 {
            return Err(bad(
                key("highest"),
                format!("{farthest} quadcounts do not fit into the drive's counter"),
            ));
        }
        let spec = AxisSpec {
            axis,
            node_id: self.node_id,
            travel: Travel { lowest, highest },
            drivetrain,
            speed: positive("speed", self.speed)?,
            acceleration: positive("acceleration", self.acceleration)?,
            quick_stop_deceleration: positive(
                "quick_stop_deceleration",
                self.quick_stop_deceleration,
            )?,
            current_limit_ma: positive("current_limit_ma", self.current_limit_ma)?,
            following_error: positive("following_error", self.following_error)?,
            tolerance: positive("tolerance", self.tolerance)?,
        };
        let homing = HomingSpec {
            method: Method::from_code(self.homing.method).ok_or_else(|| {
                bad(
                    key("homing.method"),
                    format!("{} is no homing method of the drive", self.homing.method),
                )
            })?,
            position: within(
                key("homing.position"),
                self.homing.position,
                lowest,
                highest,
            )?,
            search_speed: positive("homing.search_speed", self.homing.search_speed)?,
            approach_speed: positive("homing.approach_speed", self.homing.approach_speed)?,
            current_threshold_ma: self.homing.current_threshold_ma,
        };
        Ok(AxisSettings { spec, homing })
    }
}

impl BiteConfig {
    fn check(&self, feed: &AxisSpec) -> Result<BiteSpec, ConfigError> {
        let Travel { lowest, highest } = feed.travel;
        let open_mm = within("bite.open_mm", self.open_mm, lowest, highest)?;
        let closed_mm = within("bite.closed_mm", self.closed_mm, open_mm, highest)?;
        let limit_ma = within(
            "bite.current_limit_ma",
            self.current_limit_ma,
            1.0,
            feed.current_limit_ma,
        )?;
        Ok(BiteSpec {
            open_mm,
            closed_mm,
            speed_mm_s: within(
                "bite.speed_mm_s",
                self.speed_mm_s,
                f64::MIN_POSITIVE,
                feed.speed,
            )?,
            current_limit_ma: limit_ma,
            contact_current_ma: within(
                "bite.contact_current_ma",
                self.contact_current_ma,
                1.0,
                limit_ma,
            )?,
        })
    }
}

fn within(
    key: impl Into<String>,
    value: f64,
    lowest: f64,
    highest: f64,
) -> Result<f64, ConfigError> {
    if (lowest..=highest).contains(&value) {
        return Ok(value);
    }
    Err(bad(
        key,
        format!("{value} is not within {lowest} to {highest}"),
    ))
}

fn bad(key: impl Into<String>, problem: String) -> ConfigError {
    ConfigError {
        key: key.into(),
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_the_papers_cell() {
        let cell = Config::default().check().unwrap();
        assert_eq!(
            cell.axes.each_ref().map(|axis| axis.spec.node_id),
            [1, 2, 3, 4]
        );
        assert_eq!(
            cell.axes[3].spec.travel,
            Travel {
                lowest: -1.0,
                highest: 14.0
            }
        );
    }

    #[test]
    fn a_bad_value_is_named_with_its_key_and_limits() {
        type Spoil = fn(&mut Config);
        let change: [(Spoil, &str); 9] = [
            (
                |config| config.bus = "can0".into(),
                "instrument.bus: bus address \"can0\"",
            ),
            (
                |config| config.heartbeat_timeout_ms = 150,
                "instrument.heartbeat_timeout_ms: 150 ms",
            ),
            (
                |config| config.host_node_id = 2,
                "instrument.host_node_id: 2 is not within 1 to 127, or belongs",
            ),
            (
                |config| config.bit_rate = 0,
                "instrument.bit_rate: 0 is not within 10000",
            ),
            (
                |config| config.axes.forceps_feed.node_id = 4,
                "instrument.axes.arthroscope_feed.node_id: 4 belongs",
            ),
            (
                |config| config.axes.forceps_feed.highest = -2.0,
                "instrument.axes.forceps_feed.highest: -2",
            ),
            (
                |config| config.axes.forceps_rotation.speed = f64::NAN,
                "instrument.axes.forceps_rotation.speed: NaN",
            ),
            (
                |config| config.axes.forceps_feed.homing.method = 3,
                "homing.method: 3 is no",
            ),
            (
                |config| config.bite.current_limit_ma = 900.0,
                "instrument.bite.current_limit_ma: 900 is not within 1 to 800",
            ),
        ];
        for (spoil, message) in change {
            let mut config = Config::default();
            spoil(&mut config);
            let error = config.check().unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
    }
}
