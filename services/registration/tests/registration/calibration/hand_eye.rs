//! Hand-eye and robot-world: exact without noise, and refused by name where the poses do not allow an answer.

use arthro_geometry::frame::{Base, Board, Camera, Flange, Frame};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::calibration::closed_form::{MotionPair, daniilidis, shah};
use arthro_registration::calibration::gate::Reason;
use arthro_registration::calibration::hand_eye::{Options, Station, eye_in_hand, eye_on_base};
use arthro_registration::calibration::input;
use arthro_registration::error::Error;
use proptest::prelude::{ProptestConfig, any, prop_assert, proptest};
use serde_json::Value;

use super::world::{Dice, EyeOnBase, board_in_view, noise};
use super::{fields, reasons};

/// Turn (rad) and shift (mm) between two poses, whichever is more.
fn apart<A: Frame, B: Frame>(one: &Rigid<A, B>, other: &Rigid<A, B>) -> f64 {
    let turn = one.rotation().angle_to(&other.rotation());
    turn.max((one.translation_mm() - other.translation_mm()).norm())
}

fn exact_stations(cell: &EyeOnBase, dice: &mut Dice, count: usize) -> Vec<Station> {
    (0..count)
        .map(|_| cell.exact(board_in_view(dice, 40.0)))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn without_noise_a_camera_beside_the_arm_is_found_exactly(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let cell = EyeOnBase::drawn(dice);
        let found = eye_on_base(&exact_stations(&cell, dice, 12), &Options::default()).unwrap();
        let closed = found.closed_forms;
        for (who, pose) in [
            ("refined", Some(found.mount_from_camera)),
            ("park", closed.park),
            ("daniilidis", closed.daniilidis),
            ("shah", closed.shah),
        ] {
            let off = apart(&pose.unwrap(), &cell.base_from_camera);
            prop_assert!(off < 1e-9, "{who} {off}");
        }
        let off = apart(&found.carrier_from_board, &cell.flange_from_board);
        prop_assert!(off < 1e-9, "board {off}");
        prop_assert!(found.residuals.iter().all(|residual| !residual.is_rejected));
    }

    #[test]
    fn without_noise_a_camera_on_the_flange_is_found_exactly(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let flange_from_camera: Rigid<Flange, Camera> = dice.pose(150.0);
        let base_from_board: Rigid<Base, Board> = dice.pose(900.0);
        let stations: Vec<Station> = (0..12)
            .map(|_| {
                let camera_from_board = board_in_view(dice, 40.0);
                Station {
                    base_from_flange: base_from_board * camera_from_board.inverse() * flange_from_camera.inverse(),
                    camera_from_board,
                    camera_covariance: None,
                }
            })
            .collect();
        let found = eye_in_hand(&stations, &Options::default()).unwrap();
        let closed = found.closed_forms;
        for (who, pose) in [
            ("refined", Some(found.mount_from_camera)),
            ("park", closed.park),
            ("daniilidis", closed.daniilidis),
            ("shah", closed.shah),
        ] {
            let off = apart(&pose.unwrap(), &flange_from_camera);
            prop_assert!(off < 1e-9, "{who} {off}");
        }
        prop_assert!(apart(&found.carrier_from_board, &base_from_board) < 1e-9);
    }

    #[test]
    fn moving_the_base_moves_the_answer_with_it(seed in any::<u64>()) {
        let dice = &mut Dice::new(seed);
        let cell = EyeOnBase::drawn(dice);
        let stations = noisy_stations(&cell, dice, 14);
        let moved: Rigid<Base, Base> = dice.pose(500.0);
        let there: Vec<Station> = stations
            .iter()
            .map(|station| Station { base_from_flange: moved * station.base_from_flange, ..*station })
            .collect();
        let here = eye_on_base(&stations, &stated()).unwrap();
        let there = eye_on_base(&there, &stated()).unwrap();
        let off = apart(&there.mount_from_camera, &(moved * here.mount_from_camera));
        prop_assert!(off < 1e-5, "{off}");
    }
}

