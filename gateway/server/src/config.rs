//! The gateway's section of the configuration, and the checked calibration it becomes.

mod accuracy;
mod audit;
mod calibration;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::approval::Policy;
use crate::clients::replicas::addresses::{Addresses, Where};
use crate::journal::Place;
use crate::recording::Settings;

pub(crate) use self::accuracy::checked_covariance;
pub use self::accuracy::{ErrorBudget, Validity, Verification};
pub use self::audit::AuditConfig;
pub use self::calibration::{Calibration, Cell, Pose};

/// Characters of a gateway's name.
const NAME_LONGEST: usize = 100;

/// Section `gateway`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Where cases, procedures and steps are kept: the path of an SQLite file, created when absent, or the address of a
    /// PostgreSQL database (`postgres://user@host/database`), which several gateways may share.
    pub journal: Place,
    /// How this gateway is named to others that share its journal, e.g. its address; empty: host and process.
    pub name: String,
    /// Address of the registration service, host:port; a list of its replicas; or `dns:///name:port`, whose every address
    /// is one. With `server.tls` the gateway shows its own certificate there and at the others, and they must be certified
    /// as the host that stands here.
    pub registration: Addresses,
    /// The planning service, likewise.
    pub planning: Addresses,
    /// Address of the motion service, host:port.
    pub motion: String,
    /// Address of the instrument service, host:port.
    pub instrument: String,
    /// The folder where every procedure is recorded (MCAP). Without it nothing is recorded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recordings: Option<PathBuf>,
    /// A recording that reaches this size goes on in another file, MiB.
    pub recording_file_max_mib: u64,
    /// Nothing is recorded while the folder holds as much, MiB. Nothing is ever deleted.
    pub recordings_max_mib: u64,
    /// How far from the middle of the bites the arthroscope's tip stays in a plan without views, mm.
    pub view_distance_mm: f64,
    /// How far the joint is opened, mm: the gap between the top of the meniscus and the condyle. Plans then keep the
    /// forceps' shaft clear of condyle and plateau. Without it nothing is known of the joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint_opening_mm: Option<f64>,
    /// What a pause does once the step under way is halted.
    pub pause: PauseMode,
    /// An arm this far from where it stood when the procedure was halted refuses to go on, mm of its tip.
    pub pose_tolerance_mm: f64,
    /// The same for the tool's turning, deg.
    pub pose_tolerance_deg: f64,
    /// A motion service that was restarted with a tool inside is told the calibrated portal only if the measured shaft passes
    /// it this near, mm.
    pub portal_tolerance_mm: f64,
    /// The jaw of the forceps in use.
    pub jaw: Jaw,
    /// How the audit is kept.
    pub audit: AuditConfig,
    /// Who must approve a plan.
    pub approval: Policy,
    /// What touched landmarks are held to.
    pub verification: Verification,
    /// How long saved calibrations hold.
    pub calibrations: Validity,
    /// What predicted errors of bites are made of and held to.
    pub error_budget: ErrorBudget,
    /// Where things are in the cell. Without it cases are registered, but nothing is planned and nothing moves:
    /// there is no safe default for a hand-eye transform.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// What a pause does with the arms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum PauseMode {
    /// They hold where they are.
    #[default]
    Hold,
    /// They are drawn back along their shafts.
    Retract,
}

/// What halts and goes on with a procedure, and within which limits: the checked keys of the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// What a pause does once the step under way is halted.
    pub pause: PauseMode,
    /// How far an arm may be from where it stood, mm.
    pub pose_tolerance_mm: f64,
    /// How far a tool may have turned since, deg.
    pub pose_tolerance_deg: f64,
    /// How near a measured shaft must pass a portal that is stated with the tool inside, mm.
    pub portal_tolerance_mm: f64,
}

/// The forceps' jaw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Jaw {
    /// Across the shaft, mm.
    pub width_mm: f64,
    /// Along the shaft, mm.
    pub length_mm: f64,
    /// How far behind the jaw its hinge needs room, mm.
    pub throat_mm: f64,
}

/// A value of the configuration that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("gateway.{field} {problem}")]
pub struct ConfigError {
    field: &'static str,
    problem: String,
}

// === impl Config ===

impl Default for Config {
    fn default() -> Self {
        Self {
            journal: PathBuf::from("arthro-gateway.sqlite").into(),
            name: String::new(),
            registration: "127.0.0.1:50051".to_owned().into(),
            planning: "127.0.0.1:50052".to_owned().into(),
            motion: "127.0.0.1:50053".to_owned(),
            instrument: "127.0.0.1:50054".to_owned(),
            recordings: None,
            recording_file_max_mib: 256,
            recordings_max_mib: 20 * 1024,
            view_distance_mm: 20.0,
            joint_opening_mm: None,
            pause: PauseMode::default(),
            pose_tolerance_mm: 1.0,
            pose_tolerance_deg: 1.0,
            portal_tolerance_mm: 5.0,
            jaw: Jaw::default(),
            audit: AuditConfig::default(),
            approval: Policy::default(),
            verification: Verification::default(),
            calibrations: Validity::default(),
            error_budget: ErrorBudget::default(),
            calibration: None,
        }
    }
}

