//! What is in view is not what the model says: it may not be accepted.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity, Vector3, surface_file};
use arthro_registration::budget::Budget;
use arthro_registration::gate::Verdict;
use arthro_registration::pipeline::{Method, Options, Registration, register};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::world::{Case, cases, crescent, data, seen};

fn judged(source: &Cloud, target: &Cloud, options: &Options) -> Registration {
    register(source, target, options, &mut |_| {}, &Budget::default()).unwrap()
}

fn mirrored(cloud: &Cloud) -> Cloud {
    Cloud::new(
        cloud
            .points
            .iter()
            .map(|p| Point3::new(-p.x, p.y, p.z))
            .collect(),
    )
}

/// The upper face of the crescent, seen from 150 mm above and aside.
fn view() -> (Cloud, Options) {
    let viewpoint = Point3::new(40.0, -30.0, 150.0);
    let options = Options {
        viewpoint: Some(viewpoint),
        ..Options::default()
    };
    (seen(&crescent().points, viewpoint, 0.6, || 0.0), options)
}

#[test]
fn a_left_model_for_a_right_meniscus_is_refused_because_of_the_mirror() {
    let (target, options) = view();
    let right = judged(&crescent(), &target, &options);
    assert_eq!(right.verdict, Verdict::Accept, "{:?}", right.reasons);
    let left = judged(&mirrored(&crescent()), &target, &options);
    assert_eq!(left.verdict, Verdict::Reject);
    assert!(
        left.reasons.iter().any(|r| r.starts_with("MIRROR_FITS")),
        "{:?}",
        left.reasons
    );
    for case in cases("easy").iter().chain(&cases("medium")).step_by(3) {
        let left = judged(&mirrored(&case.source), &case.target, &case.options);
        assert_ne!(left.verdict, Verdict::Accept, "{}", case.name);
    }
}

#[test]
fn the_other_meniscus_of_the_knee_is_not_accepted() {
    let cases = cases("medium");
    let Some(first) = cases.first() else { return };
    let other: &Case = cases.iter().find(|case| case.mesh != first.mesh).unwrap();
    for case in cases.iter().filter(|case| case.mesh == first.mesh).take(5) {
        let wrong = judged(&other.source, &case.target, &case.options);
        assert_ne!(
            wrong.verdict,
            Verdict::Accept,
            "{}: {:?}",
            case.name,
            wrong.evidence
        );
    }
}

#[test]
fn a_bone_is_not_accepted() {
    let Some(folder) = data() else { return };
    let bytes = std::fs::read(folder.join("bones/smith2019_R_tibia.ply")).unwrap();
    let bone = surface_file::read_as_it_stands("tibia.ply", &bytes)
        .unwrap()
        .cloud;
    for case in cases("medium").iter().take(3) {
        let wrong = judged(&bone, &case.target, &case.options);
        assert_ne!(
            wrong.verdict,
            Verdict::Accept,
            "{}: {:?}",
            case.name,
            wrong.evidence
        );
    }
}

#[test]
fn two_menisci_in_view_are_not_accepted() {
    let (target, options) = view();
    let aside = Vector3::new(45.0, 0.0, 0.0);
    let mut both = target.clone();
    both.points.extend(
        target
            .points
            .iter()
            .map(|p| Point3::new(-p.x, p.y, p.z) + aside),
    );
    let found = judged(&crescent(), &both, &options);
    assert_ne!(found.verdict, Verdict::Accept, "{:?}", found.evidence);
    assert!(
        found
            .reasons
            .iter()
            .any(|r| r.starts_with("TOO_FEW_INLIERS")),
        "{:?}",
        found.reasons
    );
}

#[test]
fn a_view_of_nine_tenths_strays_is_not_accepted() {
    let (target, options) = view();
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut noisy = Cloud::default();
    for point in target.points.iter().step_by(10) {
        noisy.points.push(*point);
        for _ in 0..9 {
            noisy.points.push(Point3::from(Vector3::from_fn(|_, _| {
                rng.random_range(-25.0..25.0)
            })));
        }
    }
    let found = judged(&crescent(), &noisy, &options);
    assert_ne!(found.verdict, Verdict::Accept, "{:?}", found.evidence);
}

#[test]
fn two_scans_that_share_a_part_are_brought_together_by_both_methods() {
    let Some(folder) = data() else { return };
    let read = |name: &str| {
        let bytes = std::fs::read(folder.join("pairs").join(name)).unwrap();
        surface_file::read_as_it_stands(name, &bytes).unwrap().cloud
    };
    let (one, two) = (read("opengr_hippo1.ply"), read("opengr_hippo2.ply"));
    let found = |method: Method, source: &Cloud, target: &Cloud| -> Similarity<Camera, Ct> {
        judged(
            source,
            target,
            &Options {
                method,
                ..Options::default()
            },
        )
        .camera_from_ct
    };
    let there = found(Method::Robust, &one, &two);
    let back = found(Method::Robust, &two, &one);
    let paper = found(Method::Paper, &one, &two);
    // No truth is known: forth and back must cancel, and the paper's method must say the same.
    for point in one.points.iter().step_by(1000) {
        let size_mm = 1.2;
        assert!((back * (there * *point) - point).norm() < 0.01 * size_mm);
        assert!((paper * *point - there * *point).norm() < 0.05 * size_mm);
    }
}
