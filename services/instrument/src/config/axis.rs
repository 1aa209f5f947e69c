//! One axis: its drive, drivetrain, travel, switches and homing.

use epos4_link::objects::INPUT_COUNT;
use serde::{Deserialize, Serialize};

use super::{ConfigError, bad, within};
use crate::axis::{Axis, AxisSpec, Drivetrain, Ratio, Travel, Unit};
use crate::homing::{HomingSpec, Method};
use crate::switches::{Function, Level, SwitchSpec};

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
    /// Motor turns for one of the gear's output, numerator. The drive must have the same in 0x3003.
    pub gear_numerator: u32,
    /// Denominator.
    pub gear_denominator: u32,
    /// Turns of the gear's output for one of the screw or of the rotation, numerator: teeth of the driven pulley.
    pub belt_numerator: u32,
    /// Denominator: teeth of the pulley on the gear.
    pub belt_denominator: u32,
    /// Lead of the screw, mm a turn: of a feed, which needs it, and of nothing else.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lead_mm: Option<f64>,
    /// Whether the axis goes up while the encoder counts down.
    pub reversed: bool,
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
    /// Its switches.
    pub switches: Vec<SwitchConfig>,
    /// How its reference is found.
    pub homing: HomingConfig,
}

/// A switch on an input of the drive.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SwitchConfig {
    /// 1 to 8.
    pub input: u8,
    /// `negative_limit`, `positive_limit` or `home`.
    pub function: FunctionConfig,
    /// The input's level when the switch is active: `low` or `high`.
    pub active: LevelConfig,
    /// Whether the contact is closed while the switch is free, so that a cut wire shows as active.
    pub normally_closed: bool,
}

/// What a switch tells.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FunctionConfig {
    /// The end of the drive's negative direction; function 0 of 0x3142.
    NegativeLimit,
    /// The end of its positive direction; function 1.
    PositiveLimit,
    /// Home switch; function 2.
    Home,
}

/// The level of an input.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LevelConfig {
    /// No voltage.
    Low,
    /// Voltage.
    High,
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
    /// How far the home point lies from where switch, index or stop was found, signed: the axis goes there.
    #[serde(default)]
    pub offset: f64,
    /// Speed of the search.
    pub search_speed: f64,
    /// Speed of the exact approach.
    pub approach_speed: f64,
    /// The current that ends the methods -1 to -4, mA.
    pub current_threshold_ma: u16,
}

/// One axis, checked.
#[derive(Clone, PartialEq, Debug)]
pub struct AxisSettings {
    /// As built.
    pub spec: AxisSpec,
    /// Its switches.
    pub switches: Vec<SwitchSpec>,
    /// How its reference is found.
    pub homing: HomingSpec,
}

impl AxisConfig {
    pub(super) fn rotation(node_id: u8, lowest: f64, highest: f64) -> Self {
        Self {
            node_id,
            lowest,
            highest,
            quadcounts_per_motor_turn: 2048,
            gear_numerator: 21,
            gear_denominator: 1,
            belt_numerator: 1,
            belt_denominator: 1,
            lead_mm: None,
            reversed: false,
            speed: 90.0,
            acceleration: 360.0,
            quick_stop_deceleration: 1440.0,
            current_limit_ma: 800.0,
            following_error: 17.0,
            tolerance: 0.2,
            // These axes have no switch: the instrument is put into its socket at zero.
            switches: Vec::new(),
            homing: HomingConfig {
                method: 37,
                position: 0.0,
                offset: 0.0,
                search_speed: 20.0,
                approach_speed: 5.0,
                current_threshold_ma: 400,
            },
        }
    }

    pub(super) fn feed(node_id: u8, retracted: SwitchConfig) -> Self {
        Self {
            node_id,
            lowest: -1.0,
            highest: 14.0,
            quadcounts_per_motor_turn: 2048,
            gear_numerator: 21,
            gear_denominator: 1,
            belt_numerator: 1,
            belt_denominator: 1,
            lead_mm: Some(2.0),
            reversed: false,
            speed: 10.0,
            acceleration: 50.0,
            quick_stop_deceleration: 200.0,
            current_limit_ma: 800.0,
            following_error: 0.1,
            tolerance: 0.02,
            switches: vec![retracted],
            homing: HomingConfig {
                method: 17,
                position: -1.0,
                offset: 0.0,
                search_speed: 4.0,
                approach_speed: 0.5,
                current_threshold_ma: 400,
            },
        }
    }

    pub(super) fn check(&self, axis: Axis) -> Result<AxisSettings, ConfigError> {
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
        let drivetrain = self.drivetrain(axis)?;
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
        let switches = self.switches(axis)?;
        let homing = self.homing.check(&spec, &switches)?;
        Ok(AxisSettings {
            spec,
            switches,
            homing,
        })
    }

