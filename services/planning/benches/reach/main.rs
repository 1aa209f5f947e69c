//! How long a shaft takes against a knee mesh of 32,768 faces, and a whole check of a bite.
//!
//! `ARTHRO_COLLISION=FILE` writes mesh, shafts and our answers as JSON, so that other libraries can be
//! measured on the same (`tests/bench/collision.py`).
#![allow(missing_docs, clippy::unwrap_used)]

mod knee;

use std::fmt::Write as _;
use std::hint::black_box;

use arthro_geometry::{Mesh, Point3, Vector3};
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::reach::{Bone, Capsule, Joint, Limits, Obstacle, Reach, Shaft};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};

const JAW: Jaw = Jaw {
    width_mm: 3.0,
    length_mm: 4.5,
    throat_mm: 1.0,
};
const POSES: usize = 2000;

fn shafts(poses: &[(Point3, Point3)]) -> Vec<Capsule> {
    let shaft = Shaft::forceps(&JAW);
    poses
        .iter()
        .map(|(portal, bite)| shaft.body(bite, &(bite - portal).normalize()))
        .collect()
}

fn shaft_against_mesh(criterion: &mut Criterion) {
    let mesh = knee::knee();
    let shafts = shafts(&knee::poses(POSES));
    let bone = Bone::of("knee", &Obstacle::Mesh(mesh.clone())).unwrap();
    if let Ok(file) = std::env::var("ARTHRO_COLLISION") {
        std::fs::write(file, json(&mesh, &shafts, &bone)).unwrap();
    }
    let mut group = criterion.benchmark_group("shaft");
    let mut next = shafts.iter().cycle();
    group.bench_function("intersection", |bencher| {
        bencher.iter(|| bone.touches(black_box(next.next().unwrap()), 0.0));
    });
    group.bench_function("distance", |bencher| {
        bencher.iter(|| bone.distance_mm(black_box(next.next().unwrap())));
    });
    group.bench_function("distance_exact", |bencher| {
        bencher.iter(|| bone.nearest(black_box(next.next().unwrap())).distance_mm);
    });
    group.sample_size(10);
    group.bench_function("build", |bencher| {
        bencher.iter_batched(
            || Obstacle::Mesh(mesh.clone()),
            |obstacle| Bone::of("knee", &obstacle).unwrap(),
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

fn bites(criterion: &mut Criterion) {
    let joint = Joint {
        femur: Some(Obstacle::Mesh(knee::femur())),
        tibia: Some(Obstacle::Mesh(knee::tibia())),
        opening_mm: 2.0,
    };
    let reach = Reach::of(&joint, Shaft::forceps(&JAW), Limits::default()).unwrap();
    let poses: Vec<(Point3, Bite)> = knee::poses(POSES)
        .into_iter()
        .map(|(portal, at)| {
            (
                portal,
                Bite::through(&portal, at, &Vector3::z(), at).unwrap(),
            )
        })
        .collect();
    let mut next = poses.iter().cycle();
    let mut group = criterion.benchmark_group("bite");
    group.bench_function("is_clear", |bencher| {
        bencher.iter(|| {
            let (portal, bite) = next.next().unwrap();
            reach.is_clear(black_box(portal), black_box(bite))
        });
    });
    group.bench_function("check", |bencher| {
        bencher.iter(|| {
            let (portal, bite) = next.next().unwrap();
            reach.check(black_box(portal), black_box(bite), &|_| false)
        });
    });
    group.finish();
}

/// Mesh, axes of the shafts with their radius, and our hits and distances.
fn json(mesh: &Mesh, shafts: &[Capsule], bone: &Bone) -> String {
    let point = |p: &Point3| format!("[{},{},{}]", p.x, p.y, p.z);
    let list = |items: Vec<String>| format!("[{}]", items.join(","));
    let vertices = list(mesh.vertices.iter().map(point).collect());
    let triangles = list(mesh.triangles.iter().map(|t| format!("{t:?}")).collect());
    let axes = shafts.iter().map(|shaft| {
        format!(
            "[{},{}]",
            point(&shaft.start),
            point(&shaft.at(shaft.length_mm))
        )
    });
    let axes = list(axes.collect());
    let hits = shafts
        .iter()
        .map(|shaft| bone.touches(shaft, 0.0).to_string());
    let hits = list(hits.collect());
    let distances = shafts
        .iter()
        .map(|shaft| bone.distance_mm(shaft).to_string());
    let distances = list(distances.collect());
    let mut text = String::new();
    let radius_mm = shafts[0].radius_mm;
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "{{\"vertices\":{vertices},\"triangles\":{triangles},\"radius_mm\":{radius_mm},\"axes\":{axes},\"hits\":{hits},\"distances_mm\":{distances}}}"
    );
    text
}

criterion_group!(benches, shaft_against_mesh, bites);
criterion_main!(benches);
