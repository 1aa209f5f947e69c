//! The section `[motion]` of the configuration: two arms, where they are, what they carry, what they may.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};
use std::time::Duration;

use arthro_geometry::nalgebra::{Quaternion, Unit, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Vector3};
use serde::{Deserialize, Serialize};
use ur_link::{Endpoint, Expected, Options, Series, Servo};

use crate::arm::ArmOptions;
use crate::bodies::{ArmShape, ToolShape};
use crate::cell::Berth;
use crate::kinematics::dh::Dh;
use crate::kinematics::joint_limits::JointLimits;
use crate::kinematics::model::{Make, Model};
use crate::kinematics::{Joints, ToolArm};
use crate::layout::Layout;
use crate::limits::Limits;
use crate::rcm::Portal;

/// The program on the controller refuses samples this much faster than the fastest planned joint.
const SAMPLE_SPEED_SHARE: f64 = 1.5;
/// How far the norm of a unit quaternion may be from 1.
pub const QUATERNION_TOLERANCE: f64 = 1e-3;

/// All that can be set.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// The two arms.
    pub arms: Arms,
    /// How they stand to each other.
    pub layout: Layout,
}

/// The arms of the cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Arms {
    /// Carries the forceps.
    pub forceps: ArmConfig,
    /// Carries the arthroscope.
    pub arthroscope: ArmConfig,
}

/// One arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArmConfig {
    /// Name or address of the controller.
    pub host: String,
    /// Its dashboard server.
    pub dashboard_port: u16,
    /// Its RTDE server.
    pub rtde_port: u16,
    /// Its interface that accepts URScript.
    pub script_port: u16,
    /// Wall time between two attempts to connect, s.
    pub reconnect_s: f64,
    /// Wall time without a state after which a moving arm is told to stop and a fault latched, s. Longer for a simulated
    /// cell on a busy machine.
    pub silence_s: f64,
    /// Which arm it is.
    pub model: Make,
    /// The Denavit-Hartenberg table of this one arm, as its KINEMATICS_INFO has it; else the drawing's.
    pub calibration: Option<Dh>,
    /// The same as differences from the drawing, as the controller's calibration.conf has it.
    pub calibration_deltas: Option<Dh>,
    /// Least and largest angle of each joint, rad.
    pub joint_limits_rad: [[f64; 2]; 6],
    /// How the tool is mounted.
    pub flange_from_tool: ToolMount,
    /// How thick the tool is: what keeps its distance to the other arm and the planes.
    pub tool_shape: ToolShape,
    /// Mass at the flange, kg.
    pub payload_kg: f64,
    /// The portal in the arm's base, mm, if it is known from the start; else SetPortal states it.
    pub portal_mm: Option<[f64; 3]>,
    /// Into the joint, in the arm's base: the axis of the cone about `portal_mm`. Need not be a unit vector.
    pub portal_axis: Option<[f64; 3]>,
    /// Where the arm waits between bites, rad: gives the branch and the roll of the dry run.
    pub neutral_joints_rad: Joints,
    /// What it may do.
    pub limits: Limits,
}

/// A pose: that of the tool at the flange, flange_from_tool, or of one base in another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ToolMount {
    /// The tip at the flange, or the other base's origin, mm.
    pub translation_mm: [f64; 3],
    /// Unit quaternion w, x, y, z: the tool's x is along the shaft and out of the tip.
    pub rotation_wxyz: [f64; 4],
}

impl Default for Arms {
    fn default() -> Self {
        Self {
            forceps: ArmConfig::default(),
            arthroscope: ArmConfig {
                host: "127.0.0.12".to_owned(),
                neutral_joints_rad: [0.796, -1.456, -1.861, -3.148, -1.303, -1.522],
                tool_shape: ToolShape::ARTHROSCOPE,
                ..ArmConfig::default()
            },
        }
    }
}

