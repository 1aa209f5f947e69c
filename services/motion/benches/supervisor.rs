//! What the watch over both arms costs a controller cycle, and what it costs to look at a way before a move.

#![allow(missing_docs)] // criterion's macros write functions without any

use std::f64::consts::FRAC_PI_2;
use std::hint::black_box;

use arthro_geometry::nalgebra::Unit;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_motion::bodies::{ArmShape, ToolShape};
use arthro_motion::cell::Berth;
use arthro_motion::clearance::{Clearance, Keep, Side};
use arthro_motion::kinematics::{Joints, ToolArm};
use arthro_motion::limits::Limits;
use arthro_motion::plan::Plan;
use arthro_motion::rcm::shaft;
use arthro_motion::supervisor::{Measured, Regime, Supervisor};
use arthro_motion::sweep::Walker;
use arthro_motion::workspace::{Part, Plane};
use criterion::{Criterion, criterion_group, criterion_main};
use ur_link::{RobotMode, SafetyMode};

const JOINTS: [Joints; 2] = [
    [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
    [0.796, -1.456, -1.861, -3.148, -1.303, -1.522],
];

fn arm() -> ToolArm {
    ToolArm::new(
        arthro_motion::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    )
}

fn clearance() -> Clearance {
    let arm = arm();
    let shape = ArmShape::new(&arm, ToolShape::default());
    let base = Rigid::new(
        Rotation::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2),
        Vector3::new(350.0, 750.0, 0.0),
    );
    Clearance::new((arm, shape), (arm, shape), base)
}

fn limits() -> Limits {
    let plane = |normal, offset_mm| Plane {
        name: "plane".to_owned(),
        normal,
        offset_mm,
        keeps: vec![Part::Tip, Part::Shaft, Part::Arm],
    };
    Limits {
        planes: vec![
            plane([0.0, 0.0, 1.0], -100.0),
            plane([0.0, 0.0, -1.0], -1500.0),
            plane([1.0, 0.0, 0.0], -500.0),
        ],
        ..Limits::default()
    }
}

fn supervisor(criterion: &mut Criterion) {
    let arm = arm();
    let mut watches = Berth::beside(clearance()).map(|berth| Supervisor::new(arm, limits(), berth));
    let portals = JOINTS.map(|joints| {
        let pose = arm.base_from_tool(&joints);
        (
            pose.origin() - shaft(&pose) * 30.0,
            Unit::new_normalize(shaft(&pose)),
        )
    });
    let mut time_s = 0.0;
    // Both arms are inside and move, so that every rule is asked.
    criterion.bench_function("supervisor/tick of both arms", |bench| {
        bench.iter(|| {
            time_s += 0.008;
            for ((watch, joints_rad), (portal, axis)) in
                watches.iter_mut().zip(JOINTS).zip(&portals)
            {
                let measured = Measured {
                    time_s,
                    joints_rad: black_box(joints_rad),
                    joint_speeds_rad_s: [0.001; 6],
                    robot_mode: RobotMode::Running,
                    safety_mode: SafetyMode::Normal,
                };
                let seen = watch.observe(&measured, Some(portal), Some(axis));
                if time_s > 1.0 {
                    assert_eq!(watch.check(Regime::Inward, &measured, &seen), Ok(()));
                }
            }
        });
    });
}

fn ways(criterion: &mut Criterion) {
    let (arm, limits, clearance) = (arm(), limits(), clearance());
    let [berth, their_berth] = Berth::beside(clearance);
    let walker = Walker {
        arm: &arm,
        limits: &limits,
        berth: &berth,
        plane_room_mm: 0.0,
    };
    let mut end = JOINTS[0];
    end[0] -= 0.3;
    let plan = Plan::Joints {
        joints_rad: end,
        speed_rad_s: 0.5,
    };
    let other = clearance.bodies(Side::Arthroscope, &JOINTS[1]);
    let keep = Keep::of(&limits);
    criterion.bench_function("clearance/both arms at once", |bench| {
        bench.iter(|| clearance.between(black_box(&JOINTS[0]), black_box(&JOINTS[1])));
    });
    criterion.bench_function("way/past a standing arm", |bench| {
        bench.iter(|| {
            let way = walker
                .sweep(&plan, black_box(&JOINTS[0]))
                .expect("the way is clear");
            way.keeps_clear_of(&other, &keep).expect("the way is clear");
        });
    });
    let way = walker.sweep(&plan, &JOINTS[0]).expect("the way is clear");
    let mut their_end = JOINTS[1];
    their_end[0] += 0.3;
    let their_plan = Plan::Joints {
        joints_rad: their_end,
        speed_rad_s: 0.5,
    };
    let their_walker = Walker {
        berth: &their_berth,
        ..walker
    };
    let theirs = their_walker
        .sweep(&their_plan, &JOINTS[1])
        .expect("the way is clear");
    // So little is asked for that every pair of places is looked at.
    let keep = Keep {
        shafts_mm: -1000.0,
        others_mm: -1000.0,
    };
    criterion.bench_function("way/past the way of another arm", |bench| {
        bench.iter(|| {
            way.keeps_clear_of_sweep(black_box(&theirs), &keep)
                .expect("the way is clear")
        });
    });
}

criterion_group!(benches, supervisor, ways);
criterion_main!(benches);
