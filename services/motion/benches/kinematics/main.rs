//! How long forward and inverse kinematics take over poses at random: `cargo bench -p arthro-motion --bench kinematics`.
//!
//! `ARTHRO_KINEMATICS=FOLDER` also writes joints and poses for other libraries (`tests/bench/kinematics.py`) and the
//! account of our own inverse over a million of each make.
#![allow(missing_docs, clippy::unwrap_used)]

mod sweep;

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;

use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_motion::kinematics::dh::Dh;
use arthro_motion::kinematics::flange_pose::FlangePose;
use arthro_motion::kinematics::model::{Make, Model};
use arthro_motion::kinematics::{Joints, ToolArm};
use criterion::{Criterion, criterion_group, criterion_main};
use sweep::Sweep;

const POSES: usize = 4096;
/// Poses that other libraries are asked.
const WRITTEN: usize = 100_000;
/// Rounds of which the best counts.
const ROUNDS: usize = 300;
/// Poses that ours is asked.
const ACCOUNTED: usize = 1_000_000;

fn drawn(criterion: &mut Criterion) {
    if let Some(folder) = std::env::var_os("ARTHRO_KINEMATICS") {
        write(Path::new(&folder)).unwrap();
    }
    measure(criterion, "drawn", Model::ur5());
}

fn calibrated(criterion: &mut Criterion) {
    let drawn = Dh::nominal(&Make::Ur5.links());
    let off = Dh {
        theta_rad: [1e-3, -0.5e-3, 0.8e-3, 0.3e-3, -1.1e-3, 0.2e-3],
        a_mm: [0.1, -0.4, 0.6, 0.2, -0.1, 0.05],
        d_mm: [0.3, 0.5, -0.4, 0.2, -0.6, 0.1],
        alpha_rad: [0.4e-3, -1e-3, 0.7e-3, -0.3e-3, 0.9e-3, 0.0],
    };
    measure(
        criterion,
        "calibrated",
        Model::ur5().calibrated(&drawn.plus(&off)).unwrap(),
    );
}

fn measure(criterion: &mut Criterion, name: &str, model: Model) {
    let mut sweep = Sweep(3);
    let joints: Vec<Joints> = (0..POSES).map(|_| sweep.joints()).collect();
    let poses: Vec<FlangePose> = joints.iter().map(|joints| model.forward(joints)).collect();
    let rigid: Vec<Rigid<Base, Flange>> = poses.iter().map(|pose| (*pose).into()).collect();
    let mut group = criterion.benchmark_group(name);
    let mut next = (0..POSES).cycle();
    let mut index = || next.next().unwrap();
    group.bench_function("forward", |bencher| {
        bencher.iter(|| model.forward(black_box(&joints[index()])));
    });
    group.bench_function("forward_rigid", |bencher| {
        bencher.iter(|| model.base_from_flange(black_box(&joints[index()])));
    });
    group.bench_function("jacobian", |bencher| {
        bencher.iter(|| model.jacobian(black_box(&joints[index()])));
    });
    group.bench_function("inverse", |bencher| {
        bencher.iter(|| model.inverse(black_box(&poses[index()]), &[0.0; 6]));
    });
    group.bench_function("inverse_rigid", |bencher| {
        bencher.iter(|| model.inverse(&black_box(rigid[index()]).into(), &[0.0; 6]));
    });
    let tool = Rigid::new(
        Rotation::from_scaled_axis(Vector3::new(0.0, -1.5, 0.0)),
        Vector3::new(0.0, 0.0, 310.0),
    );
    let arm = ToolArm::new(model, tool);
    let tools: Vec<_> = joints
        .iter()
        .map(|joints| arm.base_from_tool(joints))
        .collect();
    group.bench_function("tool_nearest_verified", |bencher| {
        bencher.iter(|| {
            let index = index();
            arm.joints(black_box(&tools[index]), &joints[index])
        });
    });
    group.finish();
}

/// Joints (6), rotation by rows (9) and origin in m (3) of every pose as little-endian doubles, and our account.
fn write(folder: &Path) -> std::io::Result<()> {
    let model = Model::ur5();
    let mut sweep = Sweep(1);
    let mut bytes = Vec::with_capacity(WRITTEN * 18 * 8);
    for case in 0..WRITTEN {
        let joints = sweep::generated(&mut sweep, &model, case);
        let pose = model.forward(&joints);
        let rotation = pose.rotation.transpose();
        let origin_m = pose.origin_mm * 1e-3;
        for value in joints.iter().chain(&rotation).chain(&origin_m) {
            bytes.extend(value.to_le_bytes());
        }
    }
    std::fs::write(folder.join("poses.f64"), bytes)?;
    let mut rows = Vec::new();
    for (seed, name, make) in [(1, "UR5", Make::Ur5), (2, "UR5e", Make::Ur5e)] {
        let account = sweep::account(&make.into(), seed, ACCOUNTED);
        let mut row = String::new();
        let _ = write!(
            row,
            "{{\"name\": \"{name}\", \"forward_ns\": {:.1}, \"inverse_ns\": {:.1}, \"poses\": {ACCOUNTED}, \"missing\": {}, \"lost\": {}, \"solutions\": {}, \"worst_m\": {:e}, \"worst_rad\": {:e}}}",
            best_ns(&make.into(), |model, joints, _| drop(black_box(
                model.forward(joints)
            ))),
            best_ns(&make.into(), |model, joints, pose| {
                drop(black_box(model.inverse(pose, joints)));
            }),
            account.missing,
            account.lost,
            account.solutions,
            account.worst_mm * 1e-3,
            account.worst_rad
        );
        rows.push(row);
    }
    std::fs::write(
        folder.join("account.json"),
        format!("[{}]\n", rows.join(",\n")),
    )
}

/// Time of one of `POSES` poses in the best of many rounds, ns: what else the machine does falls out.
fn best_ns(model: &Model, mut ask: impl FnMut(&Model, &Joints, &FlangePose)) -> f64 {
    let mut sweep = Sweep(3);
    let asked: Vec<(Joints, FlangePose)> = (0..POSES)
        .map(|_| sweep.joints())
        .map(|joints| (joints, model.forward(&joints)))
        .collect();
    (0..ROUNDS)
        .map(|_| {
            let began = std::time::Instant::now();
            for (joints, pose) in &asked {
                ask(model, black_box(joints), black_box(pose));
            }
            began.elapsed().as_secs_f64() * 1e9 / POSES as f64
        })
        .fold(f64::INFINITY, f64::min)
}

criterion_group!(benches, drawn, calibrated);
criterion_main!(benches);