    fn drivetrain(&self, axis: Axis) -> Result<Drivetrain, ConfigError> {
        let key = |name: &str| format!("axes.{axis}.{name}");
        let parts = [
            ("quadcounts_per_motor_turn", self.quadcounts_per_motor_turn),
            ("gear_numerator", self.gear_numerator),
            ("gear_denominator", self.gear_denominator),
            ("belt_numerator", self.belt_numerator),
            ("belt_denominator", self.belt_denominator),
        ];
        if let Some((name, _)) = parts.iter().find(|(_, value)| *value == 0) {
            return Err(bad(key(name), "0 is not at least 1".to_owned()));
        }
        let travel_per_turn = match (axis.unit(), self.lead_mm) {
            (Unit::Millimetre, Some(lead_mm)) => {
                within(key("lead_mm"), lead_mm, f64::MIN_POSITIVE, 1e3)?
            }
            (Unit::Degree, None) => 360.0,
            (Unit::Millimetre, None) => {
                return Err(bad(
                    key("lead_mm"),
                    "is missing; a feed has a screw".to_owned(),
                ));
            }
            (Unit::Degree, Some(lead_mm)) => {
                let problem =
                    format!("is {lead_mm}; a rotation has no screw, its belt is belt_numerator");
                return Err(bad(key("lead_mm"), problem));
            }
        };
        Ok(Drivetrain {
            quadcounts_per_motor_turn: self.quadcounts_per_motor_turn,
            gear: Ratio {
                numerator: self.gear_numerator,
                denominator: self.gear_denominator,
            },
            belt: Ratio {
                numerator: self.belt_numerator,
                denominator: self.belt_denominator,
            },
            travel_per_turn,
            reversed: self.reversed,
        })
    }

    fn switches(&self, axis: Axis) -> Result<Vec<SwitchSpec>, ConfigError> {
        let mut switches: Vec<SwitchSpec> = Vec::new();
        for (place, config) in self.switches.iter().enumerate() {
            let key = |name: &str| format!("axes.{axis}.switches[{place}].{name}");
            let switch = config.spec();
            if !(1..=INPUT_COUNT).contains(&switch.input) {
                let problem = format!("{} is not within 1 to {INPUT_COUNT}", switch.input);
                return Err(bad(key("input"), problem));
            }
            for other in &switches {
                if other.input == switch.input {
                    return Err(bad(
                        key("input"),
                        format!("{} has the {} already", switch.input, other.function),
                    ));
                }
                // The drive takes a function from one input only.
                if other.function == switch.function {
                    return Err(bad(
                        key("function"),
                        format!("the {other} is the one of its kind"),
                    ));
                }
            }
            switches.push(switch);
        }
        Ok(switches)
    }
}

impl SwitchConfig {
    fn spec(&self) -> SwitchSpec {
        SwitchSpec {
            input: self.input,
            function: match self.function {
                FunctionConfig::NegativeLimit => Function::NegativeLimit,
                FunctionConfig::PositiveLimit => Function::PositiveLimit,
                FunctionConfig::Home => Function::Home,
            },
            active: match self.active {
                LevelConfig::Low => Level::Low,
                LevelConfig::High => Level::High,
            },
            normally_closed: self.normally_closed,
        }
    }
}

impl HomingConfig {
    fn check(&self, spec: &AxisSpec, switches: &[SwitchSpec]) -> Result<HomingSpec, ConfigError> {
        let key = |name: &str| format!("axes.{}.homing.{name}", spec.axis);
        let positive = |name: &str, value: f64| within(key(name), value, f64::MIN_POSITIVE, 1e6);
        let Travel { lowest, highest } = spec.travel;
        let method = Method::from_code(self.method).ok_or_else(|| {
            bad(
                key("method"),
                format!("{} is no homing method of the drive", self.method),
            )
        })?;
        if let Some(function) = method.needed_function()
            && !switches.iter().any(|switch| switch.function == function)
        {
            let problem = format!(
                "{} needs a {function}, which axes.{}.switches does not name",
                self.method, spec.axis
            );
            return Err(bad(key("method"), problem));
        }
        let span = spec.travel.span();
        let offset = within(key("offset"), self.offset, -span, span)?;
        if !method.searches() && offset != 0.0 {
            let problem = format!("{offset} is not 0; method {} moves nothing", self.method);
            return Err(bad(key("offset"), problem));
        }
        Ok(HomingSpec {
            method,
            position: within(key("position"), self.position, lowest, highest)?,
            offset,
            search_speed: positive("search_speed", self.search_speed)?,
            approach_speed: positive("approach_speed", self.approach_speed)?,
            current_threshold_ma: self.current_threshold_ma,
        })
    }
}
