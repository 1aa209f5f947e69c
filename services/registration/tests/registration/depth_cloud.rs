//! Depth images of known things come back as these things, within what the noise law says.

use arthro_geometry::frame::Ct;
use arthro_geometry::{Point3, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::depth::deproject::{SeenPoint, UNKNOWN_NORMAL_RAD};
use arthro_registration::depth::distortion::Distortion;
use arthro_registration::depth::fusion::frames::SATURATED;
use arthro_registration::depth::intrinsics::Roi;
use arthro_registration::depth::options::{DEFAULT_STEEPEST_RAD, Options};
use arthro_registration::depth::{Capture, DepthCloud, View, from_view, from_views};

use crate::depth_scene::{
    COEFFICIENTS, INTRINSICS, Knee, STATISTICAL, UNIT_MM, capture, cloud, lens, noisy, plane,
    render, rounded, sphere,
};

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0_f64), |(sum, count), value| {
        (sum + value * value, count + 1.0)
    });
    assert!(count > 0.0, "nothing to judge");
    (sum / count).sqrt()
}

#[test]
fn a_plane_and_a_sphere_come_back_through_any_lens() {
    let tilted = Vector3::new(0.3, -0.2, 1.0).normalize();
    let middle = Point3::new(10.0, -5.0, 320.0);
    for distortion in [
        Distortion::None,
        Distortion::BrownConrady(COEFFICIENTS),
        Distortion::InverseBrownConrady(COEFFICIENTS),
    ] {
        let lens = lens(distortion);
        let seen = |depth_mm: &[f64]| {
            let frames = [rounded(depth_mm)];
            from_view(
                &capture(&lens, &frames),
                &Options::default(),
                &Budget::default(),
            )
            .unwrap()
            .points
        };
        // Rounding moves a point along its ray by at most half a unit.
        let most_mm = 0.51 * UNIT_MM * 1.2;
        let on_plane = seen(&render(&distortion, &plane(tilted, 300.0)));
        assert_eq!(on_plane.len() as u64, INTRINSICS.pixels());
        for point in &on_plane {
            assert!((tilted.dot(&point.position.coords) - 300.0).abs() < most_mm);
            assert!(point.normal.angle(&-tilted) < 0.12, "{point:?}");
        }
        let on_sphere = seen(&render(&distortion, &sphere(middle, 40.0)));
        assert!(on_sphere.len() > 5000);
        for point in &on_sphere {
            let outwards = point.position - middle;
            assert!((outwards.norm() - 40.0).abs() < most_mm);
            assert!((point.normal.norm() - 1.0).abs() < 1e-9);
            assert!(point.normal.dot(&point.position.coords) < 0.0);
        }
        let turned = root_mean_square(
            on_sphere
                .iter()
                .filter(|point| point.normal_sigma_rad < UNKNOWN_NORMAL_RAD)
                .map(|point| point.normal.angle(&(point.position - middle))),
        );
        assert!(turned < 0.05, "{turned} rad");
    }
}

#[test]
fn errors_of_points_and_normals_are_as_large_as_their_sigmas_say() {
    let tilted = Vector3::new(0.5, 0.3, 1.0).normalize();
    let truth = render(&Distortion::None, &plane(tilted, 300.0));
    for frames in [1, 9] {
        let taken: Vec<Vec<u16>> = (0..frames).map(|seed| noisy(&truth, seed)).collect();
        let cloud = cloud(&taken, &Options::default());
        let points = root_mean_square(cloud.points.iter().map(|point| {
            let error_mm = (point.position.z - truth[point.pixel as usize])
                * (point.position.coords.norm() / point.position.z);
            error_mm / point.sigma_mm
        }));
        assert!(
            (points - 1.0).abs() < 0.03,
            "{frames} frames: {points} sigma"
        );
        let normals = root_mean_square(
            cloud
                .points
                .iter()
                .map(|point| point.normal.angle(&-tilted) / point.normal_sigma_rad),
        );
        assert!(
            (normals - 1.0).abs() < 0.1,
            "{frames} frames: {normals} sigma"
        );
    }
}

