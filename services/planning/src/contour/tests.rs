use super::*;
use proptest::prelude::*;

fn arc(radius_mm: f64, points: usize, turn_rad: f64) -> Vec<Point3> {
    (0..points)
        .map(|step| {
            let angle = turn_rad * step as f64 / (points - 1) as f64;
            Point3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), 3.0)
        })
        .collect()
}

#[test]
fn an_arc_keeps_its_radius_and_length() {
    let points = arc(13.0, 200, 2.5);
    let spline = Spline::fit(&points, 14).unwrap();
    assert!((spline.length_mm() - 32.5).abs() < 1e-3);
    assert!(spline.rms_mm(&points) < 1e-3);
    for at in spline.parameters_every(1.0) {
        assert!((spline.curvature_per_mm(at) - 1.0 / 13.0).abs() < 2e-3);
        assert!((spline.point(at) - Point3::new(0.0, 0.0, 3.0)).norm() - 13.0 < 1e-3);
    }
}

#[test]
fn samples_are_equally_far_apart_along_the_curve() {
    let spline = Spline::fit(&arc(13.0, 14, 2.5), 8).unwrap();
    let samples = spline.points_every(1.0);
    assert_eq!(samples.len(), 33 + 1);
    let chords: Vec<f64> = samples.windows(2).map(|p| (p[1] - p[0]).norm()).collect();
    let mean = chords.iter().sum::<f64>() / chords.len() as f64;
    assert!(chords.iter().all(|chord| (chord - mean).abs() < 2e-3));
}

#[test]
fn as_many_control_points_as_points_interpolate() {
    let points = arc(8.0, 9, 3.0);
    let spline = Spline::fit(&points, 9).unwrap();
    assert!(spline.rms_mm(&points) < 1e-9);
}

#[test]
fn what_is_no_cubic_is_refused() {
    let points = arc(8.0, 5, 1.0);
    assert_eq!(
        Spline::fit(&[points[0]; 9], 4).unwrap_err(),
        Error::TooFewPoints { distinct: 1 }
    );
    assert!(matches!(
        Spline::fit(&points, 6),
        Err(Error::ControlPoints { .. })
    ));
    assert!(matches!(
        Spline::fit(&points, 3),
        Err(Error::ControlPoints { .. })
    ));
}

fn any_spline() -> impl Strategy<Value = Spline> {
    let value = -9.0..9.0f64;
    proptest::collection::vec((value.clone(), value.clone(), value), 12).prop_map(|values| {
        let points: Vec<_> = values
            .iter()
            .map(|&(x, y, z)| Point3::new(x, y, z))
            .collect();
        Spline::fit(&points, 7).unwrap()
    })
}

#[test]
fn an_arc_that_turns_anticlockwise_is_curved_positively_and_its_height_does_not_matter() {
    let flat = arc(13.0, 200, 2.5);
    let mut rising = flat.clone();
    for (step, point) in rising.iter_mut().enumerate() {
        point.z = step as f64 * 0.1;
    }
    let reversed: Vec<_> = flat.iter().rev().copied().collect();
    for (points, expected) in [
        (&flat, 1.0 / 13.0),
        (&rising, 1.0 / 13.0),
        (&reversed, -1.0 / 13.0),
    ] {
        let spline = Spline::fit(points, 14).unwrap();
        for at in spline.parameters_every(1.0) {
            let curvature_per_mm = spline.signed_curvature_per_mm(at, &Vector3::z());
            assert!(
                (curvature_per_mm - expected).abs() < 2e-3,
                "{curvature_per_mm}"
            );
        }
    }
}

proptest! {
    #[test]
    fn derivatives_agree_with_differences_of_points(
        values in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64, -9.0..9.0f64), 12),
        at in 0.05..0.95f64,
    ) {
        let points: Vec<_> = values.iter().map(|&(x, y, z)| Point3::new(x, y, z)).collect();
        let spline = Spline::fit(&points, 7).unwrap();
        let step = 1e-5;
        let (before, after) = (spline.point(at - step), spline.point(at + step));
        let (first, _) = spline.derivatives(at);
        let numeric = (after - before) / (2.0 * step);
        prop_assert!((numeric - first).norm() < 1e-4 * (1.0 + first.norm()));
    }

    #[test]
    fn the_ends_are_met_exactly(
        values in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64, -9.0..9.0f64), 5..40),
    ) {
        let points: Vec<_> = values.iter().map(|&(x, y, z)| Point3::new(x, y, z)).collect();
        let spline = Spline::fit(&points, 5).unwrap();
        prop_assert!((spline.point(0.0) - points[0]).norm() < 1e-9);
        prop_assert!((spline.point(1.0) - points[points.len() - 1]).norm() < 1e-9);
    }

    #[test]
    fn second_derivatives_agree_with_differences_of_first(spline in any_spline(), at in 0.05..0.95f64) {
        let step = 1e-5;
        let (before, after) = (spline.derivatives(at - step).0, spline.derivatives(at + step).0);
        let (_, second) = spline.derivatives(at);
        let numeric = (after - before) / (2.0 * step);
        // The third derivative jumps at a knot.
        let third = 1e-3 * spline.derivatives(at).0.norm().max(second.norm());
        prop_assert!((numeric - second).norm() < 1.0 + third, "{} {}", numeric, second);
    }

    #[test]
    fn the_arc_length_is_that_of_a_dense_polyline(spline in any_spline()) {
        let points: Vec<_> = (0..=20_000).map(|step| spline.point(f64::from(step) / 20_000.0)).collect();
        let polyline_mm: f64 = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        prop_assert!((spline.length_mm() / polyline_mm - 1.0).abs() < 2e-3);
    }

    #[test]
    fn no_sample_is_nearer_than_the_foot_point(
        spline in any_spline(),
        point in (-12.0..12.0f64, -12.0..12.0f64, -12.0..12.0f64),
    ) {
        let point = Point3::new(point.0, point.1, point.2);
        let away = |at: f64| (spline.point(at) - point).norm();
        let sampled = (0..=5_000).map(|step| away(f64::from(step) / 5_000.0));
        let nearest_mm = sampled.fold(f64::INFINITY, f64::min);
        prop_assert!(away(spline.nearest(&point)) < nearest_mm + 1e-9);
    }

    #[test]
    fn a_point_of_the_curve_is_its_own_foot_point(spline in any_spline(), at in 0.0..1.0f64) {
        let point = spline.point(at);
        prop_assert!((spline.point(spline.nearest(&point)) - point).norm() < 1e-6);
    }

    #[test]
    fn the_sign_of_curvature_turns_with_the_normal(
        spline in any_spline(),
        at in 0.0..1.0f64,
    ) {
        let normal = Vector3::z();
        let one = spline.signed_curvature_per_mm(at, &normal);
        let other = spline.signed_curvature_per_mm(at, &-normal);
        prop_assert!((one + other).abs() <= 1e-9 * one.abs());
    }
}
