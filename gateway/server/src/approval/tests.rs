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