#[test]
fn the_average_of_n_frames_is_better_by_the_root_of_n() {
    let truth = render(&Distortion::None, &plane(Vector3::z(), 350.0));
    let error_mm = |frames: u64| {
        let taken: Vec<Vec<u16>> = (0..frames).map(|seed| noisy(&truth, seed)).collect();
        let cloud = cloud(&taken, &Options::default());
        root_mean_square(cloud.points.iter().map(|point| point.position.z - 350.0))
    };
    let one = error_mm(1);
    for frames in [4, 16] {
        let gain = one / error_mm(frames) / (frames as f64).sqrt();
        assert!((gain - 1.0).abs() < 0.03, "{frames} frames: {gain}");
    }
}

#[test]
fn a_hand_in_one_frame_leaves_no_trace_and_is_told() {
    let truth = render(&Distortion::None, &plane(Vector3::z(), 350.0));
    let mut taken: Vec<Vec<u16>> = (0..5).map(|seed| noisy(&truth, seed)).collect();
    taken[2][..20_000].fill(1500);
    let cloud = cloud(&taken, &Options::default());
    let farthest = cloud
        .points
        .iter()
        .map(|point| (point.position.z - 350.0).abs())
        .fold(0.0, f64::max);
    assert!(farthest < 2.0, "{farthest} mm");
    assert!((20_000..20_100).contains(&cloud.report.clipped[2]));
    assert!(cloud.report.clipped[0] < 100, "{:?}", cloud.report.clipped);
}

#[test]
fn only_the_region_the_mask_and_the_range_that_are_asked_for_become_points() {
    let mut frame = vec![3500; INTRINSICS.pixels() as usize];
    frame[50 * 320 + 100] = 2500;
    frame[50 * 320 + 101] = 4500;
    frame[50 * 320 + 102] = 0;
    frame[50 * 320 + 103] = SATURATED;
    let mut mask = vec![1; frame.len()];
    mask[51 * 320..52 * 320].fill(0);
    let lens = lens(Distortion::None);
    let frames = [frame];
    let capture = Capture {
        mask: Some(&mask),
        ..capture(&lens, &frames)
    };
    let options = Options {
        roi: Some(Roi {
            column_px: 90,
            row_px: 50,
            width_px: 20,
            height_px: 3,
        }),
        min_depth_mm: 300.0,
        max_depth_mm: 400.0,
        ..Options::default()
    };
    let cloud = from_view(&capture, &options, &Budget::default()).unwrap();
    // Two rows of 20 without the four.
    assert_eq!(cloud.points.len(), 36);
    let dropped = cloud.report.dropped;
    assert_eq!(
        (
            dropped.out_of_range,
            dropped.without_depth,
            dropped.saturated
        ),
        (2, 1, 1)
    );
    for point in &cloud.points {
        let (column, row) = (point.pixel % 320, point.pixel / 320);
        assert!((90..110).contains(&column) && (row == 50 || row == 52));
    }
}

