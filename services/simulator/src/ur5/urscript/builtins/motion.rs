//! Functions that move the arm, with the controller's blocking semantics.

use nalgebra::Isometry3;

use super::{Args, Builtin, Context, Outcome, Param, nothing, number, optional, required};
use crate::ur5::{
    kinematics::{self, Joints},
    motion::{Arc, Motion, Orientation},
    robot::Robot,
    urscript::{interpreter::Wait, value::Value},
};

const MOVE_J: &[Param] = &[
    required("q"),
    number("a", 1.4),
    number("v", 1.05),
    number("t", 0.0),
    number("r", 0.0),
];
const MOVE_L: &[Param] = &[
    required("pose"),
    number("a", 1.2),
    number("v", 0.25),
    number("t", 0.0),
    number("r", 0.0),
];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "movej",
        params: MOVE_J,
        call: |context, args| move_joints(context, args, args.number(3)?, args.number(4)?),
    },
    Builtin {
        name: "movel",
        params: MOVE_L,
        call: |context, args| move_line(context, args, args.number(3)?, args.number(4)?),
    },
    Builtin {
        name: "movep",
        params: &[
            required("pose"),
            number("a", 1.2),
            number("v", 0.25),
            number("r", 0.0),
        ],
        call: |context, args| move_line(context, args, 0.0, args.number(3)?),
    },
    // The controller shapes these two by the torques of the arm; here they are movej and movel.
    Builtin {
        name: "optimovej",
        params: &[
            required("q"),
            number("a", 0.3),
            number("v", 0.3),
            number("r", 0.0),
        ],
        call: |context, args| move_joints(context, args, 0.0, args.number(3)?),
    },
    Builtin {
        name: "optimovel",
        params: &[
            required("pose"),
            number("a", 0.3),
            number("v", 0.3),
            number("r", 0.0),
        ],
        call: |context, args| move_line(context, args, 0.0, args.number(3)?),
    },
    Builtin {
        name: "movec",
        params: &[
            required("pose_via"),
            required("pose_to"),
            number("a", 1.2),
            number("v", 0.25),
            number("r", 0.0),
            number("mode", 0.0),
        ],
        call: |context, args| {
            let (via, goal) = (pose_of(context, args, 0)?, pose_of(context, args, 1)?);
            let (accel, speed) = (args.positive(2)?, args.positive(3)?);
            let orientation = match args.whole(5)? {
                0 => Orientation::Interpolated,
                1 => Orientation::Tangential,
                other => return Err(format!("mode {other} is neither 0 nor 1")),
            };
            path(context, args.number(4)?, |robot, start| {
                let from = tool(robot, start);
                let arc = Arc::through(from, &via, &goal, orientation, speed, accel)?;
                Ok(Motion::Arc(Box::new(arc)))
            })
        },
    },
    Builtin {
        name: "servoj",
        params: &[
            required("q"),
            number("a", 0.0),
            number("v", 0.0),
            optional("t"),
            number("lookahead_time", 0.1),
            number("gain", 300.0),
        ],
        call: |context, args| {
            let time_s = if args.is_given(3) {
                args.positive(3)?
            } else {
                context.robot.step_s()
            };
            let motion = Motion::servo(
                args.six(0)?,
                args.number(4)?.clamp(0.03, 0.2),
                args.number(5)?.clamp(100.0, 2000.0),
            );
            begin(context, motion)?;
            Ok(Outcome::Wait(Wait::PathTime(time_s)))
        },
    },
    Builtin {
        name: "servoc",
        params: &[
            required("pose"),
            number("a", 1.2),
            number("v", 0.25),
            number("r", 0.0),
        ],
        call: |context, args| {
            let goal = pose_of(context, args, 0)?;
            let (accel, speed) = (args.positive(1)?, args.positive(2)?);
            let chase = context.robot.chase(goal, speed, accel);
            begin(context, chase)?;
            Ok(Outcome::Wait(Wait::Cycle))
        },
    },
    Builtin {
        name: "speedj",
        params: &[required("qd"), number("a", 1.4), number("t", 0.0)],
        call: |context, args| {
            let motion = Motion::JointSpeed {
                speed: args.six(0)?,
                accel: args.positive(1)?,
            };
            for_a_time(context, motion, args.number(2)?)
        },
    },
    Builtin {
        name: "speedl",
        params: &[
            required("xd"),
            number("a", 1.2),
            number("t", 0.0),
            optional("aRot"),
        ],
        call: |context, args| {
            let (speed, accel) = (args.six(0)?.into(), args.positive(1)?);
            let motion = context.robot.tool_motion(speed, accel);
            for_a_time(context, motion, args.number(2)?)
        },
    },
    Builtin {
        name: "stopj",
        params: &[number("a", 2.0)],
        call: |context, args| {
            let motion = Motion::JointSpeed {
                speed: [0.0; 6],
                accel: args.positive(0)?,
            };
            begin(context, motion).map(Outcome::Wait)
        },
    },
    Builtin {
        name: "stopl",
        params: &[number("a", 1.2), optional("aRot")],
        call: |context, args| {
            let accel = args.positive(0)?;
            let motion = context.robot.tool_motion([0.0; 6].into(), accel);
            begin(context, motion).map(Outcome::Wait)
        },
    },
    // Nobody pushes this arm: in freedrive it comes to rest and stays there.
    Builtin {
        name: "freedrive_mode",
        params: &[optional("freeAxes"), optional("feature")],
        call: freedrive,
    },
    Builtin {
        name: "teach_mode",
        params: &[],
        call: freedrive,
    },
    Builtin {
        name: "end_freedrive_mode",
        params: &[],
        call: |_, _| nothing(),
    },
    Builtin {
        name: "end_teach_mode",
        params: &[],
        call: |_, _| nothing(),
    },
];

