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
mod tests {
    use super::*;
    use crate::cases::case::{Bite, Verdict, View};
    use crate::config::Jaw;
    use arthro_geometry::frame::Frame;
    use arthro_geometry::{Rigid, Similarity};
    use bytes::Bytes;
    use proptest::prelude::*;

    fn plan() -> Plan {
        Plan {
            bites: vec![
                Bite {
                    center: Point3::new(53.0, 48.0, 61.0),
                    approach: Vector3::x(),
                    opening: Vector3::z(),
                    contour_point: Point3::new(53.5, 48.0, 61.0),
                };
                3
            ],
            contour: vec![Point3::new(1.0, 2.0, 3.0)],
            views: vec![
                View {
                    tip: Point3::new(53.0, 48.0, 40.0),
                    approach: Vector3::z(),
                    roll_rad: 0.5,
                };
                3
            ],
            jaw: Jaw::default(),
            encoded: Bytes::new(),
        }
    }

    fn registration() -> Registration {
        Registration {
            camera_from_ct: Similarity::identity(),
            verdict: Verdict::Accept,
            reasons: Vec::new(),
            encoded: Bytes::new(),
        }
    }

    fn cell() -> Cell {
        Cell {
            forceps_base_from_camera: Rigid::identity(),
            forceps_base_from_arthroscope_base: Rigid::identity(),
            forceps_portal: Point3::new(700.0, 0.0, 250.0),
            arthroscope_portal: Point3::new(0.0, 400.0, 250.0),
            forceps_base_from_tool_at_tray: Rigid::new(
                Rotation::identity(),
                Vector3::new(500.0, -200.0, 300.0),
            ),
            arthroscope_rest: Point3::new(0.0, 300.0, 300.0),
            view_distance_mm: 20.0,
            joint_opening_mm: None,
            calibrations: Cell::for_tests().calibrations,
        }
    }

    fn digest_of(plan: &Plan) -> Digest {
        plan_digest(plan, &registration(), &cell(), Digest([7; 32]))
    }

    /// Everything that decides where the jaw closes, and all that was looked at.
    #[derive(Clone)]
    struct Input {
        plan: Plan,
        registration: Registration,
        cell: Cell,
        model: Digest,
    }

    impl Input {
        fn new() -> Self {
            Self {
                plan: Plan {
                    encoded: Bytes::from_static(b"the plan as it came"),
                    ..plan()
                },
                registration: Registration {
                    reasons: vec!["OVERLAP_LOW".to_owned()],
                    encoded: Bytes::from_static(b"the registration as it came"),
                    ..registration()
                },
                cell: cell(),
                model: Digest([7; 32]),
            }
        }

        fn digest(&self) -> Digest {
            plan_digest(&self.plan, &self.registration, &self.cell, self.model)
        }
    }

    fn flip(number: &mut f64, bit: usize) {
        *number = f64::from_bits(number.to_bits() ^ (1 << (bit % 64)));
    }

    fn flip_byte(bytes: &mut Bytes, bit: usize) {
        let mut edited = bytes.to_vec();
        let at = bit / 8 % edited.len();
        edited[at] ^= 1 << (bit % 8);
        *bytes = edited.into();
    }

    fn flip_rotation(rotation: &mut Rotation, item: usize, bit: usize) {
        let mut quaternion = *rotation.quaternion();
        flip(&mut quaternion.coords[item % 4], bit);
        *rotation = Rotation::new_unchecked(quaternion);
    }

    fn flip_rigid<A: Frame, B: Frame>(pose: &mut Rigid<A, B>, item: usize, bit: usize) {
        let isometry = pose.isometry();
        let (mut rotation, mut translation) = (isometry.rotation, isometry.translation.vector);
        match item % 4 {
            axis @ 0..3 => flip(&mut translation[axis], bit),
            // A rotation is made a unit one when a pose is built: the last bit of 1.0 would not stay.
            _ => rotation *= Rotation::from_euler_angles(1e-12 * (bit + 1) as f64, 0.0, 0.0),
        }
        *pose = Rigid::new(rotation, translation);
    }

    /// The inputs beside bites and views, one number, byte or word each.
    const OTHER_INPUTS: usize = 20;