impl Default for ArmConfig {
    fn default() -> Self {
        let endpoint = Endpoint::new("127.0.0.11");
        Self {
            host: endpoint.host,
            dashboard_port: endpoint.dashboard_port,
            rtde_port: endpoint.rtde_port,
            script_port: endpoint.script_port,
            reconnect_s: 1.0,
            silence_s: 0.1,
            model: Make::Ur5,
            calibration: None,
            calibration_deltas: None,
            joint_limits_rad: travel(&JointLimits::default()),
            flange_from_tool: ToolMount::default(),
            tool_shape: ToolShape::default(),
            payload_kg: 1.0,
            portal_mm: None,
            portal_axis: None,
            neutral_joints_rad: [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
            limits: Limits::default(),
        }
    }
}

fn travel(limits: &JointLimits) -> [[f64; 2]; 6] {
    std::array::from_fn(|i| [limits.min_rad[i], limits.max_rad[i]])
}

/// 310 mm of shaft along the flange's z.
impl Default for ToolMount {
    fn default() -> Self {
        Self {
            translation_mm: [0.0, 0.0, 310.0],
            rotation_wxyz: [FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, 0.0],
        }
    }
}

/// What is wrong with a configuration.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("motion.arms.{arm}.{field} {fault}")]
pub struct ConfigError {
    arm: &'static str,
    field: String,
    fault: String,
}

/// An arm whose configuration was checked.
#[derive(Clone, Debug)]
pub struct ArmSetup {
    /// For its owner.
    pub options: ArmOptions,
    /// For its link.
    pub link: Options,
    /// For the dry run.
    pub neutral_joints_rad: Joints,
    /// What it looks like.
    pub shape: ArmShape,
}

impl ArmConfig {
    /// Checks every number. The arm knows of no other until [`Layout::seat`] gives it its place.
    pub fn check(&self, name: &'static str) -> Result<ArmSetup, ConfigError> {
        let wrong = |field: &str, fault: String| ConfigError {
            arm: name,
            field: field.to_owned(),
            fault,
        };
        if self.host.is_empty() {
            return Err(wrong("host", "is empty".to_owned()));
        }
        for (field, value) in self.limits.named() {
            if !(value.is_finite() && value > 0.0) {
                let fault = format!("is {value}; must be greater than 0");
                return Err(wrong(&format!("limits.{field}"), fault));
            }
        }
        for (index, plane) in self.limits.planes.iter().enumerate() {
            if let Some(fault) = plane.fault() {
                return Err(wrong(&format!("limits.planes[{index}]"), fault));
            }
        }
        for (field, value) in self.tool_shape.named() {
            if !(0.1..=500.0).contains(&value) {
                let fault = format!("is {value}; must be within 0.1 .. 500");
                return Err(wrong(&format!("tool_shape.{field}"), fault));
            }
        }
        for (field, value) in [
            ("reconnect_s", self.reconnect_s),
            ("silence_s", self.silence_s),
            ("payload_kg", self.payload_kg),
        ] {
            if !(0.0..=60.0).contains(&value) {
                return Err(wrong(field, format!("is {value}; must be within 0 .. 60")));
            }
        }
        let translation = Vector3::from(self.flange_from_tool.translation_mm);
        let [w, x, y, z] = self.flange_from_tool.rotation_wxyz;
        let quaternion = Quaternion::new(w, x, y, z);
        // A NaN is in no range.
        if !(..=QUATERNION_TOLERANCE).contains(&(quaternion.norm() - 1.0).abs()) {
            let fault = format!(
                "has norm {}; must be 1 within {QUATERNION_TOLERANCE}",
                quaternion.norm()
            );
            return Err(wrong("flange_from_tool.rotation_wxyz", fault));
        }
        if !(..=2000.0).contains(&translation.norm()) {
            let fault = format!("is {} mm away; limit 2000 mm", translation.norm());
            return Err(wrong("flange_from_tool.translation_mm", fault));
        }
        let model = self.check_model(&wrong)?;
        let finite = self
            .neutral_joints_rad
            .iter()
            .all(|joint| joint.is_finite());
        if !finite || model.limit_margin_rad(&self.neutral_joints_rad) < 0.0 {
            return Err(wrong(
                "neutral_joints_rad",
                "is beyond the joint limits".to_owned(),
            ));
        }
        let portal = self
            .portal()
            .map_err(|(field, fault)| wrong(field, fault))?;
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        let flange_from_tool = Rigid::new(rotation, translation);
        let arm = ToolArm::new(model, flange_from_tool);
        let shape = ArmShape::new(&arm, self.tool_shape);
        Ok(ArmSetup {
            shape,
            options: ArmOptions {
                name,
                address: format!("{}:{}", self.host, self.rtde_port),
                arm,
                limits: self.limits.clone(),
                period_s: 1.0 / self.series().frequency_hz(),
                silence: Duration::from_secs_f64(self.silence_s),
                berth: Berth::apart(shape),
                portal,
                reconnect: Duration::from_secs_f64(self.reconnect_s),
            },
            link: self.link(&translation, &rotation.scaled_axis()),
            neutral_joints_rad: self.neutral_joints_rad,
        })
    }

