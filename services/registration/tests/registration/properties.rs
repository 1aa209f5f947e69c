//! What holds for every surface and pose.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Rotation, Similarity, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::error::Error;
use arthro_registration::gate::Verdict;
use arthro_registration::input::MAX_POINTS;
use arthro_registration::pipeline::{Event, Options, Registration, register};
use arthro_registration::scale::ScaleRange;
use proptest::prelude::{
    ProptestConfig, Strategy, any, prop, prop_assert, prop_assert_eq, proptest,
};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::world::{crescent, seen};

fn solve(target: &Cloud, options: &Options) -> Registration {
    register(
        &crescent(),
        target,
        options,
        &mut |_| {},
        &Budget::default(),
    )
    .unwrap()
}

/// The upper face of the crescent, seen from 150 mm above and aside.
fn view() -> (Cloud, Point3) {
    let viewpoint = Point3::new(40.0, -30.0, 150.0);
    (seen(&crescent().points, viewpoint, 0.6, || 0.0), viewpoint)
}

fn largest_error_mm(a: &Similarity<Camera, Ct>, b: &Similarity<Camera, Ct>) -> f64 {
    let errors = crescent()
        .points
        .into_iter()
        .map(|p| (*a * p - *b * p).norm());
    errors.fold(0.0, f64::max)
}

fn pose() -> impl Strategy<Value = Similarity<Camera, Ct>> {
    (
        0.99..1.01f64,
        prop::array::uniform3(-2.0..2.0f64),
        prop::array::uniform3(-300.0..300.0f64),
    )
        .prop_map(|(scale, turn, shift)| {
            Similarity::new(
                scale,
                Rotation::from_scaled_axis(Vector3::from(turn)),
                Vector3::from(shift),
            )
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 6, ..ProptestConfig::default() })]

    #[test]
    fn a_known_similarity_is_recovered_from_a_view(truth in pose(), seed in any::<u64>()) {
        let (view, viewpoint) = view();
        let target = Cloud::new(view.points.iter().map(|p| truth * *p).collect());
        let options = Options { viewpoint: Some(truth * viewpoint), seed, ..Options::default() };
        let found = solve(&target, &options);
        let error_mm = largest_error_mm(&found.camera_from_ct, &truth);
        prop_assert!(error_mm < 0.5, "{error_mm} mm, {:?}", found.reasons);
        prop_assert_eq!(found.verdict, Verdict::Accept);
        prop_assert!(found.mse_mm2 < found.coarse_mse_mm2);
        prop_assert_eq!(found.residuals_mm.len(), target.points.len());
    }

    #[test]
    fn moving_the_camera_moves_the_answer_with_it(moved in pose()) {
        let moved = Similarity::<Camera, Camera>::new(1.0, moved.rotation, moved.translation_mm);
        let (target, viewpoint) = view();
        let options = Options { viewpoint: Some(viewpoint), ..Options::default() };
        let from_here = solve(&target, &options);
        let there = Cloud::new(target.points.iter().map(|p| moved * *p).collect());
        let options = Options { viewpoint: Some(moved * viewpoint), ..options };
        let from_there = solve(&there, &options);
        let error_mm = largest_error_mm(&from_there.camera_from_ct, &(moved * from_here.camera_from_ct));
        prop_assert!(error_mm < 0.5, "{error_mm} mm");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 4, ..ProptestConfig::default() })]

    #[test]
    fn a_model_in_another_frame_and_size_gives_the_same_place(moved in pose(), size in 0.4..2.5f64) {
        let moved = Similarity::<Ct, Ct>::new(size, moved.rotation, moved.translation_mm);
        let (target, viewpoint) = view();
        let options = Options { viewpoint: Some(viewpoint), ..Options::default() };
        let from_here = solve(&target, &options);
        let elsewhere = Cloud::new(crescent().points.iter().map(|p| moved * *p).collect());
        let options = Options { scale: ScaleRange::known(1.0 / size), ..options };
        let from_there = register(&elsewhere, &target, &options, &mut |_| {}, &Budget::default()).unwrap();
        let error_mm = largest_error_mm(&(from_there.camera_from_ct * moved), &from_here.camera_from_ct);
        prop_assert!(error_mm < 0.5, "{error_mm} mm");
        prop_assert_eq!(from_there.verdict, from_here.verdict);
    }

    #[test]
    fn the_order_of_the_points_does_not_matter(seed in any::<u64>()) {
        let (target, viewpoint) = view();
        let options = Options { viewpoint: Some(viewpoint), ..Options::default() };
        let in_order = solve(&target, &options);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut shuffled = target;
        for last in (1..shuffled.points.len()).rev() {
            shuffled.points.swap(last, rng.random_range(0..=last));
        }
        let out_of_order = solve(&shuffled, &options);
        let error_mm = largest_error_mm(&in_order.camera_from_ct, &out_of_order.camera_from_ct);
        prop_assert!(error_mm < 0.1, "{error_mm} mm");
    }
}

#[test]
fn a_computation_in_a_hurry_answers_with_what_it_has() {
    let (target, viewpoint) = view();
    let options = Options {
        viewpoint: Some(viewpoint),
        scale: ScaleRange {
            low: 0.3,
            high: 3.5,
        },
        ..Options::default()
    };
    let budget = Budget::default();
    budget.hurry();
    let mut searched = 0;
    let mut watch = |event: Event| searched += u32::from(matches!(event, Event::Searched { .. }));
    let found = register(&crescent(), &target, &options, &mut watch, &budget).unwrap();
    assert_eq!(searched, 1);
    assert!(found.camera_from_ct.scale > 0.0);
}

