//! What a surgeon approves: SHA-256 over a canonical byte encoding of everything that decides where
//! the jaw closes.
//!
//! Canonical means: every item in a fixed order, every text and list preceded by its length as a
//! little-endian u64, every number as the eight bytes of its little-endian IEEE 754 double, every
//! moment as a little-endian i64. Two
//! inputs have the same encoding only if they are the same to the last bit.

use std::fmt;

use arthro_bootstrap::{Caller, Role};
use arthro_geometry::{Point3, Rotation, Vector3};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::calibrations::record::{Calibration, Kind};
use crate::cases::case::{ModelInfo, Plan, Registration, SceneInfo};
use crate::config::Cell;

/// The role of whoever calls without a certificate.
const LOCAL: &str = "local";

/// SHA-256, shown as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Digest([u8; 32]);

/// Who approved which digest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Approval {
    /// The surgeon who approved.
    pub surgeon: Signatory,
    /// Who did so second, where two persons must.
    pub second: Option<Signatory>,
    /// What was approved.
    pub digest: Digest,
}

/// A person who put their name to a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signatory {
    /// The certificate's name; without TLS whoever was stated.
    pub name: String,
    /// The certificate's role; `local` without TLS.
    pub role: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
}

/// Section `gateway.approval`: who must approve a plan before it is performed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// 1: a surgeon. 2: a surgeon, and then another person.
    pub persons: u8,
    /// Who that other person may be.
    pub second: Second,
}

/// The role of the second person.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum Second {
    /// Another surgeon.
    Surgeon,
    /// An operator, or another surgeon.
    Operator,
}

/// Digest of a model: the mesh and the lesion as packed bytes.
pub fn model_digest(
    vertices: &[u8],
    triangles: &[u8],
    lesion: &[u8],
    lesion_spacing_mm: f64,
) -> Digest {
    let mut canonical = Canonical::new("arthro.model.v1");
    canonical.bytes(vertices);
    canonical.bytes(triangles);
    canonical.bytes(lesion);
    canonical.number(lesion_spacing_mm);
    canonical.digest()
}

/// Digest of a scene: the cloud as packed bytes.
pub fn scene_digest(points: &[u8], has_normals: bool) -> Digest {
    let mut canonical = Canonical::new("arthro.scene.v1");
    canonical.count(usize::from(has_normals));
    canonical.bytes(points);
    canonical.digest()
}

/// Digest of plan, registration, calibration and model together: what is approved and executed.
pub fn plan_digest(plan: &Plan, registration: &Registration, cell: &Cell, model: Digest) -> Digest {
    let mut canonical = Canonical::new("arthro.plan.v3");
    canonical.bytes(&model.0);

    let camera_from_ct = &registration.camera_from_ct;
    canonical.number(camera_from_ct.scale);
    canonical.rotation(&camera_from_ct.rotation);
    canonical.vector(&camera_from_ct.translation_mm);
    canonical.bytes(registration.verdict.as_str().as_bytes());
    canonical.count(registration.reasons.len());
    for reason in &registration.reasons {
        canonical.bytes(reason.as_bytes());
    }
    // What was looked at, and not only what is executed.
    canonical.bytes(&registration.encoded);

    for pose in [
        cell.forceps_base_from_camera.isometry(),
        cell.forceps_base_from_arthroscope_base.isometry(),
        cell.forceps_base_from_tool_at_tray.isometry(),
    ] {
        canonical.rotation(&pose.rotation);
        canonical.vector(&pose.translation.vector);
    }
    canonical.point(&cell.forceps_portal);
    canonical.point(&cell.arthroscope_portal);
    canonical.point(&cell.arthroscope_rest);
    canonical.number(cell.view_distance_mm);
    canonical.optional(cell.joint_opening_mm);
    canonical.bytes(&cell.calibrations.hand_eye.digest.0);
    canonical.bytes(&cell.calibrations.tool_tip.digest.0);

    canonical.number(plan.jaw.width_mm);
    canonical.number(plan.jaw.length_mm);
    canonical.number(plan.jaw.throat_mm);
    canonical.count(plan.bites.len());
    for bite in &plan.bites {
        canonical.point(&bite.center);
        canonical.vector(&bite.approach);
        canonical.vector(&bite.opening);
        canonical.point(&bite.contour_point);
    }
    canonical.count(plan.contour.len());
    for point in &plan.contour {
        canonical.point(point);
    }
    canonical.count(plan.views.len());
    for view in &plan.views {
        canonical.point(&view.tip);
        canonical.vector(&view.approach);
        canonical.number(view.roll_rad);
    }
    canonical.bytes(&plan.encoded);
    canonical.digest()
}

