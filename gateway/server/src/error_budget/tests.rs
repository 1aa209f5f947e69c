//! The first order held against drawn errors that are applied as they are, and against sums by hand.

use arthro_geometry::frame::{Camera, Ct, ForcepsBase};
use arthro_geometry::{Rigid, Similarity};
use bytes::Bytes;
use nalgebra::{DMatrix, DVector};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::cases::case::Verdict;
use crate::config::Cell;

const DRAWS: usize = 20_000;

fn registration() -> Registration {
    Registration {
        camera_from_ct: Similarity::new(
            1.02,
            Rotation::from_scaled_axis(Vector3::new(0.4, -0.9, 0.2)),
            Vector3::new(-50.0, -40.0, 340.0),
        ),
        verdict: Verdict::Accept,
        reasons: Vec::new(),
        encoded: Bytes::new(),
    }
}

fn cell() -> Cell {
    Cell {
        forceps_base_from_camera: Rigid::new(
            Rotation::from_scaled_axis(Vector3::new(2.8, 0.3, 0.1)),
            Vector3::new(750.0, 20.0, 550.0),
        ),
        ..Cell::for_tests()
    }
}

fn bite() -> Bite {
    Bite {
        center: Point3::new(53.0, 48.0, 61.0),
        approach: Vector3::new(0.6, 0.8, 0.0),
        opening: Vector3::z(),
        contour_point: Point3::new(53.0, 48.0, 61.0),
    }
}

/// A covariance with different deviations and with correlations.
fn covariance<const N: usize>(deviations: [f64; N], rng: &mut ChaCha8Rng) -> SMatrix<f64, N, N> {
    let mixed = SMatrix::<f64, N, N>::from_fn(|row, column| {
        let diagonal = if row == column { 1.0 } else { 0.0 };
        (diagonal + rng.random_range(-0.3..0.3)) * deviations[row]
    });
    mixed * mixed.transpose()
}

fn sources(rng: &mut ChaCha8Rng) -> Sources {
    let registration = [0.01, 0.02, 0.015, 0.3, 0.2, 0.4, 0.005];
    Sources {
        registration: Some(Uncertainty::Covariance {
            covariance: Box::new(covariance(registration, rng)),
            about: Point3::new(45.0, 50.0, 50.0),
            scale_about: Point3::new(50.0, 45.0, 55.0),
        }),
        hand_eye: Some(covariance([0.001, 0.0015, 0.002, 0.3, 0.2, 0.5], rng)),
        arm_mm: 0.4,
        tool_tip: Some(covariance([0.1, 0.3, 0.2], rng)),
        flange_from_tool: Rotation::from_scaled_axis(Vector3::new(0.2, -1.5, 0.3)),
    }
}

/// Normal numbers of mean 0 and deviation 1, two at a time (Box and Muller).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * rng.random_range(f64::MIN_POSITIVE..1.0).ln()).sqrt();
    radius * rng.random_range(0.0..std::f64::consts::TAU).cos()
}

fn drawn<const N: usize>(covariance: &SMatrix<f64, N, N>, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let entries = covariance.as_slice();
    let factor = DMatrix::from_column_slice(N, N, entries)
        .cholesky()
        .unwrap();
    let drawn = DVector::from_fn(N, |_, _| normal(rng));
    (factor.l() * drawn).as_slice().to_vec()
}

fn vector(values: &[f64]) -> Vector3 {
    Vector3::from_column_slice(values)
}

