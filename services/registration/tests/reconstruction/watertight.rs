//! Whatever the voxels are, the surface is closed and manifold and has their volume.

use std::collections::BTreeMap;

use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::scan::{Lattice, Scan, Voxels};
use arthro_geometry::{Mesh, Point3};
use arthro_registration::reconstruct::{Decimation, Inside, Options};
use proptest::prelude::*;

use crate::shapes::surface;

const SIZE: [usize; 3] = [7, 6, 5];

fn scan(voxels: Voxels) -> Scan {
    let steps = Matrix3::new(0.0, -0.4, 0.1, 0.5, 0.0, 0.0, 0.0, 0.1, -0.8);
    let lattice = Lattice::new(SIZE, Point3::new(-20.0, 7.0, 3.0), steps).unwrap();
    Scan::new(lattice, voxels).unwrap()
}

fn labels(marks: &[bool]) -> Scan {
    scan(Voxels::I16(
        marks
            .iter()
            .map(|mark| if *mark { 12 } else { 4 })
            .collect(),
    ))
}

/// Every vertex is the middle of one fan of triangles: the surface is nowhere pinched to a point.
fn has_one_fan_a_vertex(mesh: &Mesh) -> bool {
    let mut following: Vec<BTreeMap<u32, u32>> = vec![BTreeMap::new(); mesh.vertices.len()];
    for [a, b, c] in &mesh.triangles {
        for (middle, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
            following[*middle as usize].insert(*from, *to);
        }
    }
    following.iter().all(|around| {
        let Some((&first, _)) = around.first_key_value() else {
            return false;
        };
        let (mut steps, mut at) = (1, around[&first]);
        while at != first {
            at = around[&at];
            steps += 1;
        }
        steps == around.len()
    })
}

