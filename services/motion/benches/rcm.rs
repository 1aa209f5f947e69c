#![allow(missing_docs)] // criterion_group! makes functions without any.
//! Times what it takes to plan one move through the portal.

use std::f64::consts::FRAC_PI_2;
use std::hint::black_box;

use arthro_geometry::frame::{Flange, Tool};
use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_motion::kinematics::dh::Dh;
use arthro_motion::kinematics::model::Model;
use arthro_motion::kinematics::{Joints, ToolArm};
use arthro_motion::limits::Limits;
use arthro_motion::rcm::path::Destination;
use arthro_motion::rcm::{RcmPath, Regain, shaft};
use arthro_motion::roll::profile::Search;
use arthro_motion::time_law::{RateLimits, TimeLaw};
use arthro_motion::trajectory::rates::{Bounds, Survey};
use arthro_motion::trajectory::{Speeds, Trajectory};
use criterion::{Criterion, criterion_group, criterion_main};

const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

/// An arm whose table differs from the drawing by half a millimetre and a milliradian.
fn measured_arm(tool: Rigid<Flange, Tool>) -> ToolArm {
    let off = Dh {
        theta_rad: [0.001, -0.001, 0.001, -0.001, 0.001, -0.001],
        a_mm: [0.5, -0.5, 0.5, -0.5, 0.5, -0.5],
        d_mm: [0.5, -0.5, 0.5, -0.5, 0.5, -0.5],
        alpha_rad: [-0.001, 0.001, -0.001, 0.001, -0.001, 0.001],
    };
    let table = Model::ur5().dh().plus(&off);
    let model = Model::ur5().calibrated(&table);
    ToolArm::new(model.expect("half a millimetre is near the drawing"), tool)
}

fn plan(c: &mut Criterion) {
    let arm = ToolArm::new(
        Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    );
    let limits = Limits::default();
    let speeds = Speeds {
        tip_mm_s: limits.inside_speed_mm_s,
        turn_rad_s: limits.pivot_speed_rad_s,
    };
    // 30 degrees and 0 to 60 mm at once, with the tip at the portal.
    let pose = arm.base_from_tool(&START);
    let turned = Rotation::from_scaled_axis(Vector3::y() * 30_f64.to_radians()) * shaft(&pose);
    let end = Destination {
        direction: Some(Unit::new_normalize(turned)),
        depth_mm: Some(60.0),
        roll_rad: None,
    };
    let path = RcmPath::to(&pose, pose.origin(), &end, Regain::Portal);

    let rates = RateLimits {
        speed: 0.3,
        acceleration: 1.0,
        jerk: 10.0,
    };
    c.bench_function("one time law", |b| {
        b.iter(|| TimeLaw::new(black_box(&rates)));
    });
    c.bench_function("one move: survey and law", |b| {
        let bounds = Bounds::new(&limits, speeds);
        b.iter(|| {
            Survey::of(&arm, black_box(&path), &START).and_then(|survey| survey.law(&bounds))
        });
    });
    let calibrated = measured_arm(arm.flange_from_tool());
    for (name, arm) in [("as drawn", arm), ("calibrated", calibrated)] {
        let pose = arm.base_from_tool(&START);
        let path = RcmPath::to(&pose, pose.origin(), &end, Regain::Portal);
        c.bench_function(&format!("one free roll, arm {name}"), |b| {
            b.iter(|| Search::default().profile(&arm, |s| black_box(&path).pose(s), &START));
        });
    }
    for frequency_hz in [125.0, 500.0] {
        c.bench_function(
            &format!("one move: all of its samples at {frequency_hz} Hz"),
            |b| {
                b.iter(|| {
                    let path = black_box(&path).clone();
                    Trajectory::plan(arm, path, &START, &limits, speeds, 1.0 / frequency_hz)
                });
            },
        );
    }
}

criterion_group!(benches, plan);
criterion_main!(benches);