#[test]
fn several_viewpoints_become_one_cloud_with_less_noise_and_more_surface() {
    let knees = [(0.5, 0.0), (0.5, 2.1), (0.5, 4.2)].map(|(tilt, turn)| Knee::new(tilt, turn));
    let frames: Vec<Vec<Vec<u16>>> = knees
        .iter()
        .zip(0..)
        .map(|(knee, seed)| {
            vec![noisy(
                &render(&Distortion::None, &|ray| knee.depth_mm(ray)),
                seed,
            )]
        })
        .collect();
    let lens = lens(Distortion::None);
    let views: Vec<View<'_, Ct>> = knees
        .iter()
        .zip(&frames)
        .map(|(knee, frames)| View {
            f_from_camera: knee.camera_from_ct.inverse(),
            capture: capture(&lens, frames),
        })
        .collect();
    let options = Options {
        voxel_mm: 1.5,
        ..Options::default()
    };
    let from = |views: &[View<'_, Ct>]| from_views(views, &options, &Budget::default()).unwrap();
    let (one, three) = (from(&views[..1]), from(&views));
    // The plateau is at x = 52, bare farther than 32 mm from its middle.
    let on_plateau = |cloud: &DepthCloud<Ct>| -> Vec<SeenPoint> {
        let near = |p: &Point3| {
            (32.0..42.0).contains(&(p.y - 46.0).hypot(p.z - 50.0)) && (p.x - 52.0).abs() < 2.0
        };
        let points = cloud.points.iter().copied();
        points.filter(|point| near(&point.position)).collect()
    };
    let error_mm =
        |points: &[SeenPoint]| root_mean_square(points.iter().map(|point| point.position.x - 52.0));
    let (alone, together) = (on_plateau(&one), on_plateau(&three));
    let gain = error_mm(&alone) / error_mm(&together);
    let in_sigmas = root_mean_square(
        together
            .iter()
            .map(|point| (point.position.x - 52.0) / (0.5f64.cos() * point.sigma_mm)),
    );
    assert!((1.5..1.9).contains(&gain), "{gain}");
    assert!((in_sigmas - 1.0).abs() < 0.1, "{in_sigmas} sigma");
    assert!(three.points.len() > one.points.len());
    assert_eq!(three.viewpoints.len(), 3);
    for view in 0..3 {
        assert!(three.points.iter().any(|point| point.view == view));
    }
    for point in &three.points {
        let viewpoint = three.viewpoints[point.view as usize];
        assert!(point.normal.dot(&(viewpoint - point.position)) > -0.5);
    }
}

#[test]
fn one_image_gives_the_same_points_on_any_number_of_threads() {
    let knee = Knee::new(0.3, 1.0);
    let frames = [noisy(
        &render(&Distortion::None, &|ray| knee.depth_mm(ray)),
        1,
    )];
    let options = Options {
        max_depth_mm: 390.0,
        steepest_rad: Some(DEFAULT_STEEPEST_RAD),
        outliers: Some(STATISTICAL),
        ..Options::default()
    };
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| cloud(&frames, &options))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn bad_input_is_refused_with_every_violation() {
    let lens = lens(Distortion::None);
    let refusal = |capture: &Capture<'_>, options: &Options| {
        from_view(capture, options, &Budget::default())
            .unwrap_err()
            .to_string()
    };
    let options = Options {
        roi: Some(Roi {
            column_px: 300,
            row_px: 0,
            width_px: 21,
            height_px: 1,
        }),
        min_depth_mm: 400.0,
        max_depth_mm: 300.0,
        steepest_rad: Some(f64::NAN),
        normal_reach_px: 11,
        ..Options::default()
    };
    let frames = [vec![1; 7]];
    let wrong = Capture {
        mask: Some(&[1; 9]),
        ..capture(&lens, &frames)
    };
    assert_eq!(
        refusal(&wrong, &options),
        "depth: has 7 pixels, must have 76800; \
         mask: has 9 pixels, must have 76800; \
         header.roi: reaches column 320, the last of the image is 319; \
         header.max_depth_mm: is 300, must be greater than min_depth_mm, 400; \
         header.flying_pixels.steepest_rad: is NaN, must be 0.785 to 1.554; \
         header.normal_reach_px: is 11, must be 1 to 10"
    );
    let nothing = Capture {
        frames: Vec::new(),
        mask: None,
    };
    assert!(refusal(&nothing, &Options::default()).contains("header.frame_count: is 0"));
    let saturated = [vec![SATURATED; 76_800]];
    assert!(
        refusal(&capture(&lens, &saturated), &Options::default())
            .contains("depth: is 65535 in all 76800 measured pixels, which is beyond 16 bits")
    );
    let none: [View<'_, Ct>; 0] = [];
    let error = from_views(&none, &Options::default(), &Budget::default()).unwrap_err();
    assert!(error.to_string().contains("header.views: has 0"));
}

#[test]
fn an_image_without_any_depth_gives_an_empty_cloud() {
    let cloud = cloud(&[vec![0; 76_800]], &Options::default());
    assert!(cloud.points.is_empty());
    assert_eq!(cloud.report.dropped.without_depth, 76_800);
}
