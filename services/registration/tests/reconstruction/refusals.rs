//! What cannot be reconstructed is refused by field, value and limit.

use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::scan::{Lattice, Scan, Voxels};
use arthro_geometry::{Point3, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::error::Error;
use arthro_registration::reconstruct::{Decimation, Inside, Options, reconstruct};

fn scan(voxels: Voxels) -> Scan {
    let steps = Matrix3::from_diagonal(&Vector3::repeat(0.5));
    let lattice = Lattice::new([4, 4, 4], Point3::origin(), steps).unwrap();
    Scan::new(lattice, voxels).unwrap()
}

fn refusal(scan: &Scan, options: &Options) -> String {
    let outcome = reconstruct(scan, options, &Budget::default());
    outcome.unwrap_err().to_string()
}

fn mixed() -> Vec<u8> {
    (0..64).map(|i| if i == 21 { 5 } else { i % 3 }).collect()
}

#[test]
fn an_absent_label_is_refused_with_the_labels_there_are() {
    let labels = scan(Voxels::U8(mixed()));
    for label in [4, -5, 256, i64::MAX] {
        let said = refusal(&labels, &Options::new(Inside::Label(label)));
        assert_eq!(said, format!("label: is {label}, there are 1, 2, 5"));
    }
    let empty = scan(Voxels::U8(vec![0; 64]));
    let said = refusal(&empty, &Options::new(Inside::Label(1)));
    assert_eq!(said, "label: is 1, there are none but the background 0");
    let fractions = scan(Voxels::F32((0..64u8).map(|i| f32::from(i) / 3.0).collect()));
    let said = refusal(&fractions, &Options::new(Inside::Label(200)));
    assert!(said.contains("reconstruct it by a threshold"), "{said}");
}

#[test]
fn a_threshold_that_all_voxels_are_on_one_side_of_is_refused() {
    let image = scan(Voxels::I16((-30..34).collect()));
    for threshold in [-30.0, -31.0, 33.5] {
        let said = refusal(&image, &Options::new(Inside::Threshold(threshold)));
        let expected = format!(
            "threshold: is {threshold}, the values are -30 to 33; must be greater than -30 and at most 33"
        );
        assert_eq!(said, expected);
    }
}

#[test]
fn options_are_refused_all_at_once() {
    let options = Options {
        inside: Inside::Label(0),
        min_piece_share: 1.5,
        smoothing_passes: Some(5000),
        decimation: Decimation::Triangles(3),
    };
    let said = refusal(&scan(Voxels::U8(mixed())), &options);
    assert_eq!(
        said,
        "label: is 0, the background; must be another label; \
         smoothing_passes: is 5000, must be at most 1000; \
         min_piece_share: is 1.5, must be 0 to 1; \
         triangles: is 3, must be at least 100"
    );
    for decimation in [Decimation::WithinMm(-1.0), Decimation::WithinMm(f64::NAN)] {
        let options = Options {
            inside: Inside::Threshold(f64::INFINITY),
            decimation,
            ..options
        };
        let said = refusal(&scan(Voxels::U8(mixed())), &options);
        assert!(said.contains("threshold: is inf, must be finite"), "{said}");
        assert!(said.contains("max_error_mm: is"), "{said}");
    }
}

#[test]
fn a_surface_through_noise_is_refused_before_it_fills_the_memory() {
    let size = [400, 200, 60];
    let lattice = Lattice::new(size, Point3::origin(), Matrix3::identity()).unwrap();
    let checkerboard =
        (0..lattice.len()).map(|i| ((i % 400 + i / 400 % 200 + i / 80_000) % 2) as u8);
    let scan = Scan::new(lattice.clone(), Voxels::U8(checkerboard.collect())).unwrap();
    let said = refusal(&scan, &Options::new(Inside::Label(1)));
    assert!(said.contains("more than 1800000 voxel faces"), "{said}");
}

#[test]
fn a_cancelled_reconstruction_stops() {
    let budget = Budget::default();
    budget.cancel();
    let labels = scan(Voxels::U8(mixed()));
    let outcome = reconstruct(&labels, &Options::new(Inside::Label(1)), &budget);
    assert!(matches!(outcome, Err(Error::Cancelled)));
}
