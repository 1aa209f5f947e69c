//! What does not belong to the thing is taken away from its cloud, and the thing stays.

use arthro_geometry::{Point3, Vector3};
use arthro_registration::depth::deproject::SeenPoint;
use arthro_registration::depth::distortion::Distortion;
use arthro_registration::depth::intrinsics::Roi;
use arthro_registration::depth::options::{DEFAULT_STEEPEST_RAD, Options};
use arthro_registration::depth::plane::PlaneRemoval;

use crate::depth_scene::{Knee, PLATEAU_MM, STATISTICAL, cloud, noisy, render, sphere};

#[test]
fn flying_pixels_go_and_edges_stay() {
    // A block 40 mm in front of a wall; around it a ring of pixels that mix both.
    let inside = |column: i32, row: i32, grown: i32| {
        (100 - grown..200 + grown).contains(&column) && (80 - grown..160 + grown).contains(&row)
    };
    let mut mixed = Vec::new();
    let truth: Vec<f64> = (0..240)
        .flat_map(|row| (0..320).map(move |column| (column, row)))
        .map(|(column, row)| {
            let is_mixed = inside(column, row, 1) && !inside(column, row, 0);
            mixed.push(is_mixed);
            match (is_mixed, inside(column, row, 0)) {
                (true, _) => 318.0 + f64::from((7 * column + 3 * row) % 5),
                (false, true) => 300.0,
                (false, false) => 340.0,
            }
        })
        .collect();
    let options = Options {
        steepest_rad: Some(DEFAULT_STEEPEST_RAD),
        ..Options::default()
    };
    let cloud = cloud(&[noisy(&truth, 1)], &options);
    let kept: Vec<bool> = cloud
        .points
        .iter()
        .map(|point| mixed[point.pixel as usize])
        .collect();
    let ring = mixed.iter().filter(|is_mixed| **is_mixed).count();
    assert_eq!(kept.iter().filter(|is_mixed| **is_mixed).count(), 0);
    assert_eq!(cloud.points.len(), truth.len() - ring);
    assert_eq!(cloud.report.dropped.flying, ring);
}

#[test]
fn planted_strays_are_found_and_the_edge_of_the_surface_stays() {
    let ball = sphere(Point3::new(0.0, 0.0, 340.0), 40.0);
    let truth = render(&Distortion::None, &ball);
    let mut frame = noisy(&truth, 3);
    let planted: Vec<u32> = (0..40).map(|i| 320 * (20 + 5 * i) + 7 * i + 11).collect();
    for pixel in &planted {
        frame[*pixel as usize] = (2000 + 10 * (pixel % 31)) as u16;
    }
    let options = Options {
        outliers: Some(STATISTICAL),
        ..Options::default()
    };
    let measured = frame.iter().filter(|depth| **depth > 0).count();
    let cloud = cloud(&[frame], &options);
    let strays: Vec<u32> = cloud
        .report
        .strays
        .iter()
        .map(|stray| stray.pixel)
        .collect();
    for pixel in &planted {
        assert!(strays.contains(pixel), "pixel {pixel} stayed");
    }
    // The grazing rim of a noisy ball is the hardest edge there is.
    let lost = strays.len() - planted.len();
    assert!(lost <= measured / 500, "{lost} of {measured} points lost");
    assert_eq!(cloud.points.len() + strays.len(), measured);
}

#[test]
fn the_crescent_stays_when_the_plateau_it_lies_on_is_taken_away() {
    let removal = PlaneRemoval {
        margin_mm: 1.0,
        min_share: 0.3,
        planes: 1,
        seed: 1,
    };
    for (tilt_rad, turn_rad) in [(0.0, 0.0), (0.4, 1.0), (0.6, 4.0)] {
        let knee = Knee::new(tilt_rad, turn_rad);
        let truth = render(&Distortion::None, &|ray| knee.depth_mm(ray));
        let frames: Vec<Vec<u16>> = (0..4).map(|seed| noisy(&truth, seed)).collect();
        // The region holds the plateau and corners of the drape.
        let options = Options {
            roi: Some(Roi {
                column_px: 98,
                row_px: 61,
                width_px: 120,
                height_px: 120,
            }),
            ..Options::default()
        };
        let all = cloud(&frames, &options).points;
        let options = Options {
            plane: Some(removal),
            ..options
        };
        let cloud = cloud(&frames, &options);
        let count = |points: &[SeenPoint], heights: std::ops::Range<f64>| {
            let of_knee = points.iter().map(|point| &point.position);
            of_knee
                .filter(|p| knee.aside_mm(p) < PLATEAU_MM && heights.contains(&knee.height_mm(p)))
                .count()
        };
        let [crescent, kept] = [&all, &cloud.points].map(|points| count(points, 2.0..20.0));
        assert!(crescent > 400, "{crescent} points");
        assert_eq!(kept, crescent, "tilt {tilt_rad}");
        let [plateau, left] = [&all, &cloud.points].map(|points| count(points, -20.0..0.5));
        assert!(plateau > 5000);
        assert!(
            left * 1000 < plateau,
            "{left} of {plateau} of the plateau stay"
        );
        let plane = &cloud.report.planes[0];
        let up = knee.camera_from_ct.direction(&Vector3::x());
        assert!(
            plane.normal.angle(&up) < 0.01,
            "{}",
            plane.normal.angle(&up)
        );
    }
}

#[test]
fn the_drape_goes_first_and_the_plateau_after_it() {
    let knee = Knee::new(0.3, 2.0);
    let truth = render(&Distortion::None, &|ray| knee.depth_mm(ray));
    let options = Options {
        plane: Some(PlaneRemoval {
            margin_mm: 1.0,
            min_share: 0.3,
            planes: 2,
            seed: 5,
        }),
        ..Options::default()
    };
    let cloud = cloud(&[noisy(&truth, 0), noisy(&truth, 1)], &options);
    assert_eq!(cloud.report.planes.len(), 2);
    assert!(cloud.points.len() > 500, "{} points", cloud.points.len());
    for point in &cloud.points {
        assert!(knee.height_mm(&point.position) > 0.4, "{point:?}");
    }
}
