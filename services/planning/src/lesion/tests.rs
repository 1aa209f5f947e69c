use super::*;
use crate::plan;
use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::phantom::{self, Coordinates, Phantom, RadialTear};
use arthro_geometry::scan::{self, Lattice, Scan};

fn model() -> (Crescent, Voxels) {
    plan::model(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL, 0.5, 1.0).unwrap()
}

/// A point on the superior surface, as a click finds it.
fn on_top(phi_rad: f64, width_fraction: f64) -> Point3 {
    Phantom::default().point(Coordinates {
        phi_rad,
        width_fraction,
        height_fraction: 1.0,
    })
}

fn refusal(lesion: Result<Lesion, Error>) -> String {
    lesion.unwrap_err().to_string()
}

#[test]
fn a_marked_point_is_the_tissue_around_it_through_the_full_thickness() {
    let (crescent, voxels) = model();
    let mark = on_top(0.3, 0.5);
    let lesion = Lesion::near_points(&[mark], 1.5, &crescent, &voxels, 1.0).unwrap();
    let thickness_mm = Phantom::default().thickness_mm(0.5);
    let expected_mm3 = std::f64::consts::PI * 1.5 * 1.5 * thickness_mm;
    let share = lesion.volume_mm3() / expected_mm3;
    assert!((share - 1.0).abs() < 0.15, "{share}");
    let center = crescent.ct_from_meniscal.inverse() * mark;
    let farthest_mm = lesion
        .points
        .iter()
        .map(|point| (point.xy() - center.xy()).norm());
    assert!(farthest_mm.fold(0.0, f64::max) <= 1.5);
}

#[test]
fn a_closed_curve_is_the_tissue_inside_it() {
    let (crescent, voxels) = model();
    let center = on_top(0.2, 0.5);
    let circle: Vec<Point3> = (0..12)
        .map(|step| {
            let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 12.0).sin_cos();
            center
                + (phantom::ANTERIOR * cos + phantom::SUPERIOR.cross(&phantom::ANTERIOR) * sin)
                    * 3.0
        })
        .collect();
    let lesion = Lesion::inside_curve(&circle, &crescent, &voxels).unwrap();
    let disc = Lesion::near_points(&[center], 3.0, &crescent, &voxels, 1.0).unwrap();
    let differing = lesion
        .marks
        .iter()
        .zip(&disc.marks)
        .filter(|(a, b)| a != b)
        .count();
    let marked = disc.points.len();
    assert!(differing * 20 < marked, "{differing} of {marked}");
}

#[test]
fn marks_that_mean_nothing_are_refused() {
    let (crescent, voxels) = model();
    let near = |points: &[Point3], radius_mm| {
        Lesion::near_points(points, radius_mm, &crescent, &voxels, 1.0)
    };
    let inside = |points: &[Point3]| Lesion::inside_curve(points, &crescent, &voxels);
    let (good, off) = (on_top(0.0, 0.3), on_top(0.0, 3.0));
    assert!(refusal(near(&[], 1.0)).contains("has 0 points"));
    assert!(refusal(near(&[good, off], 1.0)).contains("[1] is more than 1 mm beside"));
    assert!(refusal(near(&[good, Point3::new(f64::NAN, 0.0, 0.0)], 1.0)).contains("[1] is"));
    for radius_mm in [0.0, -1.0, f64::NAN, 11.0] {
        assert!(refusal(near(&[good], radius_mm)).starts_with("lesion_radius_mm is"));
    }
    assert!(refusal(inside(&[good, off])).contains("has 2 points"));
    let bow = [
        on_top(-0.2, 0.2),
        on_top(0.2, 0.2),
        on_top(-0.2, 0.6),
        on_top(0.2, 0.6),
    ];
    assert!(refusal(inside(&bow)).contains("crosses itself"));
    let beside = [(-0.1, 2.0), (0.1, 2.0), (0.0, 2.2)].map(|(phi, s)| on_top(phi, s));
    assert!(refusal(inside(&beside)).contains("marks no tissue"));
}

/// A segmentation with oblique, uneven voxels in which the tear has label 7.
fn segmentation() -> Scan {
    let turn = arthro_geometry::Rotation::from_euler_angles(0.2, -0.3, 0.4).to_rotation_matrix();
    let steps =
        turn.matrix() * Matrix3::from_diagonal(&arthro_geometry::Vector3::new(0.36, 0.36, 0.7));
    let size = [80, 80, 60];
    let middle = steps * arthro_geometry::Vector3::new(40.0, 40.0, 30.0);
    let lattice = Lattice::new(size, Point3::new(53.0, 60.0, 50.0) - middle, steps).unwrap();
    let mut values = Vec::new();
    for index in 0..size.iter().product::<usize>() {
        let cell = [index % 80, index / 80 % 80, index / 6400].map(|n| n as f64);
        let place = lattice.point(arthro_geometry::Vector3::from(cell));
        let torn = Phantom::default().is_torn(&place, &RadialTear::BODY);
        values.push(if torn { 7 } else { 0 });
    }
    Scan::new(lattice, scan::Voxels::U8(values)).unwrap()
}

#[test]
fn a_label_of_an_oblique_segmentation_is_the_tissue_that_has_it() {
    let (crescent, voxels) = model();
    let segmentation = segmentation();
    let lesion = Lesion::of_label(&segmentation, 7, &crescent, &voxels, 1.0).unwrap();
    let labels = scan::labels(&segmentation).unwrap();
    let share = lesion.volume_mm3() / labels[0].volume_mm3;
    assert!((share - 1.0).abs() < 0.1, "{share}");
    let refusal = refusal(Lesion::of_label(&segmentation, 8, &crescent, &voxels, 1.0));
    assert!(refusal.contains("no voxel has the label 8"), "{refusal}");
}

#[test]
fn a_label_beside_the_model_is_refused() {
    let mut mesh = phantom::mesh();
    for vertex in &mut mesh.vertices {
        vertex.y += 20.0;
    }
    let (crescent, voxels) = plan::model(&mesh, &phantom::PORTAL_ANTEROLATERAL, 0.5, 1.0).unwrap();
    let refusal = Lesion::of_label(&segmentation(), 7, &crescent, &voxels, 1.0);
    assert!(matches!(refusal, Err(Error::LesionOutsideModel { .. })));
}

#[test]
fn a_lesion_sent_as_points_in_ct_comes_back_the_same() {
    let (crescent, voxels) = model();
    let lesion = Lesion::near_points(&[on_top(0.3, 0.4)], 2.0, &crescent, &voxels, 1.0).unwrap();
    let sent = lesion.points_in_ct(&crescent);
    let back = Lesion::of(&sent, lesion.spacing_mm(), &crescent, &voxels, 1.0).unwrap();
    assert_eq!(back.points.len(), lesion.points.len());
    assert!((back.volume_mm3() - lesion.volume_mm3()).abs() < 1e-6);
    assert_eq!(back.marks, lesion.marks);
}