impl Config {
    /// Checks where registration and planning are.
    pub fn replicas(&self) -> Result<(Where, Where), ConfigError> {
        let checked = |field, addresses: &Addresses| {
            addresses
                .checked()
                .map_err(|problem| ConfigError { field, problem })
        };
        Ok((
            checked("registration", &self.registration)?,
            checked("planning", &self.planning)?,
        ))
    }

    /// Checks where recordings go; `None` when nothing is recorded.
    pub fn recordings(&self) -> Result<Option<Settings>, ConfigError> {
        let mib = |field, value: u64, most: u64| match (1..=most).contains(&value) {
            true => Ok(value * 1024 * 1024),
            false => Err(ConfigError {
                field,
                problem: format!("is {value}; must be within 1 .. {most}"),
            }),
        };
        let segment_max_bytes = mib(
            "recording_file_max_mib",
            self.recording_file_max_mib,
            65_536,
        )?;
        let folder_max_bytes = mib("recordings_max_mib", self.recordings_max_mib, 1 << 30)?;
        Ok(self.recordings.clone().map(|folder| Settings {
            folder,
            segment_max_bytes,
            folder_max_bytes,
        }))
    }

    /// Checks what governs halts.
    pub fn rules(&self) -> Result<Rules, ConfigError> {
        within("pose_tolerance_mm", self.pose_tolerance_mm, 0.01, 10.0)?;
        within("pose_tolerance_deg", self.pose_tolerance_deg, 0.01, 10.0)?;
        within("portal_tolerance_mm", self.portal_tolerance_mm, 0.1, 20.0)?;
        Ok(Rules {
            pause: self.pause,
            pose_tolerance_mm: self.pose_tolerance_mm,
            pose_tolerance_deg: self.pose_tolerance_deg,
            portal_tolerance_mm: self.portal_tolerance_mm,
        })
    }

    /// How this gateway is named to others.
    pub fn holder(&self) -> Result<String, ConfigError> {
        let length = self.name.chars().count();
        if length > NAME_LONGEST || self.name.chars().any(char::is_control) {
            return Err(ConfigError {
                field: "name",
                problem: format!(
                    "has {length} characters; must have at most {NAME_LONGEST}, none of them a control character"
                ),
            });
        }
        if !self.name.is_empty() {
            return Ok(self.name.clone());
        }
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let host = match host.trim() {
            "" => "gateway",
            host => host,
        };
        Ok(format!("{host}, process {}", std::process::id()))
    }

    /// Checks jaw and calibration; `None` when the cell is not calibrated.
    pub fn cell(&self) -> Result<Option<Cell>, ConfigError> {
        within("jaw.width_mm", self.jaw.width_mm, 0.5, 10.0)?;
        within("jaw.length_mm", self.jaw.length_mm, 0.5, 20.0)?;
        within("jaw.throat_mm", self.jaw.throat_mm, 0.1, 10.0)?;
        within("view_distance_mm", self.view_distance_mm, 1.0, 200.0)?;
        within("audit.heads_sync_s", self.audit.heads_sync_s, 0.01, 60.0)?;
        self.approval.check()?;
        self.limits_of_accuracy()?;
        if let Some(opening_mm) = self.joint_opening_mm {
            within("joint_opening_mm", opening_mm, -20.0, 50.0)?;
        }
        let Some(calibration) = &self.calibration else {
            return Ok(None);
        };
        calibration
            .cell(self.view_distance_mm, self.joint_opening_mm)
            .map(Some)
    }

    fn limits_of_accuracy(&self) -> Result<(), ConfigError> {
        let Verification {
            limit_mm,
            touches_min,
            ..
        } = self.verification;
        within("verification.limit_mm", limit_mm, 0.1, 10.0)?;
        within("verification.touches_min", touches_min as f64, 3.0, 32.0)?;
        let Validity {
            hand_eye_days,
            tool_tip_days,
        } = self.calibrations;
        within("calibrations.hand_eye_days", hand_eye_days, 0.01, 3650.0)?;
        within("calibrations.tool_tip_days", tool_tip_days, 0.01, 3650.0)?;
        let ErrorBudget {
            arm_accuracy_mm,
            bite_limit_mm,
        } = self.error_budget;
        within("error_budget.arm_accuracy_mm", arm_accuracy_mm, 0.0, 10.0)?;
        within("error_budget.bite_limit_mm", bite_limit_mm, 0.1, 10.0)
    }
}

impl Policy {
    fn check(&self) -> Result<(), ConfigError> {
        if (1..=2).contains(&self.persons) {
            return Ok(());
        }
        Err(ConfigError {
            field: "approval.persons",
            problem: format!("is {}; must be 1 or 2", self.persons),
        })
    }
}

impl Default for Jaw {
    fn default() -> Self {
        Self {
            width_mm: 3.0,
            length_mm: 4.5,
            throat_mm: 1.0,
        }
    }
}

fn within(field: &'static str, value: f64, lowest: f64, highest: f64) -> Result<(), ConfigError> {
    if (lowest..=highest).contains(&value) {
        return Ok(());
    }
    Err(ConfigError {
        field,
        problem: format!("is {value}; must be within {lowest} .. {highest}"),
    })
}

#[cfg(test)]
mod tests;
