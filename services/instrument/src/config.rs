//! What can be set: the bus, the axes, homing and bite; and the check that turns it into a [`Cell`].

mod axis;
mod bite;

use std::time::Duration;

use epos4_link::bus;
use serde::{Deserialize, Serialize};

use crate::axis::Axis;
use crate::bite::BiteSpec;

pub use self::axis::{
    AxisConfig, AxisSettings, FunctionConfig, HomingConfig, LevelConfig, SwitchConfig,
};
pub use self::bite::BiteConfig;

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
                // Optoelectronic, and dark when its wire is cut.
                forceps_feed: AxisConfig::feed(2, retracted(LevelConfig::Low, true)),
                arthroscope_rotation: AxisConfig::rotation(3, -45.0, 180.0),
                // A proximity switch.
                arthroscope_feed: AxisConfig::feed(4, retracted(LevelConfig::High, false)),
            },
            bite: BiteConfig::default(),
        }
    }
}

/// The limit switch at the retracted end of a feed.
fn retracted(active: LevelConfig, normally_closed: bool) -> SwitchConfig {
    SwitchConfig {
        input: 1,
        function: FunctionConfig::NegativeLimit,
        active,
        normally_closed,
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
    use crate::axis::Travel;

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
