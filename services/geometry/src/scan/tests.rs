use super::*;
use crate::nalgebra::Matrix3;

fn lattice(size: [usize; 3]) -> Lattice {
    let steps = Matrix3::new(0.0, -0.1, -0.7, 0.4, 0.0, 0.1, 0.0, -0.3, 0.0);
    Lattice::new(size, Point3::new(-6.0, 70.0, 3.0), steps).unwrap()
}

#[test]
fn a_point_has_the_index_it_came_from() {
    let lattice = lattice([4, 5, 6]);
    let index = Vector3::new(1.5, -2.0, 4.25);
    assert!((lattice.index(&lattice.point(index)) - index).norm() < 1e-12);
    let spacing = lattice.spacing_mm();
    assert!((spacing[0] - 0.4).abs() < 1e-12 && (spacing[2] - 0.5f64.sqrt()).abs() < 1e-12);
}

#[test]
fn a_lattice_is_refused_with_everything_that_is_wrong_with_it() {
    let steps = Matrix3::from_diagonal(&Vector3::new(0.0004, f64::NAN, 1.0));
    let origin = Point3::new(0.0, 1e9, 0.0);
    let error = Lattice::new([3, 0, 2], origin, steps).unwrap_err();
    let fields: Vec<&str> = error.faults.iter().map(|f| f.field.as_str()).collect();
    assert_eq!(fields, ["sizes[1]", "origin", "steps[0]", "steps[1]"]);
    assert!(
        error
            .to_string()
            .contains("is 0.0004 mm long, must be 0.01 to 50 mm")
    );
}

#[test]
fn steps_in_a_plane_are_refused() {
    let steps = Matrix3::new(1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.01);
    let error = Lattice::new([2, 2, 2], Point3::origin(), steps).unwrap_err();
    assert!(
        error.to_string().contains("must fill at least 0.1"),
        "{error}"
    );
}

#[test]
fn more_voxels_than_fit_are_refused() {
    for size in [[usize::MAX, 2, 2], [100_000, 100_000, 1]] {
        let error = Lattice::new(size, Point3::origin(), Matrix3::identity()).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("must be at most 536870912 voxels"),
            "{error}"
        );
    }
}

#[test]
fn a_scan_has_one_finite_value_a_voxel() {
    let error = Scan::new(lattice([2, 2, 2]), Voxels::U8(vec![0; 7])).unwrap_err();
    assert_eq!(error.to_string(), "voxels has 7 values, must have 8");
    let mut values = vec![0.0; 8];
    values[5] = f32::NAN;
    let error = Scan::new(lattice([2, 2, 2]), Voxels::F32(values)).unwrap_err();
    assert_eq!(error.to_string(), "voxels[5] is NaN, must be finite");
}

#[test]
fn labels_are_counted_and_placed() {
    let lattice = lattice([3, 2, 2]);
    let mut values = vec![0i16; 12];
    values[4] = -7;
    values[5] = -7;
    values[6] = 9;
    let scan = Scan::new(lattice.clone(), Voxels::I16(values)).unwrap();
    let [first, second] = &labels(&scan).unwrap()[..] else {
        panic!("two labels");
    };
    assert_eq!((first.value, first.voxels), (-7, 2));
    assert!((first.volume_mm3 - 2.0 * lattice.voxel_mm3()).abs() < 1e-12);
    let ends = [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0]].map(|i| lattice.point(Vector3::from(i)));
    assert_eq!(first.bounds, (ends[0].inf(&ends[1]), ends[0].sup(&ends[1])));
    assert_eq!((second.value, second.voxels), (9, 1));
}

#[test]
fn the_voxels_of_a_label_are_where_the_lattice_has_them() {
    let lattice = lattice([3, 2, 2]);
    let mut values = vec![0u8; 12];
    values[4] = 3;
    values[9] = 3;
    values[10] = 4;
    let scan = Scan::new(lattice.clone(), Voxels::U8(values)).unwrap();
    let expected = [[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]].map(|i| lattice.point(Vector3::from(i)));
    assert_eq!(label_points(&scan, 3).unwrap(), expected);
    for absent in [5, -3, 300] {
        assert_eq!(label_points(&scan, absent), Err(NoPoints::Absent(absent)));
    }
}

#[test]
fn a_label_of_too_many_voxels_is_not_listed() {
    let lattice = Lattice::new([1000, 501, 1], Point3::origin(), Matrix3::identity()).unwrap();
    let scan = Scan::new(lattice, Voxels::U8(vec![1; 501_000])).unwrap();
    assert_eq!(label_points(&scan, 1), Err(NoPoints::TooMany(1)));
}

#[test]
fn an_image_is_no_label_map() {
    let lattice = Lattice::new([50, 50, 2], Point3::origin(), Matrix3::identity()).unwrap();
    let scan = |voxels| Scan::new(lattice.clone(), voxels).unwrap();
    let fractions = (0..5000).map(|i| f64::from(i) / 8.0).collect();
    assert_eq!(
        labels(&scan(Voxels::F64(fractions))),
        Err(NoLabels::NotWhole(0.125))
    );
    let many = (0..5000).collect();
    assert_eq!(labels(&scan(Voxels::I32(many))), Err(NoLabels::TooMany));
}

#[test]
fn a_value_equals_a_number_only_if_its_type_holds_it() {
    assert_eq!(u8::exactly(255.0), Some(255));
    assert_eq!(u8::exactly(256.0), None);
    assert_eq!(i8::exactly(-128.5), None);
    assert_eq!(f32::exactly(0.1), None);
    assert_eq!(f64::exactly(f64::NAN), None);
}
