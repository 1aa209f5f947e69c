//! Shapes by formula, and the scans a machine would make of them.

use std::f64::consts::PI;

use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::scan::{Lattice, Scan, Voxels};
use arthro_geometry::{Mesh, Point3, Rotation, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::reconstruct::{Options, Reconstruction, reconstruct};

/// The label of a shape in [`label_map`].
pub const LABEL: i64 = 3;
/// The value on the surface in [`image`].
pub const LEVEL: f64 = 100.0;

/// A solid given by the distance to its surface, mm: negative inside, never more than the true one.
pub struct Shape {
    pub name: &'static str,
    pub volume_mm3: f64,
    pub distance_mm: fn(&Point3) -> f64,
}

/// Radius 9 mm.
pub const SPHERE: Shape = Shape {
    name: "sphere",
    volume_mm3: 4.0 / 3.0 * PI * 729.0,
    distance_mm: |p| p.coords.norm() - 9.0,
};

/// Radii 8 and 3 mm, about z.
pub const TORUS: Shape = Shape {
    name: "torus",
    volume_mm3: 2.0 * PI * PI * 8.0 * 9.0,
    distance_mm: |p| (p.x.hypot(p.y) - 8.0).hypot(p.z) - 3.0,
};

/// Two caps, 2 mm high, of spheres of 24 mm: a wedge of 47 degrees all around, like a meniscus at its rim.
pub const LENS: Shape = Shape {
    name: "lens",
    volume_mm3: 2.0 * PI * 4.0 * (24.0 - 2.0 / 3.0),
    distance_mm: |p| {
        let to_sphere = |z: f64| Vector3::new(p.x, p.y, p.z - z).norm() - 24.0;
        to_sphere(22.0).max(to_sphere(-22.0))
    },
};

/// A lattice around the origin with steps of `spacing_mm`, turned by `turn`; the origin lies between voxels.
pub fn lattice(spacing_mm: [f64; 3], turn: Vector3) -> Lattice {
    let rotation = Rotation::from_scaled_axis(turn).to_rotation_matrix();
    let steps = rotation.into_inner() * Matrix3::from_diagonal(&Vector3::from(spacing_mm));
    around_origin(spacing_mm, steps)
}

/// A lattice around the origin with these steps.
pub fn around_origin(spacing_mm: [f64; 3], steps: Matrix3<f64>) -> Lattice {
    let size = spacing_mm.map(|step| 2 * (14.0 / step).ceil() as usize + 1);
    let middle = Vector3::from(size.map(|count| (count / 2) as f64 + 0.137));
    Lattice::new(size, Point3::from(-steps * middle), steps).unwrap()
}

/// Lattices as scanners make them: cubes, an oblique stack of thick slices, one that is left-handed, a sheared one.
pub fn lattices() -> Vec<Lattice> {
    let oblique = Vector3::new(0.3, -0.5, 0.9);
    let [cubes, slices] = [[0.5; 3], [0.36, 0.36, 0.7]];
    let mut mirrored = *lattice(slices, oblique).steps();
    mirrored.swap_columns(0, 2);
    let mut sheared = *lattice(slices, oblique).steps();
    let tilted = sheared.column(2) + sheared.column(1) * 0.5;
    sheared.set_column(2, &tilted);
    vec![
        lattice(cubes, Vector3::zeros()),
        lattice(slices, oblique),
        around_origin([0.7, 0.36, 0.36], mirrored),
        around_origin([0.36, 0.3, 0.6], sheared),
    ]
}

fn each_voxel<T>(lattice: &Lattice, value: impl Fn(&Point3) -> T) -> Vec<T> {
    let [columns, rows, slices] = lattice.size();
    let mut values = Vec::with_capacity(lattice.len());
    for k in 0..slices {
        for j in 0..rows {
            for i in 0..columns {
                let index = Vector3::new(i as f64, j as f64, k as f64);
                values.push(value(&lattice.point(index)));
            }
        }
    }
    values
}

/// [`LABEL`] where the shape is, another label in a corner.
pub fn label_map(shape: &Shape, lattice: &Lattice) -> Scan {
    let is_inside = |p: &Point3| (shape.distance_mm)(p) <= 0.0;
    let mut values = each_voxel(lattice, |p| if is_inside(p) { LABEL as u8 } else { 0 });
    values[0] = 7;
    Scan::new(lattice.clone(), Voxels::U8(values)).unwrap()
}

/// [`LEVEL`] on the surface and brighter inside.
pub fn image(shape: &Shape, lattice: &Lattice) -> Scan {
    let values = each_voxel(lattice, |p| (LEVEL - 40.0 * (shape.distance_mm)(p)) as f32);
    Scan::new(lattice.clone(), Voxels::F32(values)).unwrap()
}

/// Reconstructs without being stopped.
pub fn surface(scan: &Scan, options: &Options) -> Reconstruction {
    reconstruct(scan, options, &Budget::default()).unwrap()
}

/// Distances of the vertices from the true surface, mm.
pub fn distances_mm(mesh: &Mesh, shape: &Shape) -> Vec<f64> {
    let distance = |p: &Point3| (shape.distance_mm)(p).abs();
    mesh.vertices.iter().map(distance).collect()
}

pub fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

pub fn root_mean_square(values: &[f64]) -> f64 {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (squares / values.len() as f64).sqrt()
}

/// Root mean square angle between the normals of the vertices and those of the true surface, degrees.
pub fn normal_error_deg(mesh: &Mesh, shape: &Shape) -> f64 {
    const STEP_MM: f64 = 1e-4;
    let slope = |p: &Point3, axis: usize| {
        let mut step = Vector3::zeros();
        step[axis] = STEP_MM;
        (shape.distance_mm)(&(p + step)) - (shape.distance_mm)(&(p - step))
    };
    let normals = mesh.vertex_normals();
    let angles = mesh.vertices.iter().zip(&normals).map(|(p, normal)| {
        let truth = Vector3::new(slope(p, 0), slope(p, 1), slope(p, 2));
        truth.angle(normal).to_degrees()
    });
    root_mean_square(&angles.collect::<Vec<_>>())
}