/// How often a voxel is marked: blobs, sponges and checkerboards.
fn marks() -> impl Strategy<Value = Vec<bool>> {
    let count = SIZE.iter().product::<usize>();
    (1u8..=9).prop_flat_map(move |tenths| {
        prop::collection::vec((0u8..10).prop_map(move |draw| draw < tenths), count)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_label_map_has_a_watertight_surface_of_its_volume(
        marks in marks().prop_filter("no voxel", |marks| marks.contains(&true)),
        passes in 0u32..30,
    ) {
        let scan = labels(&marks);
        let options = Options {
            inside: Inside::Label(12),
            min_piece_share: 0.0,
            smoothing_passes: Some(passes),
            decimation: Decimation::None,
        };
        let surface = surface(&scan, &options);
        prop_assert!(surface.mesh.is_watertight());
        prop_assert!(has_one_fan_a_vertex(&surface.mesh));
        prop_assert!(surface.mesh.volume_mm3() > 0.0);
        let voxels = marks.iter().filter(|mark| **mark).count();
        let volume_mm3 = voxels as f64 * scan.lattice().voxel_mm3();
        prop_assert!((surface.voxel_volume_mm3 - volume_mm3).abs() < 1e-6 * volume_mm3);
    }

    #[test]
    fn decimation_and_dropped_pieces_leave_it_watertight(
        marks in marks().prop_filter("no voxel", |marks| marks.contains(&true)),
        triangles in 100usize..300,
        min_piece_share in 0.0..=1.0f64,
    ) {
        let options = Options {
            inside: Inside::Label(12),
            min_piece_share,
            smoothing_passes: None,
            decimation: Decimation::Triangles(triangles),
        };
        let surface = surface(&labels(&marks), &options);
        prop_assert!(surface.mesh.is_watertight());
        prop_assert!(has_one_fan_a_vertex(&surface.mesh));
        prop_assert!(surface.mesh.volume_mm3() > 0.0);
    }

    #[test]
    fn any_image_has_a_watertight_surface_at_any_threshold_within_its_values(
        values in prop::collection::vec(any::<i16>(), SIZE.iter().product::<usize>()),
        share in 0.0..1.0f64,
    ) {
        let (low, high) = (*values.iter().min().unwrap(), *values.iter().max().unwrap());
        let threshold = f64::from(high) - share * (f64::from(high) - f64::from(low));
        let options = Options {
            min_piece_share: 0.0,
            decimation: Decimation::None,
            ..Options::new(Inside::Threshold(threshold))
        };
        prop_assume!(threshold > f64::from(low));
        let surface = surface(&scan(Voxels::I16(values)), &options);
        prop_assert!(surface.mesh.is_watertight());
        prop_assert!(has_one_fan_a_vertex(&surface.mesh));
        prop_assert!(surface.mesh.volume_mm3() > 0.0);
    }
}

#[test]
fn voxels_that_touch_at_an_edge_or_a_corner_are_apart() {
    for other in [[1, 1, 0], [1, 1, 1], [0, 1, 1]] {
        let mut marks = vec![false; SIZE.iter().product()];
        let at = |[i, j, k]: [usize; 3]| i + SIZE[0] * (j + SIZE[1] * k);
        marks[at([2, 2, 1])] = true;
        marks[at([2, 2, 2])] = true;
        marks[at([2 + other[0], 2 + other[1], 2 + other[2]])] = true;
        let with = |min_piece_share| {
            let options = Options {
                min_piece_share,
                smoothing_passes: Some(0),
                decimation: Decimation::None,
                ..Options::new(Inside::Label(12))
            };
            surface(&labels(&marks), &options)
        };
        assert_eq!(with(0.0).mesh.triangles.len(), 2 * (10 + 6));
        let largest = with(1.0);
        assert_eq!(
            (largest.mesh.triangles.len(), largest.dropped_pieces),
            (2 * 10, 1)
        );
    }
}

#[test]
fn lone_voxels_and_thin_sheets_keep_their_volume() {
    let at = |[i, j, k]: [usize; 3]| i + SIZE[0] * (j + SIZE[1] * k);
    let mut lone = vec![false; SIZE.iter().product()];
    lone[at([3, 3, 2])] = true;
    let mut sheet = lone.clone();
    let mut thread = lone.clone();
    for i in 1..6 {
        thread[at([i, 3, 2])] = true;
        for j in 1..5 {
            sheet[at([i, j, 2])] = true;
        }
    }
    for marks in [lone, sheet, thread] {
        let surface = surface(&labels(&marks), &Options::new(Inside::Label(12)));
        let off = surface.mesh.volume_mm3() / surface.voxel_volume_mm3 - 1.0;
        assert!(off.abs() < 0.01, "{off}");
    }
}

#[test]
fn a_cavity_is_kept_or_filled_as_asked() {
    let mut marks = vec![true; SIZE.iter().product()];
    marks[3 + SIZE[0] * (3 + SIZE[1] * 2)] = false;
    let with = |min_piece_share| {
        surface(
            &labels(&marks),
            &Options {
                min_piece_share,
                ..Options::new(Inside::Label(12))
            },
        )
    };
    let voxel_mm3 = labels(&marks).lattice().voxel_mm3();
    let cavity = with(1.0).voxel_volume_mm3 - with(0.0).voxel_volume_mm3;
    assert!((cavity - voxel_mm3).abs() < 1e-9);
    assert_eq!(with(1.0).dropped_pieces, 1);
}

#[test]
fn what_reaches_the_border_is_closed_there_and_noted() {
    let all = labels(&vec![true; SIZE.iter().product()]);
    let options = Options {
        smoothing_passes: Some(0),
        decimation: Decimation::None,
        ..Options::new(Inside::Label(12))
    };
    let surface = surface(&all, &options);
    assert!(surface.touches_border && surface.mesh.is_watertight());
    // Half a voxel beyond the middles of the outermost voxels.
    let lattice = all.lattice();
    for vertex in &surface.mesh.vertices {
        let index = lattice.index(vertex);
        for axis in 0..3 {
            let beyond = (-index[axis]).max(index[axis] - (SIZE[axis] - 1) as f64);
            assert!(beyond <= 0.5 + 1e-5, "{beyond}");
        }
    }
}
