//! What a surgeon approves: SHA-256 over a canonical byte encoding of everything that decides where
//! the jaw closes.
//!
//! Canonical means: every item in a fixed order, every text and list preceded by its length as a
//! little-endian u64, every number as the eight bytes of its little-endian IEEE 754 double, every
//! moment as a little-endian i64. Two
//! inputs have the same encoding only if they are the same to the last bit.

use std::fmt;

use arthro_geometry::{Point3, Rotation, Vector3};
use sha2::{Digest as _, Sha256};

use crate::calibrations::record::{Calibration, Kind};
use crate::cases::case::{ModelInfo, Plan, Registration, SceneInfo};
use crate::config::Cell;

/// SHA-256, shown as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Digest([u8; 32]);

/// Who approved which digest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Approval {
    /// Who approved.
    pub surgeon: String,
    /// What was approved.
    pub digest: Digest,
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
struct Canonical(Sha256);

impl Canonical {
    /// `domain` keeps digests of different things apart.
    fn new(domain: &str) -> Self {
        let mut canonical = Self(Sha256::new());
        canonical.bytes(domain.as_bytes());
        canonical
    }

    fn count(&mut self, count: usize) {
        self.0.update((count as u64).to_le_bytes());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.count(bytes.len());
        self.0.update(bytes);
    }

    fn number(&mut self, number: f64) {
        self.0.update(number.to_le_bytes());
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

    fn digest(self) -> Digest {
        Digest(self.0.finalize().into())
    }
}

impl Digest {
    /// From the 32 bytes themselves.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
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

    proptest! {
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
