use arthro_geometry::{Rigid, Rotation, Vector3};
use proptest::prelude::*;
use ur_link::{ProgramState, RobotMode, RuntimeState, SafetyMode, Window};

use super::*;
use crate::bodies::{ArmShape, ToolShape};
use crate::kinematics::ToolArm;
use crate::limits::Limits;
use crate::plan::{Move, Situation};
use crate::rcm::{Placement, shaft};

const START: Joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];
const PERIOD_S: f64 = 0.008;

fn arm() -> ToolArm {
    ToolArm::new(
        crate::kinematics::model::Model::ur5(),
        Rigid::new(
            Rotation::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2),
            Vector3::new(0.0, 0.0, 310.0),
        ),
    )
}

/// A pivot of the shaft, tip 20 mm in front of the portal.
fn pivot(angle_rad: f64) -> Motion {
    let pose = arm().base_from_tool(&START);
    let portal = pose.origin() + shaft(&pose) * 20.0;
    let turn = Rotation::from_axis_angle(&Vector3::y_axis(), angle_rad);
    let seen = observation();
    let situation = Situation {
        arm: &arm(),
        limits: &Limits::default(),
        period_s: PERIOD_S,
        portal: Some(portal.into()),
        joints_rad: &START,
        seen: &Observation {
            placement: Some(Placement::of(&pose, &portal)),
            ..seen
        },
    };
    let plan = situation
        .plan(&Move::Pivot {
            aim: portal + turn * shaft(&pose) * 40.0,
            speed_rad_s: None,
        })
        .unwrap();
    let by = Authorization {
        fencing_token: 1,
        operation_id: "pivot".to_owned(),
    };
    Motion::new(by, plan, START, PERIOD_S).unwrap().0
}

fn observation() -> Observation {
    Observation {
        base_from_tool: arm().base_from_tool(&START),
        placement: None,
        inside: false,
        gap_s: PERIOD_S,
        bodies: ArmShape::new(&arm(), ToolShape::default())
            .bodies(&START, &arm().base_from_tool(&START)),
        tip_speed_mm_s: 0.0,
        cone_rad: None,
        safety_mode_before: None,
        warning_mm: None,
    }
}

fn state(consumed: i32, joints: &Joints) -> State {
    State {
        timestamp_s: 0.0,
        actual_q: *joints,
        target_q: *joints,
        actual_qd: [0.0; 6],
        actual_tcp_pose: [0.0; 6],
        robot_mode: RobotMode::Running,
        safety_mode: SafetyMode::Normal,
        runtime_state: RuntimeState::Playing,
        speed_scaling: 1.0,
        target_speed_fraction: 1.0,
        program: ProgramState {
            ready: true,
            sample_consumed: consumed,
            ..ProgramState::default()
        },
    }
}

/// Lets a program consume at the given paces, samples a state; packages of which the flag is false get lost.
fn commanded(motion: &mut Motion, paces: impl IntoIterator<Item = (usize, bool)>) -> Vec<Joints> {
    let mut joints = START;
    let mut got: Vec<Joints> = Vec::new();
    let mut seen: Option<Window> = None;
    for (pace, arrives) in paces {
        match motion.step(&state(got.len() as i32, &joints), &observation()) {
            Step::Go(Command::Stream(window)) if arrives => seen = Some(window),
            Step::Go(_) => {}
            Step::Arrived => return got,
            Step::Failed(reason, detail) => panic!("{reason}: {detail}"),
        }
        for _ in 0..pace {
            let next = got.len() as i32 + 1;
            let sample = seen.and_then(|window| {
                let found = window.samples().find(|(number, _)| *number == next);
                found.map(|(_, sample)| *sample)
            });
            if let Some(sample) = sample {
                joints = sample;
                got.push(sample);
            }
        }
    }
    panic!("not there after {} samples", got.len());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Time-scale invariance: the slider, late and lost packages and the pace of the clock change no sample.
    #[test]
    fn the_arm_is_commanded_the_same_samples_at_any_pace(
        angle_rad in -0.3..0.3f64,
        paces in prop::collection::vec((0..4_usize, any::<bool>()), 1..50),
    ) {
        let steady = commanded(&mut pivot(angle_rad), std::iter::repeat_n((1, true), 20_000));
        let paces = paces.into_iter().chain([(1, true)]).cycle().take(200_000);
        prop_assert_eq!(commanded(&mut pivot(angle_rad), paces), steady);
    }
}

#[test]
fn samples_are_those_of_the_controllers_period() {
    let mut motion = pivot(0.2);
    let samples = commanded(&mut motion, std::iter::repeat_n((1, true), 20_000));
    let nominal = motion.way.duration_s() / PERIOD_S;
    assert!((samples.len() as f64 - nominal).abs() <= 1.0);
}

#[test]
fn a_count_that_cannot_be_fails_the_move() {
    let mut motion = pivot(0.2);
    motion.step(&state(0, &START), &observation());
    let step = motion.step(&state(9, &START), &observation());
    assert!(matches!(step, Step::Failed("STREAM_BROKEN", _)));
}