/// Digest of what touched landmarks are about: another model, scene, registration or calibration voids them.
pub fn verification_basis(
    model: &ModelInfo,
    scene: &SceneInfo,
    registration: &Registration,
    cell: &Cell,
) -> Digest {
    let mut canonical = Canonical::new("arthro.verification.v1");
    canonical.bytes(&model.digest.0);
    canonical.bytes(&scene.digest.0);
    canonical.bytes(&registration.encoded);
    canonical.bytes(&cell.calibrations.hand_eye.digest.0);
    canonical.bytes(&cell.calibrations.tool_tip.digest.0);
    canonical.digest()
}

/// Digest of a saved calibration.
pub fn calibration_digest(calibration: &Calibration) -> Digest {
    let mut canonical = Canonical::new("arthro.calibration.v1");
    canonical.bytes(calibration.id.as_bytes());
    canonical.bytes(calibration.kind().as_str().as_bytes());
    canonical.integer(calibration.saved_at_ms);
    canonical.integer(calibration.valid_until_ms);
    canonical.bytes(&calibration.encoded);
    canonical.digest()
}

/// Digest of a calibration as the configuration states it.
pub fn configured_digest(
    kind: Kind,
    numbers: &[f64],
    covariance: &[f64],
    valid_until_ms: Option<i64>,
) -> Digest {
    let mut canonical = Canonical::new("arthro.configured-calibration.v1");
    canonical.bytes(kind.as_str().as_bytes());
    for list in [numbers, covariance] {
        canonical.count(list.len());
        list.iter().for_each(|number| canonical.number(*number));
    }
    canonical.integer(valid_until_ms.unwrap_or(i64::MAX));
    canonical.digest()
}

/// The canonical encoding, fed straight into the hash.
pub(crate) struct Canonical(Sha256);

impl Canonical {
    /// `domain` keeps digests of different things apart.
    pub(crate) fn new(domain: &str) -> Self {
        let mut canonical = Self(Sha256::new());
        canonical.bytes(domain.as_bytes());
        canonical
    }

    pub(crate) fn counter(&mut self, counter: u64) {
        self.0.update(counter.to_le_bytes());
    }

    fn count(&mut self, count: usize) {
        self.counter(count as u64);
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.count(bytes.len());
        self.0.update(bytes);
    }

    fn number(&mut self, number: f64) {
        self.0.update(number.to_le_bytes());
    }

    fn optional(&mut self, number: Option<f64>) {
        self.count(usize::from(number.is_some()));
        if let Some(number) = number {
            self.number(number);
        }
    }

    fn integer(&mut self, integer: i64) {
        self.0.update(integer.to_le_bytes());
    }

    fn vector(&mut self, vector: &Vector3) {
        for number in vector.iter() {
            self.number(*number);
        }
    }

    fn point(&mut self, point: &Point3) {
        self.vector(&point.coords);
    }

    /// w, x, y, z.
    fn rotation(&mut self, rotation: &Rotation) {
        for number in [rotation.w, rotation.i, rotation.j, rotation.k] {
            self.number(number);
        }
    }

    pub(crate) fn digest(self) -> Digest {
        Digest(self.0.finalize().into())
    }
}

// === impl Approval ===

impl Approval {
    /// Whether as many have approved as must.
    pub fn is_complete(&self, policy: Policy) -> bool {
        policy.persons == 1 || self.second.is_some()
    }
}

// === impl Signatory ===

impl Signatory {
    /// Whoever calls and acts under this name.
    pub fn new(caller: &Caller, name: String, at_ms: i64) -> Self {
        let role = match caller {
            Caller::Local => LOCAL,
            Caller::Certified { role, .. } => role.as_str(),
        };
        Self {
            name,
            role: role.to_owned(),
            at_ms,
        }
    }

    /// Whether this is a surgeon, or nobody can tell because there are no certificates.
    pub fn may_approve(&self) -> bool {
        self.role == LOCAL || self.role == Role::Surgeon.as_str()
    }

    /// Whether this is the same person. A name in other letters or with more blanks is the same name.
    pub fn is(&self, other: &Self) -> bool {
        let plain = |name: &str| {
            let words: Vec<_> = name.split_whitespace().map(str::to_lowercase).collect();
            words.join(" ")
        };
        plain(&self.name) == plain(&other.name)
    }
}

// === impl Policy ===

impl Policy {
    /// Whether this person may be the second one.
    pub fn admits_second(&self, person: &Signatory) -> bool {
        let operator = self.second == Second::Operator && person.role == Role::Operator.as_str();
        operator || person.may_approve()
    }
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            persons: 1,
            second: Second::Surgeon,
        }
    }
}

// === impl Digest ===

impl Digest {
    /// From the 32 bytes themselves.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The 32 bytes.
    pub const fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// From 64 hexadecimal digits.
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.as_bytes();
        if digits.len() != 64 {
            return None;
        }
        let mut bytes = [0; 32];
        for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
            let high = char::from(pair[0]).to_digit(16)?;
            let low = char::from(pair[1]).to_digit(16)?;
            *byte = u8::try_from(high * 16 + low).ok()?;
        }
        Some(Self(bytes))
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({self})")
    }
}

#[cfg(test)]
mod tests;
