//! The section `[motion]` of the configuration: two arms, where they are, what they carry, what they may.

use std::f64::consts::FRAC_1_SQRT_2;
use std::time::Duration;

use arthro_geometry::nalgebra::{Quaternion, UnitQuaternion};
use arthro_geometry::{Point3, Rigid, Vector3};
use serde::{Deserialize, Serialize};
use ur_link::{Endpoint, Options};

use crate::arm::ArmOptions;
use crate::bodies::{ArmShape, Links, ToolShape};
use crate::cell::Berth;
use crate::kinematics::{Joints, ToolArm, ur5};
use crate::layout::Layout;
use crate::limits::Limits;

/// States a second of a CB3 controller.
const FREQUENCY_HZ: f64 = 125.0;
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
    /// How the tool is mounted.
    pub flange_from_tool: ToolMount,
    /// How thick the tool is: what keeps its distance to the other arm and the planes.
    pub tool_shape: ToolShape,
    /// Mass at the flange, kg.
    pub payload_kg: f64,
    /// The portal in the arm's base, mm, if it is known from the start; else SetPortal states it.
    pub portal_mm: Option<[f64; 3]>,
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
            flange_from_tool: ToolMount::default(),
            tool_shape: ToolShape::default(),
            payload_kg: 1.0,
            portal_mm: None,
            neutral_joints_rad: [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
            limits: Limits::default(),
        }
    }
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
        let finite = self
            .neutral_joints_rad
            .iter()
            .all(|joint| joint.is_finite());
        if !finite || ur5::limit_margin_rad(&self.neutral_joints_rad) < 0.0 {
            return Err(wrong(
                "neutral_joints_rad",
                "is beyond the joint limits".to_owned(),
            ));
        }
        if !self
            .portal_mm
            .iter()
            .flatten()
            .all(|value| value.is_finite())
        {
            return Err(wrong("portal_mm", "is not finite".to_owned()));
        }
        let rotation = UnitQuaternion::from_quaternion(quaternion);
        let flange_from_tool = Rigid::new(rotation, translation);
        let shape = ArmShape::new(&ToolArm::new(flange_from_tool), Links::UR5, self.tool_shape);
        Ok(ArmSetup {
            shape,
            options: ArmOptions {
                name,
                address: format!("{}:{}", self.host, self.rtde_port),
                arm: ToolArm::new(flange_from_tool),
                limits: self.limits.clone(),
                berth: Berth::apart(shape),
                portal: self.portal_mm.map(Point3::from),
                period_s: 1.0 / FREQUENCY_HZ,
                reconnect: Duration::from_secs_f64(self.reconnect_s),
            },
            link: self.link(&translation, &rotation.scaled_axis()),
            neutral_joints_rad: self.neutral_joints_rad,
        })
    }

    fn link(&self, tip_mm: &Vector3, rotation: &Vector3) -> Options {
        let tip_m = tip_mm * 1e-3;
        Options {
            tcp_offset: [
                tip_m.x, tip_m.y, tip_m.z, rotation.x, rotation.y, rotation.z,
            ],
            payload_kg: self.payload_kg,
            frequency_hz: FREQUENCY_HZ,
            ..Options::new(Endpoint {
                host: self.host.clone(),
                dashboard_port: self.dashboard_port,
                rtde_port: self.rtde_port,
                script_port: self.script_port,
            })
        }
    }
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
    }
}