/// Deceleration with which the arm enters freedrive, rad/s².
const FREEDRIVE_STOP_RAD_S2: f64 = 4.0;

fn freedrive(context: &mut Context<'_>, _: &Args<'_>) -> Result<Outcome, String> {
    let motion = Motion::JointSpeed {
        speed: [0.0; 6],
        accel: FREEDRIVE_STOP_RAD_S2,
    };
    begin(context, motion)?;
    nothing()
}

fn move_joints(
    context: &mut Context<'_>,
    args: &Args<'_>,
    time_s: f64,
    blend_m: f64,
) -> Result<Outcome, String> {
    let (accel, speed) = rates(args, time_s)?;
    let pose = matches!(args.value(0), Value::Pose(_));
    let goal = args.six(0)?;
    path(context, blend_m, |robot, start| {
        let goal = if pose {
            solve(robot, &goal, start).ok_or("pose is out of reach")?
        } else {
            goal
        };
        Ok(Motion::joints(*start, goal, speed, accel, time_s))
    })
}

fn move_line(
    context: &mut Context<'_>,
    args: &Args<'_>,
    time_s: f64,
    blend_m: f64,
) -> Result<Outcome, String> {
    let goal = pose_of(context, args, 0)?;
    let (accel, speed) = rates(args, time_s)?;
    path(context, blend_m, |robot, start| {
        Ok(Motion::line(
            tool(robot, start),
            &goal,
            speed,
            accel,
            time_s,
        ))
    })
}

/// Acceleration and speed, which do not matter for a move that is told its time.
fn rates(args: &Args<'_>, time_s: f64) -> Result<(f64, f64), String> {
    if time_s > 0.0 {
        Ok((args.number(1)?, args.number(2)?))
    } else {
        Ok((args.positive(1)?, args.positive(2)?))
    }
}

/// A path blocks until its end, or until the next may begin.
fn path(
    context: &mut Context<'_>,
    blend_m: f64,
    build: impl FnOnce(&Robot, &Joints) -> Result<Motion, String>,
) -> Result<Outcome, String> {
    may_move(context)?;
    let ticket = context.robot.begin_path(context.thread, blend_m, build)?;
    Ok(Outcome::Wait(if blend_m > 0.0 {
        Wait::Blend(ticket)
    } else {
        Wait::Motion(ticket)
    }))
}

fn may_move(context: &Context<'_>) -> Result<(), String> {
    if context.secondary {
        Err("a secondary program may not move the arm".to_owned())
    } else {
        Ok(())
    }
}

fn begin(context: &mut Context<'_>, motion: Motion) -> Result<Wait, String> {
    may_move(context)?;
    let ticket = context.robot.begin(context.thread, motion)?;
    Ok(Wait::Motion(ticket))
}

/// Until the time is over, or without one until the speed is reached.
fn for_a_time(context: &mut Context<'_>, motion: Motion, time_s: f64) -> Result<Outcome, String> {
    let reached = begin(context, motion)?;
    Ok(Outcome::Wait(if time_s > 0.0 {
        Wait::Until(context.robot.now_s() + time_s)
    } else {
        reached
    }))
}

/// A pose, or the pose of the tool for these joints.
fn pose_of(context: &Context<'_>, args: &Args<'_>, index: usize) -> Result<Isometry3<f64>, String> {
    let six = args.six(index)?;
    Ok(match args.value(index) {
        Value::Pose(_) => kinematics::from_pose(&six),
        _ => tool(context.robot, &six),
    })
}

fn tool(robot: &Robot, joints: &Joints) -> Isometry3<f64> {
    robot.dh.flange(joints) * robot.flange_from_tool()
}

/// The joints near some others that put the tool at a pose.
pub(super) fn solve(robot: &Robot, pose: &Joints, near: &Joints) -> Option<Joints> {
    robot
        .dh
        .inverse(&kinematics::from_pose(pose), robot.flange_from_tool(), near)
}