/// OpenCV's answers to the same noisy views.
#[test]
fn the_closed_forms_agree_with_opencv() {
    let file: Value = serde_json::from_str(include_str!("opencv.json")).unwrap();
    let stations: Vec<Station> = file["poses"]
        .as_array()
        .unwrap()
        .iter()
        .map(|pose| Station {
            base_from_flange: from_json(&pose["base_from_flange"]),
            camera_from_board: from_json(&pose["camera_from_board"]),
            camera_covariance: None,
        })
        .collect();
    let found = eye_on_base(&stations, &Options::default()).unwrap();
    assert!(found.residuals.iter().all(|residual| !residual.is_rejected));
    let closed = found.closed_forms;
    // OpenCV writes the robot-world equation the other way round, which gives other least squares.
    let other_way: Vec<_> = stations
        .iter()
        .map(|station| {
            (
                *station.camera_from_board.isometry(),
                *station.base_from_flange.isometry(),
            )
        })
        .collect();
    let [_, camera_from_base] = shah::solve(&other_way).unwrap();
    let pairs: Vec<MotionPair> = (0..12)
        .flat_map(|one| (one + 1..12).map(move |other| (one, other)))
        .map(|(one, other)| {
            let (board_one, arm_one) = &other_way[one];
            let (board_other, arm_other) = &other_way[other];
            MotionPair {
                a: arm_other * arm_one.inverse(),
                b: board_other * board_one.inverse(),
            }
        })
        .collect();
    // It is given metres.
    let in_metres = daniilidis::solve(&pairs, 1000.0).unwrap();
    for (who, ours) in [
        ("park", closed.park.unwrap()),
        ("shah", Rigid::from_isometry(camera_from_base.inverse())),
        ("daniilidis", Rigid::from_isometry(in_metres)),
    ] {
        let theirs: Rigid<Base, Camera> = from_json(&file["opencv"][who]);
        let off = apart(&ours, &theirs);
        assert!(off < 1e-6, "{who} {off}");
    }
}

fn from_json<A: Frame, B: Frame>(pose: &Value) -> Rigid<A, B> {
    let number = |field: &str, index: usize| pose[field][index].as_f64().unwrap();
    input::pose(
        "pose",
        [0, 1, 2, 3].map(|index| number("rotation_wxyz", index)),
        [0, 1, 2].map(|index| number("translation_mm", index)),
    )
    .unwrap()
}

fn noisy_stations(cell: &EyeOnBase, dice: &mut Dice, count: usize) -> Vec<Station> {
    (0..count)
        .map(|_| {
            let seen = board_in_view(dice, 40.0);
            cell.seen(dice, &seen, noise(0.5, 0.05), 0.3)
        })
        .collect()
}

fn stated() -> Options {
    Options {
        arm_noise: Some(noise(0.5, 0.05)),
        ..Options::default()
    }
}

#[test]
fn wrong_poses_are_found_and_named_and_do_not_move_the_answer() {
    for (options, with_covariance) in [(stated(), true), (Options::default(), false)] {
        let dice = &mut Dice::new(11);
        let cell = EyeOnBase::drawn(dice);
        let mut stations = noisy_stations(&cell, dice, 20);
        // The board was taken for turned by half a turn; the arm had not arrived; the arm's pose is an older one.
        let half_turn = Rigid::new(
            Rotation::from_scaled_axis(Vector3::z() * std::f64::consts::PI),
            Vector3::new(120.0, 75.0, 0.0),
        );
        stations[4].camera_from_board = stations[4].camera_from_board * half_turn;
        let late = Rigid::new(Rotation::identity(), Vector3::new(0.0, 12.0, 0.0));
        stations[9].base_from_flange = late * stations[9].base_from_flange;
        stations[17].base_from_flange = stations[16].base_from_flange;
        if !with_covariance {
            stations
                .iter_mut()
                .for_each(|station| station.camera_covariance = None);
        }
        let found = eye_on_base(&stations, &options).unwrap();
        let rejected: Vec<usize> = (0..20)
            .filter(|index| found.residuals[*index].is_rejected)
            .collect();
        assert_eq!(rejected, [4, 9, 17]);
        let point = options.work_point;
        let off = (found.mount_from_camera * point - cell.base_from_camera * point).norm();
        assert!(off < 2.0, "{off} mm");
    }
}

#[test]
fn good_poses_are_not_rejected() {
    let rejected: usize = (0..30)
        .map(|seed| {
            let dice = &mut Dice::new(seed);
            let cell = EyeOnBase::drawn(dice);
            let found = eye_on_base(&noisy_stations(&cell, dice, 15), &stated()).unwrap();
            found
                .residuals
                .iter()
                .filter(|residual| residual.is_rejected)
                .count()
        })
        .sum();
    // One in a thousand of 450 poses.
    assert!(rejected <= 3, "{rejected}");
}

#[test]
fn too_few_poses_are_refused() {
    let dice = &mut Dice::new(1);
    let cell = EyeOnBase::drawn(dice);
    let stations = exact_stations(&cell, dice, 9);
    assert_eq!(
        reasons(eye_on_base(&stations, &Options::default())),
        [Reason::TooFewPoses]
    );
    // Every gate that was missed is named.
    assert_eq!(
        reasons(eye_on_base(&[], &Options::default())),
        [
            Reason::TooFewPoses,
            Reason::SpanTooSmall,
            Reason::AxesParallel
        ]
    );
}

