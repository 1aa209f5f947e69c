//! Properties of a simulated arm.

use serde::{Deserialize, Serialize};

use super::{
    kinematics::{Dh, Joints},
    series::{Series, Version},
};

/// Whom sockets of programs may reach.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScriptNetwork {
    /// Nobody.
    None,
    /// This machine.
    Loopback,
    /// Any IP address.
    Any,
}

/// What the arm is like and how it starts.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// CB3 with a UR5, or e-Series with a UR5e.
    pub series: Series,
    /// Controller software, of the major number of its series.
    pub version: Version,
    /// First position: base, shoulder, elbow, wrist 1, 2, 3.
    pub joints_rad: Joints,
    /// Starts with brakes released, not powered off.
    pub powered: bool,
    /// Time constants with which the joints follow what is commanded.
    pub joint_lag_s: Joints,
    /// Fastest a joint can turn; commanding more is a protective stop.
    pub joint_speed_rad_s: f64,
    /// Hardest a joint can accelerate.
    pub joint_accel_rad_s2: f64,
    /// Farthest each way from zero; commanding more is a protective stop.
    pub joint_range_rad: f64,
    /// Largest distance between commanded and true position before a protective stop.
    pub tracking_limit_rad: f64,
    /// From power off to idle.
    pub boot_s: f64,
    /// From idle to running.
    pub brake_release_s: f64,
    /// Whom sockets of programs may reach.
    pub script_network: ScriptNetwork,
    /// As `get serial number` answers.
    pub serial_number: String,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            series: Series::Cb3,
            version: Series::Cb3.default_version(),
            joints_rad: [0.0, -1.7, 1.9, -1.77, -1.57, 0.0],
            powered: false,
            // Not quite equal, as of no real arm: what tells a straight line from joints that lag each in its way.
            joint_lag_s: [0.010, 0.0105, 0.0103, 0.0098, 0.0097, 0.0095],
            joint_speed_rad_s: std::f64::consts::PI,
            joint_accel_rad_s2: 40.0,
            joint_range_rad: 6.33,
            tracking_limit_rad: 0.3,
            boot_s: 2.0,
            brake_release_s: 1.0,
            script_network: ScriptNetwork::Loopback,
            serial_number: "2018350001".to_owned(),
        }
    }
}

impl Config {
    /// An arm of this series with its usual software.
    pub fn of(series: Series) -> Self {
        let serial_number = match series {
            Series::Cb3 => "2018350001",
            Series::E => "20225500001",
        };
        Self {
            series,
            version: series.default_version(),
            serial_number: serial_number.to_owned(),
            ..Self::default()
        }
    }

    /// Geometry of the arm.
    pub fn dh(&self) -> Dh {
        self.series.dh()
    }
}
