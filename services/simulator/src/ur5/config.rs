//! Properties of a simulated arm.

use serde::{Deserialize, Serialize};

use super::{
    kinematics::{Dh, Joints},
    pendant::Control,
    series::{Series, Version},
};

/// What the arm is like and how it starts.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// CB3 with a UR5, or e-Series with a UR5e.
    pub series: Series,
    /// Controller software, of the major number of its series; unset: the usual one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<Version>,
    /// First position: base, shoulder, elbow, wrist 1, 2, 3.
    pub joints_rad: Joints,
    /// Starts with brakes released, not powered off.
    pub powered: bool,
    /// Time constants with which the joints follow what is commanded.
    pub joint_lag_s: Joints,
    /// Following error that dry friction leaves, which the drives do not compensate.
    pub joint_friction_rad: Joints,
    /// Torque that the joints have; it bounds the acceleration where it is short.
    pub joint_torque_nm: Joints,
    /// Fastest a joint can turn; commanding more is a protective stop.
    pub joint_speed_rad_s: f64,
    /// Hardest a joint can accelerate.
    pub joint_accel_rad_s2: f64,
    /// Farthest each way from zero; commanding more is a protective stop.
    pub joint_range_rad: f64,
    /// Largest distance between commanded and true position before a protective stop.
    pub tracking_limit_rad: f64,
    /// What truly hangs at the flange, kg; unset: what the program declares.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carried_kg: Option<f64>,
    /// What this arm's geometry has more than its drawing.
    pub calibration: Calibration,
    /// Who may command an e-Series over the network.
    pub control: Control,
    /// From power off to idle.
    pub boot_s: f64,
    /// From idle to running.
    pub brake_release_s: f64,
    /// As `get serial number` answers; unset: one of its series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial_number: Option<String>,
}

/// Differences of a real arm to the drawing, as its factory calibration tells them.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Calibration {
    /// Link offsets.
    pub d_m: Joints,
    /// Link lengths.
    pub a_m: Joints,
    /// Link twists.
    pub alpha_rad: Joints,
    /// Joint angles.
    pub theta_rad: Joints,
}

/// A number of the configuration out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} is {value}, must be {limit}")]
pub struct OutOfRange {
    /// Which field.
    pub field: &'static str,
    /// What stands there.
    pub value: String,
    /// What may stand there.
    pub limit: &'static str,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            series: Series::Cb3,
            version: None,
            joints_rad: [0.0, -1.7, 1.9, -1.77, -1.57, 0.0],
            powered: false,
            // Not quite equal, as of no real arm: what tells a straight line from joints that lag each in its way.
            joint_lag_s: [0.010, 0.0105, 0.0103, 0.0098, 0.0097, 0.0095],
            joint_friction_rad: [0.0; 6],
            joint_torque_nm: [150.0, 150.0, 150.0, 28.0, 28.0, 28.0],
            joint_speed_rad_s: std::f64::consts::PI,
            joint_accel_rad_s2: 40.0,
            joint_range_rad: 6.33,
            tracking_limit_rad: 0.3,
            carried_kg: None,
            calibration: Calibration::default(),
            control: Control::Remote,
            boot_s: 2.0,
            brake_release_s: 1.0,
            serial_number: None,
        }
    }
}

impl Config {
    /// An arm of this series with its usual software.
    pub fn of(series: Series) -> Self {
        Self {
            series,
            ..Self::default()
        }
    }

    /// Controller software.
    pub fn software(&self) -> Version {
        self.version.unwrap_or(self.series.default_version())
    }

    /// Serial number of the arm.
    pub fn serial(&self) -> &str {
        let usual = match self.series {
            Series::Cb3 => "2018350001",
            Series::E => "20225500001",
        };
        self.serial_number.as_deref().unwrap_or(usual)
    }

    /// Geometry of the arm.
    pub fn dh(&self) -> Dh {
        let (drawn, more) = (self.series.dh(), &self.calibration);
        let sum = |a: &Joints, b: &Joints| std::array::from_fn(|joint| a[joint] + b[joint]);
        Dh {
            d_m: sum(&drawn.d_m, &more.d_m),
            a_m: sum(&drawn.a_m, &more.a_m),
            alpha_rad: sum(&drawn.alpha_rad, &more.alpha_rad),
            theta_rad: sum(&drawn.theta_rad, &more.theta_rad),
        }
    }