/// Where the bite lies and where the tip goes when every link is off by what is drawn, without any approximation.
fn off_mm(sources: &Sources, rng: &mut ChaCha8Rng) -> f64 {
    let (registration, cell, bite) = (registration(), cell(), bite());
    let planned = base_from_ct(&registration, &cell) * bite.center;

    let Some(Uncertainty::Covariance {
        covariance,
        about,
        scale_about,
    }) = &sources.registration
    else {
        panic!("the covariance is known")
    };
    let error = drawn(covariance, rng);
    let grown = scale_about + (bite.center - scale_about) * error[6].exp();
    let turn = Rotation::from_scaled_axis(vector(&error[..3]));
    let in_ct = about + turn * (grown - about) + vector(&error[3..6]);
    let in_camera = registration.camera_from_ct * in_ct;

    let error = drawn(&sources.hand_eye.unwrap(), rng);
    let mounted = cell.forceps_base_from_camera;
    let base_from_camera: Rigid<ForcepsBase, Camera> = Rigid::new(
        Rotation::from_scaled_axis(vector(&error[..3])) * mounted.rotation(),
        mounted.translation_mm() + vector(&error[3..]),
    );
    let target = base_from_camera * in_camera;

    let arm = Vector3::from_fn(|_, _| normal(rng)) * sources.arm_mm / 3.0f64.sqrt();
    let shaft = base_from_ct(&registration, &cell).direction(&bite.approach);
    let base_from_flange = upright(shaft) * sources.flange_from_tool.inverse();
    let tip = base_from_flange * vector(&drawn(&sources.tool_tip.unwrap(), rng));
    (target - planned - arm - tip).norm()
}

#[test]
fn the_first_order_agrees_with_drawn_errors_within_five_percent() {
    for seed in 0..4 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let sources = sources(&mut rng);
        let predicted = sources.bite(&bite(), &registration(), &cell());
        let squares: f64 = (0..DRAWS).map(|_| off_mm(&sources, &mut rng).powi(2)).sum();
        let ratio = (squares / DRAWS as f64).sqrt() / predicted.rms_mm;
        assert!(
            (ratio - 1.0).abs() < 0.05,
            "seed {seed}: drawn over predicted {ratio}"
        );
    }
}

#[test]
fn each_part_is_what_a_sum_by_hand_says() {
    let twice: Similarity<Camera, Ct> =
        Similarity::new(2.0, Rotation::identity(), Vector3::zeros());
    let registration = Registration {
        camera_from_ct: twice,
        ..registration()
    };
    let cell = Cell {
        forceps_base_from_camera: Rigid::identity(),
        ..Cell::for_tests()
    };
    let bite = Bite {
        center: Point3::new(0.0, 0.0, 150.0),
        ..bite()
    };
    let mut turn_about_x = Matrix6::zeros();
    turn_about_x[(0, 0)] = 0.001f64.powi(2);
    turn_about_x[(5, 5)] = 0.4f64.powi(2);
    let sources = Sources {
        registration: Some(Uncertainty::Rms(0.2)),
        hand_eye: Some(turn_about_x),
        arm_mm: 0.1,
        tool_tip: Some(Matrix3::identity() * 0.01),
        flange_from_tool: Rotation::identity(),
    };
    let error = sources.bite(&bite, &registration, &cell);
    // 0.2 mm of the model twice as large; 1 mrad over 300 mm beside 0.4 mm; three axes of 0.1 mm.
    let by_hand = [0.4, 0.5, 0.1, 0.03f64.sqrt()];
    for (part_mm, expected_mm) in error.parts_mm.into_iter().zip(by_hand) {
        assert!(
            (part_mm - expected_mm).abs() < 1e-12,
            "{part_mm} {expected_mm}"
        );
    }
    assert_eq!(error.dominant(), Part::HandEye);
    assert!((error.rms_mm - (0.16f64 + 0.25 + 0.01 + 0.03).sqrt()).abs() < 1e-12);
}

#[test]
fn a_link_of_which_nothing_is_known_is_named_and_adds_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let known = sources(&mut rng);
    let unknown = Sources {
        hand_eye: None,
        ..known.clone()
    };
    assert_eq!(known.unknown(), []);
    assert_eq!(unknown.unknown(), [Part::HandEye]);
    let [all, fewer] =
        [known, unknown].map(|sources| sources.bite(&bite(), &registration(), &cell()));
    assert!(fewer.rms_mm < all.rms_mm);
    assert_eq!(fewer.part_mm(Part::HandEye), 0.0);
}
