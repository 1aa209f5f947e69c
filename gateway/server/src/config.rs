//! The gateway's section of the configuration, and the checked calibration it becomes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use arthro_geometry::frame::{ArthroscopeBase, Camera, ForcepsBase, Frame, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use nalgebra::{Matrix3, Matrix6, Quaternion, SMatrix};
use serde::{Deserialize, Serialize};

use crate::approval;
use crate::approval::Policy;
use crate::audit;
use crate::audit::key::{KeyError, PublicKey, SigningKey};
use crate::calendar::end_of_day_ms;
use crate::calibrations::record::{InForce, Kind, Standing};
use crate::clients::motion::Arm;
use crate::clients::replicas::addresses::{Addresses, Where};
use crate::journal::Place;
use crate::recording::Settings;
use crate::verification::Limits;

/// A quaternion's norm may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-3;
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

/// Section `gateway.audit`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AuditConfig {
    /// File of the key that signs, PEM, which only its owner may read; made when absent, its public key beside it with
    /// `.pub`. Unset: the journal's file with `.audit-key`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<PathBuf>,
    /// File of the heads, best on a disk that whoever can write the journal cannot; made when absent. Unset: the journal's
    /// file with `.audit-heads`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heads: Option<PathBuf>,
    /// Public keys of the other gateways on the same journal, PEM.
    pub trusted: Vec<PathBuf>,
    /// How often the heads are put on the disk at the latest, s; with a decision, an approval or an end it is done at once.
    pub heads_sync_s: f64,
}

/// Section `gateway.verification`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Verification {
    /// Largest target registration error over the touched landmarks, root mean square, mm.
    pub limit_mm: f64,
    /// Whether approval asks for a passed verification.
    pub required: bool,
    /// Fewest landmarks.
    pub touches_min: usize,
}

/// Section `gateway.calibrations`: how long a saved calibration holds when whoever saves it says nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Validity {
    /// Of the camera on its stand, days.
    pub hand_eye_days: f64,
    /// Of the tip of an instrument that is taken off for cleaning, days.
    pub tool_tip_days: f64,
}

/// Section `gateway.error_budget`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ErrorBudget {
    /// How far the tip is from where the arm says it is, root mean square, mm: its kinematics' accuracy, not its
    /// repeatability.
    pub arm_accuracy_mm: f64,
    /// Bites that are expected to be farther off are flagged, mm.
    pub bite_limit_mm: f64,
}

/// Section `gateway.calibration`, as written by the site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Hand-eye: the camera in the forceps arm's base.
    pub forceps_base_from_camera: Pose,
    /// The arthroscope arm's base in the forceps arm's base.
    pub forceps_base_from_arthroscope_base: Pose,
    /// The forceps' portal, in the forceps arm's base, mm.
    pub forceps_portal_mm: [f64; 3],
    /// The arthroscope's portal, in the arthroscope arm's base, mm.
    pub arthroscope_portal_mm: [f64; 3],
    /// The forceps over the tray, in the forceps arm's base.
    pub forceps_base_from_tool_at_tray: Pose,
    /// Where the arthroscope's tip rests outside the body, in the arthroscope arm's base, mm.
    pub arthroscope_rest_mm: [f64; 3],
    /// Last day on which this section may be used, `YYYY-MM-DD`, UTC. Without it, it has no end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid_until: Option<String>,
    /// Covariance of `forceps_base_from_camera`, 36 numbers row by row: rotation vector (rad), then displacement (mm),
    /// axes of the base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hand_eye_covariance: Option<Vec<f64>>,
    /// Covariance of the forceps' tip in the flange, nine numbers row by row, mm2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool_tip_covariance_mm2: Option<Vec<f64>>,
}

/// A rigid transform as written in a file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// mm.
    pub translation_mm: [f64; 3],
}

/// Where things are in the cell: the checked calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Hand-eye.
    pub forceps_base_from_camera: Rigid<ForcepsBase, Camera>,
    /// Between the two arms.
    pub forceps_base_from_arthroscope_base: Rigid<ForcepsBase, ArthroscopeBase>,
    /// In the forceps arm's base.
    pub forceps_portal: Point3,
    /// In the arthroscope arm's base.
    pub arthroscope_portal: Point3,
    /// The forceps over the tray.
    pub forceps_base_from_tool_at_tray: Rigid<ForcepsBase, Tool>,
    /// The arthroscope's tip at rest, in the arthroscope arm's base.
    pub arthroscope_rest: Point3,
    /// How far from the middle of the bites the arthroscope's tip stays in a plan without views, mm.
    pub view_distance_mm: f64,
    /// How far the joint is opened, mm, if that is known.
    pub joint_opening_mm: Option<f64>,
    /// Which calibrations that rests on, how sure they are and how long they hold.
    pub calibrations: InForce,
}