    fn edit(input: &mut Input, which: usize, item: usize, bit: usize) {
        let Input {
            plan,
            registration,
            cell,
            model,
        } = input;
        match which {
            0 => flip(&mut plan.jaw.width_mm, bit),
            1 => flip(&mut plan.jaw.length_mm, bit),
            2 => flip(&mut plan.jaw.throat_mm, bit),
            3 => flip(&mut plan.contour[0].coords[item % 3], bit),
            4 => flip(&mut registration.camera_from_ct.scale, bit),
            5 => flip(
                &mut registration.camera_from_ct.translation_mm[item % 3],
                bit,
            ),
            6 => flip_rotation(&mut registration.camera_from_ct.rotation, item, bit),
            7 => flip_rigid(&mut cell.forceps_base_from_camera, item, bit),
            8 => flip_rigid(&mut cell.forceps_base_from_arthroscope_base, item, bit),
            9 => flip_rigid(&mut cell.forceps_base_from_tool_at_tray, item, bit),
            10 => flip(&mut cell.forceps_portal.coords[item % 3], bit),
            11 => flip(&mut cell.arthroscope_portal.coords[item % 3], bit),
            12 => flip(&mut cell.arthroscope_rest.coords[item % 3], bit),
            13 => flip(&mut cell.view_distance_mm, bit),
            14 => cell.joint_opening_mm = Some(f64::from_bits(bit as u64)),
            15 => model.0[item % 32] ^= 1 << (bit % 8),
            16 => registration.verdict = [Verdict::Review, Verdict::Reject][item % 2],
            17 => registration.reasons[0].push('X'),
            18 => flip_byte(&mut registration.encoded, bit),
            _ => flip_byte(&mut plan.encoded, bit),
        }
    }

    /// Two neighbours may not be read as one: what ends here and begins there is told apart.
    #[test]
    fn what_moves_from_one_list_to_the_next_is_another_digest() {
        let mut split = Input::new();
        split.registration.reasons = vec!["A".to_owned(), "B".to_owned()];
        let mut joined = split.clone();
        joined.registration.reasons = vec!["AB".to_owned()];
        assert_ne!(split.digest(), joined.digest());
        let mut fewer = Input::new();
        fewer.plan.contour.push(fewer.plan.bites[0].center);
        assert_ne!(fewer.digest(), Input::new().digest());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn one_changed_bit_of_any_bite_is_another_digest(
            bite in 0..3usize, item in 0..4usize, axis in 0..3usize, bit in 0..64u32
        ) {
            let mut edited = plan();
            let bite = &mut edited.bites[bite];
            let number = match item {
                0 => &mut bite.center.coords[axis],
                1 => &mut bite.approach[axis],
                2 => &mut bite.opening[axis],
                _ => &mut bite.contour_point.coords[axis],
            };
            *number = f64::from_bits(number.to_bits() ^ (1 << bit));
            prop_assert_ne!(digest_of(&edited), digest_of(&plan()));
        }

        #[test]
        fn one_changed_bit_of_any_view_is_another_digest(
            view in 0..3usize, item in 0..3usize, axis in 0..3usize, bit in 0..64u32
        ) {
            let mut edited = plan();
            let view = &mut edited.views[view];
            let number = match item {
                0 => &mut view.tip.coords[axis],
                1 => &mut view.approach[axis],
                _ => &mut view.roll_rad,
            };
            *number = f64::from_bits(number.to_bits() ^ (1 << bit));
            prop_assert_ne!(digest_of(&edited), digest_of(&plan()));
        }

        #[test]
        fn one_changed_bit_of_any_other_input_is_another_digest(
            which in 0..OTHER_INPUTS, item in 0..64usize, bit in 0..512usize
        ) {
            let mut edited = Input::new();
            edit(&mut edited, which, item, bit);
            prop_assert_ne!(edited.digest(), Input::new().digest());
        }

        #[test]
        fn a_digest_is_read_back_from_its_text(bytes: [u8; 32]) {
            let digest = Digest(bytes);
            prop_assert_eq!(Digest::parse(&digest.to_string()), Some(digest));
        }
    }

    #[test]
    fn registration_calibration_and_model_are_part_of_the_digest() {
        let before = digest_of(&plan());
        let mut moved = registration();
        moved.camera_from_ct.translation_mm.x += 1e-12;
        let mut calibrated = cell();
        calibrated.forceps_portal.z += 1e-9;
        let mut another_calibration = cell();
        another_calibration.calibrations.tool_tip.digest = Digest([9; 32]);
        let model = Digest([7; 32]);
        for after in [
            plan_digest(&plan(), &moved, &cell(), model),
            plan_digest(&plan(), &registration(), &calibrated, model),
            plan_digest(&plan(), &registration(), &another_calibration, model),
            plan_digest(&plan(), &registration(), &cell(), Digest([8; 32])),
        ] {
            assert_ne!(after, before);
        }
    }

    #[test]
    fn the_same_bites_in_another_order_are_another_plan() {
        let mut first = plan();
        first.bites[0].center.x = 1.0;
        let mut second = first.clone();
        second.bites.swap(0, 1);
        assert_ne!(digest_of(&first), digest_of(&second));
    }

    #[test]
    fn a_text_that_is_no_digest_is_refused() {
        assert_eq!(Digest::parse("abc"), None);
        assert_eq!(Digest::parse(&"g".repeat(64)), None);
        assert_eq!(Digest::parse(&"é".repeat(32)), None);
    }
}