    fn portal(&self) -> Result<Option<Portal>, (&'static str, String)> {
        let axis = match self.portal_axis.map(Vector3::from) {
            None => None,
            Some(axis) => Some(Unit::try_new(axis, 1e-9).filter(finite).ok_or_else(|| {
                let fault = "must be finite and longer than nothing".to_owned();
                ("portal_axis", fault)
            })?),
        };
        let Some(point) = self.portal_mm else {
            return Ok(None);
        };
        if !point.iter().all(|value| value.is_finite()) {
            return Err(("portal_mm", "is not finite".to_owned()));
        }
        let portal = Portal::new(Point3::from(point), axis);
        portal
            .map(Some)
            .map_err(|error| ("portal_mm", format!("is refused: {error}")))
    }

    /// The arm by its drawing, or by its calibration if that is one of this arm.
    fn check_model(
        &self,
        wrong: &impl Fn(&str, String) -> ConfigError,
    ) -> Result<Model, ConfigError> {
        for (joint, [min, max]) in self.joint_limits_rad.iter().enumerate() {
            let sound = (-TAU..TAU).contains(min) && (*min..=TAU).contains(max) && min < max;
            if !sound {
                let fault = format!("is {min} .. {max}; must rise within {} .. {TAU}", -TAU);
                return Err(wrong(&format!("joint_limits_rad[{}]", joint + 1), fault));
            }
        }
        let model = Model::from(self.model).with_limits(JointLimits {
            min_rad: self.joint_limits_rad.map(|[min, _]| min),
            max_rad: self.joint_limits_rad.map(|[_, max]| max),
        });
        let (field, dh) = match (&self.calibration, &self.calibration_deltas) {
            (None, None) => return Ok(model),
            (Some(dh), None) => ("calibration", *dh),
            (None, Some(deltas)) => ("calibration_deltas", model.dh().plus(deltas)),
            (Some(_), Some(_)) => {
                let fault = "is given beside calibration; must be one of them".to_owned();
                return Err(wrong("calibration_deltas", fault));
            }
        };
        model
            .calibrated(&dh)
            .map_err(|error| wrong(field, error.to_string()))
    }

    /// The generation of controller that drives this arm.
    fn series(&self) -> Series {
        match self.model {
            Make::Ur5 => Series::Cb3,
            Make::Ur5e => Series::ESeries,
        }
    }