impl Cell {
    /// An arm's portal, in its own base.
    pub fn portal(&self, arm: Arm) -> &Point3 {
        match arm {
            Arm::Forceps => &self.forceps_portal,
            Arm::Arthroscope => &self.arthroscope_portal,
        }
    }
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

impl Default for AuditConfig {
    fn default() -> Self {
        Self {
            key: None,
            heads: None,
            trusted: Vec::new(),
            heads_sync_s: 1.0,
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
        Ok(Some(Cell {
            forceps_base_from_camera: rigid(
                "calibration.forceps_base_from_camera",
                &calibration.forceps_base_from_camera,
            )?,
            forceps_base_from_arthroscope_base: rigid(
                "calibration.forceps_base_from_arthroscope_base",
                &calibration.forceps_base_from_arthroscope_base,
            )?,
            forceps_portal: point(
                "calibration.forceps_portal_mm",
                calibration.forceps_portal_mm,
            )?,
            arthroscope_portal: point(
                "calibration.arthroscope_portal_mm",
                calibration.arthroscope_portal_mm,
            )?,
            forceps_base_from_tool_at_tray: rigid(
                "calibration.forceps_base_from_tool_at_tray",
                &calibration.forceps_base_from_tool_at_tray,
            )?,
            arthroscope_rest: point(
                "calibration.arthroscope_rest_mm",
                calibration.arthroscope_rest_mm,
            )?,
            view_distance_mm: self.view_distance_mm,
            joint_opening_mm: self.joint_opening_mm,
            calibrations: calibration.in_force()?,
        }))
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

impl Calibration {
    /// What the configuration says of its calibrations' accuracy and end.
    fn in_force(&self) -> Result<InForce, ConfigError> {
        let valid_until_ms = match &self.valid_until {
            None => None,
            Some(day) => Some(end_of_day_ms(day).ok_or_else(|| ConfigError {
                field: "calibration.valid_until",
                problem: format!("is {day:?}; must be a day as YYYY-MM-DD"),
            })?),
        };
        let hand_eye: Option<Matrix6<f64>> = covariance(
            "calibration.hand_eye_covariance",
            self.hand_eye_covariance.as_deref(),
        )?;
        let tool_tip: Option<Matrix3<f64>> = covariance(
            "calibration.tool_tip_covariance_mm2",
            self.tool_tip_covariance_mm2.as_deref(),
        )?;
        let pose = &self.forceps_base_from_camera;
        let numbers: Vec<f64> = pose
            .rotation
            .into_iter()
            .chain(pose.translation_mm)
            .collect();
        Ok(InForce {
            hand_eye: configured(Kind::HandEye, &numbers, hand_eye, valid_until_ms),
            tool_tip: configured(Kind::ToolTip, &[], tool_tip, valid_until_ms),
            flange_from_tool: drawn_flange_from_tool(),
        })
    }
}

/// A tool whose x lies along the flange's z, as tools are drawn.
pub(crate) fn drawn_flange_from_tool() -> Rotation {
    Rotation::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2)
}

fn configured<const N: usize>(
    kind: Kind,
    numbers: &[f64],
    covariance: Option<SMatrix<f64, N, N>>,
    valid_until_ms: Option<i64>,
) -> Standing<SMatrix<f64, N, N>> {
    let entries = covariance.as_ref().map_or(&[][..], |c| c.as_slice());
    Standing {
        id: kind.configured_id().to_owned(),
        digest: approval::configured_digest(kind, numbers, entries, valid_until_ms),
        covariance,
        valid_until_ms,
        revoked_at_ms: None,
    }
}

fn covariance<const N: usize>(
    field: &'static str,
    rows: Option<&[f64]>,
) -> Result<Option<SMatrix<f64, N, N>>, ConfigError> {
    let Some(rows) = rows else {
        return Ok(None);
    };
    let checked = checked_covariance(rows);
    checked
        .map(Some)
        .map_err(|problem| ConfigError { field, problem })
}

/// A covariance row by row; the error says what is wrong with it.
pub(crate) fn checked_covariance<const N: usize>(
    rows: &[f64],
) -> Result<SMatrix<f64, N, N>, String> {
    if rows.len() != N * N {
        return Err(format!("holds {} numbers; must hold {}", rows.len(), N * N));
    }
    let matrix = SMatrix::<f64, N, N>::from_row_slice(rows);
    if let Some(number) = rows.iter().find(|number| !number.is_finite()) {
        return Err(format!("holds {number}; must hold finite numbers"));
    }
    for row in 0..N {
        let variance = matrix[(row, row)];
        if variance < 0.0 {
            return Err(format!(
                "has the variance {variance} in row {row}; must be 0 or more"
            ));
        }
        for column in 0..row {
            let (one, other) = (matrix[(row, column)], matrix[(column, row)]);
            let largest = (variance * matrix[(column, column)]).sqrt();
            // What rounds on the way here, against what no two quantities can share.
            if (one - other).abs() > 1e-6 * largest {
                return Err(format!(
                    "is not symmetric: {one} and {other} in row and column {row} and {column}"
                ));
            }
            if one.abs() > largest * (1.0 + 1e-6) {
                return Err(format!(
                    "has the covariance {one} in row {row}, column {column}; must be at most {largest}"
                ));
            }
        }
    }
    Ok(matrix)
}

impl Default for Verification {
    fn default() -> Self {
        Self {
            limit_mm: 1.5,
            required: false,
            touches_min: 3,
        }
    }
}

impl From<Verification> for Limits {
    fn from(section: Verification) -> Self {
        Self {
            limit_mm: section.limit_mm,
            touches_min: section.touches_min,
            required: section.required,
        }
    }
}

impl Default for Validity {
    fn default() -> Self {
        Self {
            hand_eye_days: 90.0,
            tool_tip_days: 7.0,
        }
    }
}

impl Default for ErrorBudget {
    fn default() -> Self {
        Self {
            arm_accuracy_mm: 0.5,
            bite_limit_mm: 1.5,
        }
    }
}

impl AuditConfig {
    /// Reads the keys, makes what is absent. The files lie beside the journal's file, or in the working folder where that is
    /// no file, unless they are configured.
    pub fn open(&self, journal: &Place) -> Result<audit::Options, KeyError> {
        let journal = match journal {
            Place::File(path) => path.as_path(),
            Place::Postgres(_) => Path::new("arthro-gateway"),
        };
        let beside = |configured: &Option<PathBuf>, ending: &str| {
            configured.clone().unwrap_or_else(|| {
                let mut path = journal.as_os_str().to_owned();
                path.push(ending);
                path.into()
            })
        };
        Ok(audit::Options {
            key: SigningKey::open_or_make(&beside(&self.key, ".audit-key"))?,
            trusted: self
                .trusted
                .iter()
                .map(|path| PublicKey::read(path))
                .collect::<Result<_, _>>()?,
            heads: beside(&self.heads, ".audit-heads"),
            heads_sync: Duration::from_secs_f64(self.heads_sync_s),
        })
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

fn point(field: &'static str, [x, y, z]: [f64; 3]) -> Result<Point3, ConfigError> {
    if [x, y, z].iter().all(|value| value.is_finite()) {
        return Ok(Point3::new(x, y, z));
    }
    Err(ConfigError {
        field,
        problem: format!("is {x}, {y}, {z}; must be finite"),
    })
}

fn rigid<A: Frame, B: Frame>(field: &'static str, pose: &Pose) -> Result<Rigid<A, B>, ConfigError> {
    let [w, x, y, z] = pose.rotation;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    // Written so that NaN is refused too.
    if (norm - 1.0).abs() <= UNIT_TOLERANCE {
        let translation = point(field, pose.translation_mm)?.coords;
        return Ok(Rigid::new(
            Rotation::from_quaternion(quaternion),
            translation,
        ));
    }
    Err(ConfigError {
        field,
        problem: format!("has a rotation of norm {norm}; must be 1 within {UNIT_TOLERANCE}"),
    })
}

impl Pose {
    /// The pose of a transform, as it is written in a file.
    pub fn of<A: Frame, B: Frame>(rigid: &Rigid<A, B>) -> Self {
        let rotation = rigid.rotation();
        Self {
            rotation: [rotation.w, rotation.i, rotation.j, rotation.k],
            translation_mm: Vector3::into(rigid.translation_mm()),
        }
    }
}

#[cfg(test)]
impl Cell {
    /// A cell for tests that do not care where things are.
    pub(crate) fn for_tests() -> Self {
        let calibration = tests::calibration();
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        config.cell().unwrap().unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn calibration() -> Calibration {
        let pose = Pose {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation_mm: [0.0; 3],
        };
        Calibration {
            forceps_base_from_camera: pose,
            forceps_base_from_arthroscope_base: pose,
            forceps_portal_mm: [700.0, 0.0, 250.0],
            arthroscope_portal_mm: [0.0; 3],
            forceps_base_from_tool_at_tray: pose,
            arthroscope_rest_mm: [0.0; 3],
            valid_until: None,
            hand_eye_covariance: None,
            tool_tip_covariance_mm2: None,
        }
    }

    #[test]
    fn a_covariance_that_no_measurement_has_is_refused() {
        let with = |rows: Vec<f64>| Config {
            calibration: Some(Calibration {
                tool_tip_covariance_mm2: Some(rows),
                ..calibration()
            }),
            ..Config::default()
        };
        let rows = |off: f64, other: f64| vec![0.01, off, 0.0, other, 0.04, 0.0, 0.0, 0.0, 0.01];
        assert!(with(rows(0.01, 0.01)).cell().is_ok());
        for (rows, expected) in [
            (vec![1.0; 8], "holds 8 numbers; must hold 9"),
            (rows(f64::NAN, 0.0), "must hold finite numbers"),
            (rows(0.01, 0.0), "is not symmetric"),
            (rows(0.03, 0.03), "must be at most 0.02"),
            (vec![-1.0; 9], "must be 0 or more"),
        ] {
            let problem = problem(&with(rows));
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn an_end_that_is_no_day_is_refused() {
        let config = Config {
            calibration: Some(Calibration {
                valid_until: Some("31.01.2027".to_owned()),
                ..calibration()
            }),
            ..Config::default()
        };
        assert!(problem(&config).contains("valid_until is \"31.01.2027\"; must be a day"));
    }

    #[test]
    fn a_list_that_names_a_replica_twice_is_refused() {
        let twice = vec!["127.0.0.1:1".to_owned(), "127.0.0.1:1".to_owned()];
        let config = Config {
            planning: Addresses::List(twice),
            ..Config::default()
        };
        let refusal = config.replicas().unwrap_err().to_string();
        assert_eq!(refusal, "gateway.planning lists \"127.0.0.1:1\" twice");
    }

    fn problem(config: &Config) -> String {
        config.cell().unwrap_err().to_string()
    }

    #[test]
    fn a_non_unit_hand_eye_rotation_is_refused() {
        let mut calibration = calibration();
        calibration.forceps_base_from_camera.rotation = [1.0, 0.1, 0.0, 0.0];
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        assert!(
            problem(&config).contains("forceps_base_from_camera has a rotation of norm 1.00498")
        );
    }

    #[test]
    fn a_portal_that_is_not_a_number_is_refused() {
        let mut calibration = calibration();
        calibration.forceps_portal_mm[1] = f64::NAN;
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        assert!(problem(&config).contains("forceps_portal_mm is 700, NaN, 250; must be finite"));
    }

    #[test]
    fn a_jaw_in_metres_is_refused() {
        let config = Config {
            jaw: Jaw {
                width_mm: 0.003,
                length_mm: 0.0045,
                ..Jaw::default()
            },
            ..Config::default()
        };
        assert!(problem(&config).contains("jaw.width_mm is 0.003; must be within 0.5 .. 10"));
    }

    #[test]
    fn a_tolerance_that_would_take_any_pose_is_refused() {
        let config = Config {
            pose_tolerance_mm: 1000.0,
            ..Config::default()
        };
        assert_eq!(
            config.rules().unwrap_err().to_string(),
            "gateway.pose_tolerance_mm is 1000; must be within 0.01 .. 10"
        );
    }

    #[test]
    fn without_calibration_there_is_no_cell() {
        assert_eq!(Config::default().cell(), Ok(None));
    }
}
