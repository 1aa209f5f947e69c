//! Fresh views of every mesh of the data folder, as the cell's camera gives them: 350 mm away, tilted, 0.3 mm of noise.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::phantom;
use arthro_geometry::ply::{Space, Stated, Unit, read_mesh};
use arthro_geometry::{Cloud, Mesh, Point3, Rotation, Similarity, Vector3};
use arthro_registration::pipeline::Options;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::world::{Case, data, seen};

/// Meshes and the direction that the femur is in.
const MESHES: [(&str, [f64; 3]); 4] = [
    ("smith2019_R_lateral_meniscus.ply", [0.0, 1.0, 0.0]),
    ("smith2019_R_medial_meniscus.ply", [0.0, 1.0, 0.0]),
    ("pymskt_lateral_meniscus.ply", [0.0, 0.0, 1.0]),
    ("pymskt_medial_meniscus.ply", [0.0, 0.0, 1.0]),
];
const VIEWS_PER_MESH: u64 = 6;

#[test]
fn the_phantom_is_registered_within_a_millimetre_from_fresh_views() {
    for view in 0..VIEWS_PER_MESH {
        solve(&fresh_view("phantom", &phantom::mesh(), Vector3::x(), view));
    }
}

#[test]
fn every_mesh_is_registered_within_a_millimetre_from_fresh_views() {
    let Some(folder) = data() else { return };
    for (name, superior) in MESHES {
        let bytes = std::fs::read(folder.join("menisci").join(name)).unwrap();
        let stated = Stated {
            space: Space::Lps,
            unit: Unit::Millimetre,
        };
        let mesh = read_mesh(&bytes, Some(stated)).unwrap();
        for view in 0..VIEWS_PER_MESH {
            solve(&fresh_view(name, &mesh, Vector3::from(superior), view));
        }
    }
}

fn solve(case: &Case) {
    let outcome = case.solve();
    let answer = &outcome.answer;
    eprintln!(
        "{}: {} points, TRE {:.3} mm, {:.2} s, ambiguity {:.2}, {:?} {:?}",
        case.name,
        case.target.points.len(),
        outcome.tre_mm,
        outcome.seconds,
        answer.evidence.ambiguity,
        answer.verdict,
        answer.reasons
    );
    assert!(
        outcome.tre_mm < 1.0,
        "{}: TRE {:.2} mm",
        case.name,
        outcome.tre_mm
    );
    assert!(answer.mse_mm2 < answer.coarse_mse_mm2);
}

fn fresh_view(name: &str, mesh: &Mesh, superior: Vector3, seed: u64) -> Case {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let surface = samples(mesh, 0.15);
    let middle = surface.iter().map(|p| p.coords).sum::<Vector3>() / surface.len() as f64;
    let aside = superior.cross(&random_direction(&mut rng)).normalize();
    let tilt = Rotation::new(aside * rng.random_range(25f64..45.0).to_radians());
    let viewpoint = Point3::from(middle + tilt * superior * 350.0);
    let view = seen(&surface, viewpoint, 0.7, || 0.3 * gauss(&mut rng));
    let truth = Similarity::<Camera, Ct>::new(
        1.0,
        Rotation::new(random_direction(&mut rng) * rng.random_range(0.0..3.1)),
        random_direction(&mut rng) * 200.0,
    );
    Case {
        name: format!("{name} view {seed}"),
        mesh: name.to_owned(),
        source: Cloud::new(mesh.vertices.clone()),
        target: Cloud::new(view.points.iter().map(|p| truth * *p).collect()),
        options: Options {
            viewpoint: Some(truth * viewpoint),
            seed,
            ..Options::default()
        },
        truth,
        centroid: Point3::from(middle),
    }
}

/// Points of the mesh no farther apart than `spacing_mm`.
fn samples(mesh: &Mesh, spacing_mm: f64) -> Vec<Point3> {
    let mut points = Vec::new();
    for index in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(index);
        let longest = (b - a).norm().max((c - a).norm()).max((c - b).norm());
        let steps = (longest / spacing_mm).ceil() as i32;
        for i in 0..=steps {
            for j in 0..=steps - i {
                let (u, v) = (
                    f64::from(i) / f64::from(steps),
                    f64::from(j) / f64::from(steps),
                );
                points.push(a + (b - a) * u + (c - a) * v);
            }
        }
    }
    points
}

fn random_direction(rng: &mut ChaCha8Rng) -> Vector3 {
    Vector3::from_fn(|_, _| gauss(rng)).normalize()
}

/// A standard normal deviate (Box and Muller).
fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (
        rng.random_range(1e-12..1.0),
        rng.random_range(0.0..std::f64::consts::TAU),
    );
    (-2.0 * u.ln()).sqrt() * v.cos()
}