    fn link(&self, tip_mm: &Vector3, rotation: &Vector3) -> Options {
        let tip_m = tip_mm * 1e-3;
        let endpoint = Endpoint {
            host: self.host.clone(),
            dashboard_port: self.dashboard_port,
            rtde_port: self.rtde_port,
            script_port: self.script_port,
        };
        let options = Options::new(endpoint);
        Options {
            tcp_offset: [
                tip_m.x, tip_m.y, tip_m.z, rotation.x, rotation.y, rotation.z,
            ],
            payload_kg: self.payload_kg,
            expected: Some(Expected {
                series: self.series(),
                model: "UR5".to_owned(),
            }),
            servo: Servo {
                max_speed_rad_s: SAMPLE_SPEED_SHARE * self.limits.joint_speed_rad_s,
                ..options.servo
            },
            ..options
        }
    }
}

fn finite(direction: &Unit<Vector3>) -> bool {
    direction.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_sound() {
        let arms = Arms::default();
        let forceps = arms.forceps.check("forceps").unwrap();
        assert_eq!(forceps.options.address, "127.0.0.11:30004");
        let arthroscope = arms.arthroscope.check("arthroscope").unwrap();
        assert_eq!(arthroscope.options.address, "127.0.0.12:30004");
        // Tool x, along the shaft, is flange z.
        let flange_from_tool = forceps.options.arm.flange_from_tool();
        assert!((flange_from_tool.direction(&Vector3::x()) - Vector3::z()).norm() < 1e-12);
    }

    #[test]
    fn a_wrong_number_is_refused_with_its_name() {
        let refusal = |change: fn(&mut ArmConfig)| {
            let mut config = ArmConfig::default();
            change(&mut config);
            config.check("forceps").unwrap_err().to_string()
        };
        assert_eq!(
            refusal(|config| config.limits.rcm_stop_mm = 0.0),
            "motion.arms.forceps.limits.rcm_stop_mm is 0; must be greater than 0"
        );
        assert!(
            refusal(|config| config.flange_from_tool.rotation_wxyz = [0.5, 0.0, 0.0, 0.0])
                .contains("rotation_wxyz has norm 0.5")
        );
        assert!(
            refusal(|config| config.neutral_joints_rad[2] = 4.0).contains("neutral_joints_rad")
        );
        assert!(refusal(|config| config.payload_kg = f64::NAN).contains("payload_kg"));
        assert!(
            refusal(|config| config.tool_shape.shaft_radius_mm = 0.0)
                .contains("tool_shape.shaft_radius_mm is 0; must be within 0.1 .. 500")
        );
        assert!(
            refusal(|config| config.portal_mm = Some([90.0, 90.0, 300.0]))
                .contains("portal_mm is refused: the portal is 127.3 mm from the axis")
        );
        assert!(refusal(|config| config.portal_axis = Some([0.0; 3])).contains("portal_axis"));
        assert!(
            refusal(|config| config.joint_limits_rad[3] = [1.0, f64::NAN])
                .contains("joint_limits_rad[4] is 1 .. NaN")
        );
    }

    #[test]
    fn a_calibration_is_taken_in_or_refused() {
        let mut config = ArmConfig {
            model: Make::Ur5e,
            ..ArmConfig::default()
        };
        let drawn = Dh::nominal(&Make::Ur5e.links());
        let mut deltas = drawn.plus(&drawn);
        for column in [
            &mut deltas.theta_rad,
            &mut deltas.a_mm,
            &mut deltas.d_mm,
            &mut deltas.alpha_rad,
        ] {
            *column = [1e-3; 6];
        }
        config.calibration_deltas = Some(deltas);
        let setup = config.check("forceps").unwrap();
        assert_eq!(setup.options.arm.model().dh(), drawn.plus(&deltas));
        config.calibration = Some(drawn);
        let refusal = config.check("forceps").unwrap_err().to_string();
        assert!(
            refusal.contains("calibration_deltas is given beside"),
            "{refusal}"
        );
        config.calibration_deltas = None;
        // Metres where millimetres are due, and the table of the other make.
        let metres = Dh {
            a_mm: drawn.a_mm.map(|a| a * 1e-3),
            d_mm: drawn.d_mm.map(|d| d * 1e-3),
            ..drawn
        };
        for wrong in [metres, Dh::nominal(&Make::Ur5.links())] {
            config.calibration = Some(wrong);
            let refusal = config.check("forceps").unwrap_err().to_string();
            assert!(refusal.contains("calibration puts the flange"), "{refusal}");
        }
    }
}
