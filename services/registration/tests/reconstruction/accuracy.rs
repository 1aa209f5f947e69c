//! How near reconstructed surfaces come to the true ones, in voxels: the cube root of a voxel's volume.

use arthro_geometry::scan::Lattice;
use arthro_registration::reconstruct::{Decimation, Inside, Options, sample};

use crate::shapes::*;

const OF_LABEL: Options = Options {
    inside: Inside::Label(LABEL),
    min_piece_share: 0.0,
    smoothing_passes: None,
    decimation: Decimation::None,
};
const OF_IMAGE: Options = Options {
    inside: Inside::Threshold(LEVEL),
    ..OF_LABEL
};

fn voxel_mm(lattice: &Lattice) -> f64 {
    lattice.voxel_mm3().cbrt()
}

/// Longest way across a voxel, mm: a label map cannot place a sharp rim more exactly.
fn across_mm(lattice: &Lattice) -> f64 {
    lattice.spacing_mm().iter().sum()
}

#[test]
fn a_label_becomes_its_surface_on_every_lattice() {
    for shape in [&SPHERE, &TORUS, &LENS] {
        for lattice in lattices() {
            let (voxel, name) = (voxel_mm(&lattice), shape.name);
            let surface = surface(&label_map(shape, &lattice), &OF_LABEL);
            assert!(surface.mesh.is_watertight());
            let distances = distances_mm(&surface.mesh, shape);
            let spread = root_mean_square(&distances) / voxel;
            assert!(spread < 0.15, "{name}: {spread} voxels");
            assert!(
                largest(&distances) < across_mm(&lattice) / 2.0,
                "{name}: {}",
                largest(&distances)
            );
            // The volume is that of the voxels, and theirs that of the shape up to their number.
            let off = surface.mesh.volume_mm3() / surface.voxel_volume_mm3 - 1.0;
            assert!(off.abs() < 1e-3, "{name}: {off}");
            let off_mm = (surface.mesh.volume_mm3() - shape.volume_mm3) / surface.mesh.area_mm2();
            assert!(off_mm.abs() < 0.05 * voxel, "{name}: {off_mm}");
        }
    }
}

#[test]
fn a_threshold_becomes_its_surface_far_below_a_voxel() {
    for shape in [&SPHERE, &TORUS] {
        for lattice in lattices() {
            let (voxel, name) = (voxel_mm(&lattice), shape.name);
            let surface = surface(&image(shape, &lattice), &OF_IMAGE);
            assert!(surface.mesh.is_watertight());
            let distances = distances_mm(&surface.mesh, shape);
            assert!(
                largest(&distances) < 0.1 * voxel,
                "{name}: {}",
                largest(&distances)
            );
            let off_mm = (surface.mesh.volume_mm3() - shape.volume_mm3) / surface.mesh.area_mm2();
            assert!(off_mm.abs() < 0.05 * voxel, "{name}: {off_mm}");
        }
    }
}

#[test]
fn smoothing_takes_the_steps_off_and_keeps_the_volume() {
    let lattice = lattice([0.36, 0.36, 0.7], [0.1, 0.2, 0.3].into());
    for shape in [&SPHERE, &TORUS] {
        let scan = label_map(shape, &lattice);
        let with = |passes| {
            surface(
                &scan,
                &Options {
                    smoothing_passes: Some(passes),
                    ..OF_LABEL
                },
            )
        };
        let (steps, smooth) = (with(0), surface(&scan, &OF_LABEL));
        let [before, after] = [&steps, &smooth].map(|s| normal_error_deg(&s.mesh, shape));
        assert!(
            after < before / 3.0,
            "{}: {after} of {before} deg",
            shape.name
        );
        let [before, after] =
            [&steps, &smooth].map(|s| root_mean_square(&distances_mm(&s.mesh, shape)));
        assert!(
            after < 0.6 * before,
            "{}: {after} of {before} mm",
            shape.name
        );
        // No end of smoothing shrinks it.
        let volume = with(400).mesh.volume_mm3();
        assert!((volume / smooth.voxel_volume_mm3 - 1.0).abs() < 1e-3);
    }
}