    /// Refuses what no arm is like.
    ///
    /// # Errors
    /// Names the first number out of range.
    pub fn checked(&self) -> Result<&Self, OutOfRange> {
        if self.software().0[0] != self.series.major() {
            return Err(OutOfRange {
                field: "version",
                value: self.software().to_string(),
                limit: "3.x for cb3, 5.x for e",
            });
        }
        let calibration = &self.calibration;
        let ranges: [(
            &'static str,
            &[f64],
            std::ops::RangeInclusive<f64>,
            &'static str,
        ); 14] = [
            (
                "joints_rad",
                &self.joints_rad,
                -6.3..=6.3,
                "within -6.3 .. 6.3 rad",
            ),
            (
                "joint_lag_s",
                &self.joint_lag_s,
                0.0..=1.0,
                "within 0 .. 1 s",
            ),
            (
                "joint_friction_rad",
                &self.joint_friction_rad,
                0.0..=0.1,
                "within 0 .. 0.1 rad",
            ),
            (
                "joint_torque_nm",
                &self.joint_torque_nm,
                1.0..=1000.0,
                "within 1 .. 1000 Nm",
            ),
            (
                "joint_speed_rad_s",
                &[self.joint_speed_rad_s],
                0.01..=10.0,
                "within 0.01 .. 10 rad/s",
            ),
            (
                "joint_accel_rad_s2",
                &[self.joint_accel_rad_s2],
                0.1..=1000.0,
                "within 0.1 .. 1000 rad/s2",
            ),
            (
                "joint_range_rad",
                &[self.joint_range_rad],
                0.1..=6.4,
                "within 0.1 .. 6.4 rad",
            ),
            (
                "tracking_limit_rad",
                &[self.tracking_limit_rad],
                0.001..=10.0,
                "within 0.001 .. 10 rad",
            ),
            (
                "carried_kg",
                &[self.carried_kg.unwrap_or(0.0)],
                0.0..=50.0,
                "within 0 .. 50 kg",
            ),
            (
                "boot_s, brake_release_s",
                &[self.boot_s, self.brake_release_s],
                0.0..=600.0,
                "within 0 .. 600 s",
            ),
            (
                "calibration.d_m",
                &calibration.d_m,
                -0.1..=0.1,
                "within -0.1 .. 0.1 m",
            ),
            (
                "calibration.a_m",
                &calibration.a_m,
                -0.1..=0.1,
                "within -0.1 .. 0.1 m",
            ),
            (
                "calibration.alpha_rad",
                &calibration.alpha_rad,
                -0.5..=0.5,
                "within -0.5 .. 0.5 rad",
            ),
            (
                "calibration.theta_rad",
                &calibration.theta_rad,
                -0.5..=0.5,
                "within -0.5 .. 0.5 rad",
            ),
        ];
        for (field, values, range, limit) in ranges {
            if let Some(value) = values.iter().find(|value| !range.contains(value)) {
                return Err(OutOfRange {
                    field,
                    value: value.to_string(),
                    limit,
                });
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_of_either_series_is_in_range_and_nonsense_is_not() {
        for series in [Series::Cb3, Series::E] {
            assert!(Config::of(series).checked().is_ok());
        }
        let config = Config {
            version: Some(Series::E.default_version()),
            ..Config::default()
        };
        assert_eq!(config.checked().unwrap_err().field, "version");
        let config = Config {
            joint_speed_rad_s: f64::NAN,
            ..Config::default()
        };
        assert_eq!(config.checked().unwrap_err().field, "joint_speed_rad_s");
    }

    #[test]
    fn a_calibrated_arm_is_off_its_drawing() {
        let mut config = Config::default();
        config.calibration.d_m[3] = 1e-3;
        let (drawn, real) = (Config::default().dh(), config.dh());
        let joints = config.joints_rad;
        let off =
            real.flange(&joints).translation.vector - drawn.flange(&joints).translation.vector;
        assert!((off.norm() - 1e-3).abs() < 1e-12);
    }
}