#[test]
fn a_small_span_is_refused() {
    let dice = &mut Dice::new(2);
    let cell = EyeOnBase::drawn(dice);
    let stations: Vec<Station> = (0..15)
        .map(|_| cell.exact(board_in_view(dice, 9.0)))
        .collect();
    let refused = reasons(eye_on_base(&stations, &Options::default()));
    assert!(refused.contains(&Reason::SpanTooSmall), "{refused:?}");
}

#[test]
fn pure_translations_are_refused() {
    let dice = &mut Dice::new(3);
    let cell = EyeOnBase::drawn(dice);
    let turn = board_in_view(dice, 40.0).rotation();
    let stations: Vec<Station> = (0..15)
        .map(|_| cell.exact(Rigid::new(turn, board_in_view(dice, 0.0).translation_mm())))
        .collect();
    assert_eq!(
        reasons(eye_on_base(&stations, &Options::default())),
        [Reason::SpanTooSmall, Reason::AxesParallel]
    );
}

#[test]
fn turns_about_one_axis_are_refused() {
    let dice = &mut Dice::new(4);
    let cell = EyeOnBase::drawn(dice);
    let axis = dice.direction();
    let stations: Vec<Station> = (0..15)
        .map(|index| {
            let turn = Rotation::from_scaled_axis(axis * (0.1 * f64::from(index) - 0.7));
            cell.exact(Rigid::new(turn, board_in_view(dice, 0.0).translation_mm()))
        })
        .collect();
    assert_eq!(
        reasons(eye_on_base(&stations, &Options::default())),
        [Reason::AxesParallel]
    );
}

#[test]
fn poses_that_contradict_each_other_are_refused() {
    let dice = &mut Dice::new(5);
    let cell = EyeOnBase::drawn(dice);
    let mut stations = exact_stations(&cell, dice, 20);
    // Half of them belong to a board that was moved.
    let moved = EyeOnBase {
        flange_from_board: dice.pose(120.0),
        ..cell
    };
    for station in &mut stations[..8] {
        station.base_from_flange = moved.flange(&station.camera_from_board);
    }
    let refused = reasons(eye_on_base(&stations, &Options::default()));
    assert!(refused.contains(&Reason::TooManyOutliers), "{refused:?}");

    let mut stations = exact_stations(&cell_again(), dice, 20);
    for station in &mut stations {
        station.base_from_flange = dice.measured(&station.base_from_flange, noise(8.0, 1.0));
    }
    let refused = reasons(eye_on_base(&stations, &Options::default()));
    assert!(refused.contains(&Reason::ResidualTooLarge), "{refused:?}");
}

fn cell_again() -> EyeOnBase {
    EyeOnBase::drawn(&mut Dice::new(5))
}

#[test]
fn an_answer_that_is_too_uncertain_is_refused_however_well_the_poses_agree() {
    let dice = &mut Dice::new(6);
    let cell = EyeOnBase::drawn(dice);
    let stations = noisy_stations(&cell, dice, 12);
    let far = Options {
        work_point: Point3::new(0.0, 0.0, 5000.0),
        ..stated()
    };
    let refused = eye_on_base(&stations, &far);
    let Err(Error::Refused(refusals)) = refused else {
        panic!("{refused:?}")
    };
    assert_eq!(refusals[0].reason, Reason::UncertaintyTooLarge);
    assert!(refusals[0].value > refusals[0].limit && refusals[0].limit == 2.0);
}

#[test]
fn bad_input_is_refused_with_every_field_named() {
    let dice = &mut Dice::new(7);
    let cell = EyeOnBase::drawn(dice);
    let mut stations = exact_stations(&cell, dice, 12);
    stations[2].base_from_flange =
        Rigid::new(Rotation::identity(), Vector3::new(f64::NAN, 0.0, 0.0));
    stations[5].camera_from_board = Rigid::new(Rotation::identity(), Vector3::new(0.0, 0.0, 1e6));
    let options = Options {
        work_point: Point3::new(0.0, f64::INFINITY, 0.0),
        arm_noise: Some(noise(-1.0, 0.05)),
        residual_limit_mm: 0.0,
        ..Options::default()
    };
    assert_eq!(
        fields(eye_on_base(&stations, &options)),
        [
            "poses[2].base_from_flange",
            "poses[5].camera_from_board",
            "work_point",
            "arm_noise.translation_mm",
            "residual_limit_mm",
            "camera_noise",
        ]
    );
    let many = vec![stations[0]; 501];
    assert_eq!(fields(eye_on_base(&many, &Options::default())), ["poses"]);
}