#[test]
fn a_smoothed_surface_still_tells_the_voxels_apart() {
    // No vertex leaves the cell between its eight voxels, so that none passes a voxel's middle.
    let lattice = lattice([0.5; 3], [0.0; 3].into());
    let scan = label_map(&TORUS, &lattice);
    let with = |passes| {
        surface(
            &scan,
            &Options {
                smoothing_passes: Some(passes),
                ..OF_LABEL
            },
        )
    };
    let (steps, smooth) = (with(0), with(1000));
    for (before, after) in steps.mesh.vertices.iter().zip(&smooth.mesh.vertices) {
        let moved = lattice.index(after) - lattice.index(before);
        assert!(moved.amax() < 1.0 + 1e-6, "{moved}");
        let cell = lattice.index(before).map(f64::floor);
        let within = lattice.index(after) - cell;
        assert!(
            within.min() > -1e-5 && within.max() < 1.0 + 1e-5,
            "{within}"
        );
    }
}

#[test]
fn decimation_stays_within_its_error_and_reaches_its_target() {
    let lattice = lattice([0.36, 0.36, 0.7], [0.1, 0.2, 0.3].into());
    for shape in [&SPHERE, &TORUS, &LENS] {
        let scan = label_map(shape, &lattice);
        let with = |decimation| {
            surface(
                &scan,
                &Options {
                    decimation,
                    ..OF_LABEL
                },
            )
        };
        let full = with(Decimation::None);
        assert_eq!(full.max_deviation_mm, 0.0);
        let mut before = full.mesh.triangles.len();
        for limit_mm in [0.02, 0.05, 0.1] {
            let fewer = with(Decimation::WithinMm(limit_mm));
            assert!(fewer.mesh.triangles.len() < before, "{}", shape.name);
            before = fewer.mesh.triangles.len();
            assert!(
                fewer.max_deviation_mm <= limit_mm,
                "{}",
                fewer.max_deviation_mm
            );
            assert!(fewer.mesh.is_watertight());
        }
        for target in [4000, 1001, 200] {
            let fewer = with(Decimation::Triangles(target));
            let count = fewer.mesh.triangles.len();
            assert!(
                count <= target && count + 2 > target,
                "{}: {count}",
                shape.name
            );
            assert!(fewer.mesh.is_watertight());
            let off = fewer.mesh.volume_mm3() / full.mesh.volume_mm3() - 1.0;
            assert!(off.abs() < 1e-3, "{}: {off} at {target}", shape.name);
        }
    }
}

#[test]
fn the_same_scan_gives_the_same_mesh_on_any_number_of_threads() {
    let scan = label_map(&LENS, &lattice([0.5; 3], [0.2; 3].into()));
    let options = Options::new(Inside::Label(LABEL));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| surface(&scan, &options))
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn a_sampled_cloud_lies_on_the_surface_evenly_with_its_normals() {
    let scan = label_map(&SPHERE, &lattice([0.5; 3], [0.0; 3].into()));
    let mesh = surface(&scan, &OF_LABEL).mesh;
    let cloud = sample(&mesh, 5000);
    assert_eq!((cloud.points.len(), cloud.normals.len()), (5000, 5000));
    for (point, normal) in cloud.points.iter().zip(&cloud.normals) {
        assert!((SPHERE.distance_mm)(point).abs() < 0.1);
        assert!(normal.dot(&point.coords.normalize()) > 0.98);
        assert!((normal.norm() - 1.0).abs() < 1e-9);
    }
    // Each of 8 octants holds an eighth of the points, and each of 3 slices of equal height a third (Archimedes).
    let octant = |p: &arthro_geometry::Point3| p.x > 0.0 && p.y > 0.0 && p.z > 0.0;
    let count = cloud.points.iter().filter(|p| octant(p)).count();
    assert!((560..690).contains(&count), "{count}");
    let count = cloud.points.iter().filter(|p| p.z.abs() < 3.0).count();
    assert!((1580..1750).contains(&count), "{count}");
}
