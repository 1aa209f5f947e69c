//! Planes that are known, and scenes without one.

use super::*;

const REMOVAL: PlaneRemoval = PlaneRemoval {
    margin_mm: 1.0,
    min_share: 0.3,
    planes: 1,
    seed: 7,
};

fn seen(x: f64, y: f64, z: f64) -> SeenPoint {
    SeenPoint {
        position: Point3::new(x, y, z),
        normal: -Vector3::z(),
        sigma_mm: 0.1,
        normal_sigma_rad: 0.1,
        view: 0,
        pixel: 0,
    }
}

/// A tilted table 400 mm away, a bump that stands 5 mm out of it, and something below the edge of the table.
fn scene(bump: bool) -> Vec<SeenPoint> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..10_000)
        .map(|i| {
            let (x, y) = (f64::from(i % 100) - 50.0, f64::from(i / 100) - 50.0);
            let table = 400.0 + 0.3 * x - 0.1 * y + 0.2 * (rng.random::<f64>() - 0.5);
            match x {
                x if x > 30.0 => seen(x, y, table + 40.0),
                _ if bump && x.hypot(y) < 10.0 => seen(x, y, table - 5.0),
                _ => seen(x, y, table),
            }
        })
        .collect()
}

#[test]
fn what_stands_out_of_the_plane_stays_and_what_is_behind_it_goes() {
    let points = scene(true);
    let (plane, indices) = REMOVAL.largest(&points, &[Point3::origin()]).unwrap();
    let expected = Vector3::new(0.3, -0.1, -1.0).normalize();
    assert!(plane.normal.angle(&expected) < 2e-3, "{}", plane.normal);
    assert!(plane.rms_mm < 0.1);
    let gone: Vec<bool> = (0..points.len())
        .map(|index| indices.binary_search(&index).is_ok())
        .collect();
    for (point, gone) in points.iter().zip(gone) {
        let is_bump = point.position.x.hypot(point.position.y) < 10.0;
        assert_eq!(gone, !is_bump, "{point:?}");
    }
}

#[test]
fn a_plane_that_takes_everything_is_refused() {
    let error = REMOVAL
        .largest(&scene(false), &[Point3::origin()])
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "header.plane: takes 10000 of 10000 points: nothing stands more than 1 mm out of the plane"
    );
}

#[test]
fn a_scene_without_a_plane_is_refused_with_the_share() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let cloud: Vec<SeenPoint> = (0..2000)
        .map(|_| {
            let [x, y, z] = [0; 3].map(|_| rng.random_range(-50.0..50.0));
            seen(x, y, z + 400.0)
        })
        .collect();
    let error = REMOVAL.largest(&cloud, &[Point3::origin()]).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("finds no plane: the largest holds 0."),
        "{error}"
    );
}

#[test]
fn a_viewpoint_in_the_plane_and_viewpoints_on_both_sides_are_refused() {
    let points = scene(true);
    for viewpoints in [
        &[Point3::new(0.0, 0.0, 400.0)][..],
        &[Point3::origin(), Point3::new(0.0, 0.0, 900.0)],
    ] {
        let error = REMOVAL
            .largest(&points, viewpoints)
            .map(|found| found.0)
            .unwrap_err();
        assert!(error.to_string().contains("to one side of it"), "{error}");
    }
    let error = REMOVAL
        .largest(&points, &[])
        .map(|found| found.0)
        .unwrap_err();
    assert!(error.to_string().contains("needs at least 1"), "{error}");
}

#[test]
fn the_same_seed_finds_the_same_plane_on_any_number_of_threads() {
    let points = scene(true);
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| REMOVAL.largest(&points, &[Point3::origin()]).unwrap())
    };
    assert_eq!(on(1), on(4));
}

#[test]
fn points_on_a_line_and_too_few_points_are_no_panic() {
    let line: Vec<SeenPoint> = (0..200).map(|i| seen(f64::from(i), 0.0, 400.0)).collect();
    assert!(REMOVAL.largest(&line, &[Point3::origin()]).is_err());
    let error = REMOVAL
        .largest(&line[..99], &[Point3::origin()])
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("finds 99 points, needs at least 100")
    );
}

#[test]
fn bad_parameters_are_all_named() {
    let removal = PlaneRemoval {
        margin_mm: f64::NAN,
        min_share: 0.1,
        planes: 5,
        seed: 0,
    };
    let fields: Vec<String> = removal.violations().into_iter().map(|v| v.field).collect();
    assert_eq!(
        fields,
        [
            "header.plane.margin_mm",
            "header.plane.min_share",
            "header.plane.planes"
        ]
    );
}
