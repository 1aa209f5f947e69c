//! A knee of 32,768 faces: a femur like a ball over a tibia like a slab, each a superellipsoid of
//! 16,384 faces. And shafts that come in from in front of it.

use arthro_geometry::{Mesh, Point3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Columns of faces around the vertical axis.
const COLUMNS: u32 = 128;
/// Rings of vertices between the poles.
const RINGS: u32 = 64;
/// The femur's middle over the joint line, mm, and its radius, mm.
pub const FEMUR: (f64, f64) = (32.0, 24.0);

/// A closed ball.
pub fn ball(center: Point3, radius_mm: f64) -> Mesh {
    superellipsoid(center, Vector3::repeat(radius_mm), 1.0)
}

/// The femur of the knee.
pub fn femur() -> Mesh {
    ball(Point3::new(0.0, 0.0, FEMUR.0), FEMUR.1)
}

/// The tibia of the knee: a slab whose top is the joint line.
pub fn tibia() -> Mesh {
    let half_mm = Vector3::new(36.0, 36.0, 8.0);
    superellipsoid(Point3::new(0.0, 0.0, -half_mm.z), half_mm, 0.3)
}

/// Both as one mesh.
pub fn knee() -> Mesh {
    let mut knee = femur();
    let tibia = tibia();
    let first = knee.vertices.len() as u32;
    let shifted = tibia
        .triangles
        .iter()
        .map(|corners| corners.map(|corner| corner + first));
    knee.triangles.extend(shifted);
    knee.vertices.extend(tibia.vertices);
    knee
}

/// Portals in front of the knee and bites in it, mm, always the same.
pub fn poses(count: usize) -> Vec<(Point3, Point3)> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut place = |low: [f64; 3], high: [f64; 3]| {
        Point3::from([0, 1, 2].map(|axis| random.random_range(low[axis]..high[axis])))
    };
    (0..count)
        .map(|_| {
            let portal = place([-25.0, -52.0, 6.0], [25.0, -44.0, 16.0]);
            let bite = place([-20.0, -20.0, 1.0], [20.0, 20.0, 6.0]);
            (portal, bite)
        })
        .collect()
}

/// |x/a|^(2/e) + |y/b|^(2/e) + |z/c|^(2/e) = 1 with exponent e: 1 is an ellipsoid, towards 0 a box.
fn superellipsoid(center: Point3, half_mm: Vector3, exponent: f64) -> Mesh {
    let power = |value: f64| value.signum() * value.abs().powf(exponent);
    let on_ring = |ring: u32, column: u32| {
        let (sin_v, cos_v) =
            (std::f64::consts::PI * f64::from(ring + 1) / f64::from(RINGS + 1)).sin_cos();
        let (sin_u, cos_u) =
            (std::f64::consts::TAU * f64::from(column) / f64::from(COLUMNS)).sin_cos();
        let unit = Vector3::new(
            power(sin_v) * power(cos_u),
            power(sin_v) * power(sin_u),
            power(cos_v),
        );
        center + half_mm.component_mul(&unit)
    };
    let mut vertices: Vec<Point3> = (0..RINGS)
        .flat_map(|ring| (0..COLUMNS).map(move |column| (ring, column)))
        .map(|(ring, column)| on_ring(ring, column))
        .collect();
    let (top, bottom) = (RINGS * COLUMNS, RINGS * COLUMNS + 1);
    vertices.push(center + Vector3::z() * half_mm.z);
    vertices.push(center - Vector3::z() * half_mm.z);
    let at = |ring: u32, column: u32| ring * COLUMNS + column % COLUMNS;
    let mut triangles = Vec::new();
    for column in 0..COLUMNS {
        triangles.push([top, at(0, column), at(0, column + 1)]);
        triangles.push([bottom, at(RINGS - 1, column + 1), at(RINGS - 1, column)]);
        for ring in 0..RINGS - 1 {
            let (a, b) = (at(ring, column), at(ring, column + 1));
            let (c, d) = (at(ring + 1, column), at(ring + 1, column + 1));
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    Mesh {
        vertices,
        triangles,
    }
}