#[test]
fn the_error_is_predicted_over_the_target_region_and_a_region_beside_the_model_is_refused() {
    let (target, viewpoint) = view();
    let predicted = |region: Option<(Point3, Point3)>| {
        let options = Options {
            viewpoint: Some(viewpoint),
            target_region: region,
            ..Options::default()
        };
        let found = register(
            &crescent(),
            &target,
            &options,
            &mut |_| {},
            &Budget::default(),
        );
        found.map(|found| found.evidence.tre_predicted_mm)
    };
    let everywhere = predicted(Some((
        Point3::new(-99.0, -99.0, -99.0),
        Point3::new(99.0, 99.0, 99.0),
    )));
    assert_eq!(everywhere.unwrap(), predicted(None).unwrap());
    let horn = predicted(Some((
        Point3::new(5.0, -99.0, -99.0),
        Point3::new(99.0, 99.0, 99.0),
    )));
    assert_ne!(horn.unwrap(), predicted(None).unwrap());
    let beside = predicted(Some((
        Point3::new(50.0, 0.0, 0.0),
        Point3::new(60.0, 9.0, 9.0),
    )));
    let Err(Error::Invalid(violations)) = beside else {
        panic!("accepted");
    };
    assert_eq!(violations[0].field, "target_region");
}

#[test]
fn a_view_without_its_viewpoint_is_found_too() {
    let (target, _) = view();
    let found = solve(&target, &Options::default());
    let error_mm = largest_error_mm(&found.camera_from_ct, &Similarity::identity());
    assert!(error_mm < 0.5, "{error_mm} mm, {:?}", found.reasons);
}

#[test]
fn the_answer_is_the_same_on_any_number_of_threads() {
    let (target, viewpoint) = view();
    let options = Options {
        viewpoint: Some(viewpoint),
        seed: 7,
        ..Options::default()
    };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let mut events = Vec::new();
        let answer = pool.install(|| {
            register(
                &crescent(),
                &target,
                &options,
                &mut |event| events.push(event),
                &Budget::default(),
            )
        });
        let answer = answer.unwrap();
        (
            answer.camera_from_ct,
            answer.evidence,
            answer.residuals_mm,
            events,
        )
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn another_scale_than_metric_is_found_within_its_tolerance() {
    let (view, viewpoint) = view();
    let target = Cloud::new(view.points.iter().map(|p| p * 2.1).collect());
    let options = Options {
        scale: ScaleRange::around(2.0, 0.2),
        viewpoint: Some(viewpoint * 2.1),
        ..Options::default()
    };
    let found = solve(&target, &options);
    assert!(
        (found.camera_from_ct.scale / 2.1 - 1.0).abs() < 0.01,
        "{}",
        found.camera_from_ct.scale
    );
}

#[test]
fn something_else_than_the_model_is_not_accepted() {
    let dome: Vec<Point3> = (0..1600)
        .map(|i| (f64::from(i % 40) - 20.0, f64::from(i / 40) - 20.0))
        .map(|(x, y)| Point3::new(x, y, 0.03 * (x * x + y * y)))
        .collect();
    let found = solve(&Cloud::new(dome), &Options::default());
    assert_eq!(
        found.verdict,
        Verdict::Reject,
        "{:?} {:?}",
        found.evidence,
        found.reasons
    );
    assert!(!found.reasons.is_empty());
}

#[test]
fn a_cancelled_registration_stops_between_its_stages() {
    let (target, _) = view();
    let budget = Budget::default();
    let mut stages = 0;
    let outcome = register(
        &crescent(),
        &target,
        &Options::default(),
        &mut |event| {
            stages += u32::from(event == Event::FineStarted);
            budget.cancel();
        },
        &budget,
    );
    assert!(matches!(outcome, Err(Error::Cancelled)));
    assert_eq!(stages, 0);
}

#[test]
fn a_cloud_in_metres_is_refused_with_the_question_whether_it_is() {
    let metres = Cloud::new(crescent().points.iter().map(|p| p / 1000.0).collect());
    let outcome = register(
        &metres,
        &metres,
        &Options::default(),
        &mut |_| {},
        &Budget::default(),
    );
    let Err(Error::Invalid(violations)) = outcome else {
        panic!("accepted");
    };
    assert_eq!(violations.len(), 2);
    assert!(violations[0].description.contains("metres?"));
}

#[test]
fn the_largest_clouds_accepted_are_registered_too() {
    let (view, viewpoint) = view();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut grown = |points: &[Point3]| {
        let jitter = |rng: &mut ChaCha8Rng| Vector3::from_fn(|_, _| rng.random_range(-0.15..0.15));
        let points = points.iter().cycle().take(MAX_POINTS);
        Cloud::new(points.map(|p| p + jitter(&mut rng)).collect())
    };
    let (source, target) = (grown(&crescent().points), grown(&view.points));
    let options = Options {
        viewpoint: Some(viewpoint),
        ..Options::default()
    };
    let found = register(&source, &target, &options, &mut |_| {}, &Budget::default()).unwrap();
    let error_mm = largest_error_mm(&found.camera_from_ct, &Similarity::identity());
    assert!(error_mm < 0.5, "{error_mm} mm");
    assert_eq!(found.residuals_mm.len(), MAX_POINTS);
}
