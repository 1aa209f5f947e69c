//! Motion, tool, and what the arm knows about itself.

use super::{
    Args, Builtin, Context, Outcome, Param, flag, float, nothing, number, optional, required, value,
};
use crate::ur5::{
    kinematics::{self, Joints},
    motion::Motion,
    urscript::{interpreter::Wait, value::Value},
};

const NONE: &[Param] = &[];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "movej",
        params: &[
            required("q"),
            number("a", 1.4),
            number("v", 1.05),
            number("t", 0.0),
            number("r", 0.0),
        ],
        call: |context, args| {
            let goal = joints_of(context, args)?;
            let (accel, speed, time_s) = (args.positive(1)?, args.positive(2)?, args.number(3)?);
            let motion = Motion::joints(context.robot.target.q, goal, speed, accel, time_s);
            blocking(context, motion)
        },
    },
    Builtin {
        name: "movel",
        params: &[
            required("pose"),
            number("a", 1.2),
            number("v", 0.25),
            number("t", 0.0),
            number("r", 0.0),
        ],
        call: |context, args| {
            let goal = pose_of(context, args)?;
            line(
                context,
                goal,
                args.positive(1)?,
                args.positive(2)?,
                args.number(3)?,
            )
        },
    },
    Builtin {
        name: "movep",
        params: &[
            required("pose"),
            number("a", 1.2),
            number("v", 0.25),
            number("r", 0.0),
        ],
        call: |context, args| {
            let goal = pose_of(context, args)?;
            line(context, goal, args.positive(1)?, args.positive(2)?, 0.0)
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
            blocking(context, motion)
        },
    },
    Builtin {
        name: "stopl",
        params: &[number("a", 1.2), optional("aRot")],
        call: |context, args| {
            let accel = args.positive(0)?;
            let motion = context.robot.tool_motion([0.0; 6].into(), accel);
            blocking(context, motion)
        },
    },
    Builtin {
        name: "set_tcp",
        params: &[required("pose")],
        call: |context, args| {
            context.robot.set_tcp(args.pose(0)?);
            nothing()
        },
    },
    Builtin {
        name: "set_payload",
        params: &[required("m"), optional("cog")],
        call: |context, args| {
            context.robot.payload_kg = args.number(0)?;
            if args.is_given(1) {
                set_cog(context, args, 1)?;
            }
            nothing()
        },
    },
    Builtin {
        name: "set_payload_mass",
        params: &[required("m")],
        call: |context, args| {
            context.robot.payload_kg = args.number(0)?;
            nothing()
        },
    },
    Builtin {
        name: "set_payload_cog",
        params: &[required("CoG")],
        call: |context, args| {
            set_cog(context, args, 0)?;
            nothing()
        },
    },
    // Without effect on this model; accepted because programs for any arm make these calls.
    Builtin {
        name: "set_gravity",
        params: &[required("d")],
        call: |_, _| nothing(),
    },
    Builtin {
        name: "force_mode_set_damping",
        params: &[required("damping")],
        call: |_, _| nothing(),
    },
    Builtin {
        name: "end_force_mode",
        params: NONE,
        call: |_, _| nothing(),
    },
    Builtin {
        name: "get_tcp_offset",
        params: NONE,
        call: |context, _| value(Value::Pose(context.robot.tcp_offset)),
    },
    Builtin {
        name: "get_target_payload",
        params: NONE,
        call: |context, _| float(context.robot.payload_kg),
    },
    Builtin {
        name: "get_target_payload_cog",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.payload_cog_m)),
    },
    Builtin {
        name: "get_actual_joint_positions",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.drives.q)),
    },
    Builtin {
        name: "get_actual_joint_speeds",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.drives.qd)),
    },
    Builtin {
        name: "get_target_joint_positions",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.target.q)),
    },
    Builtin {
        name: "get_target_joint_speeds",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.target.qd)),
    },
    Builtin {
        name: "get_actual_tcp_pose",
        params: NONE,
        call: |context, _| {
            value(Value::Pose(
                context.robot.tool_pose(&context.robot.drives.q),
            ))
        },
    },
    Builtin {
        name: "get_actual_tool_flange_pose",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            value(Value::Pose(kinematics::to_pose(
                &robot.dh.flange(&robot.drives.q),
            )))
        },
    },
    Builtin {
        name: "get_target_tcp_pose",
        params: NONE,
        call: |context, _| {
            value(Value::Pose(
                context.robot.tool_pose(&context.robot.target.q),
            ))
        },
    },
    Builtin {
        name: "get_actual_tcp_speed",
        params: NONE,
        call: |context, _| {
            let drives = &context.robot.drives;
            value(Value::floats(
                &context.robot.tool_speed(&drives.q, &drives.qd),
            ))
        },
    },
    Builtin {
        name: "get_target_tcp_speed",
        params: NONE,
        call: |context, _| {
            let target = &context.robot.target;
            value(Value::floats(
                &context.robot.tool_speed(&target.q, &target.qd),
            ))
        },
    },
    Builtin {
        name: "get_tcp_force",
        params: NONE,
        call: |_, _| value(Value::floats(&[0.0; 6])),
    },
    Builtin {
        name: "get_joint_torques",
        params: NONE,
        call: |_, _| value(Value::floats(&[0.0; 6])),
    },
    Builtin {
        name: "is_steady",
        params: NONE,
        call: |context, _| flag(context.robot.is_steady()),
    },
    Builtin {
        name: "is_within_safety_limits",
        params: &[required("pose")],
        call: |context, args| {
            let range = context.robot.config.joint_range_rad;
            let joints = match args.value(0) {
                Value::Pose(pose) => solve(context, pose, &context.robot.target.q),
                _ => Some(args.six(0)?),
            };
            flag(joints.is_some_and(|joints| joints.iter().all(|joint| joint.abs() <= range)))
        },
    },
    Builtin {
        name: "get_forward_kin",
        params: &[optional("q"), optional("tcp")],
        call: |context, args| {
            let joints = if args.is_given(0) {
                args.six(0)?
            } else {
                context.robot.drives.q
            };
            let tool = if args.is_given(1) {
                kinematics::from_pose(&args.pose(1)?)
            } else {
                *context.robot.flange_from_tool()
            };
            value(Value::Pose(kinematics::to_pose(
                &(context.robot.dh.flange(&joints) * tool),
            )))
        },
    },
    Builtin {
        name: "get_inverse_kin",
        params: INVERSE,
        call: |context, args| {
            let joints = inverse(context, args)?;
            value(Value::floats(
                &joints.ok_or("no joint positions near qnear reach the pose")?,
            ))
        },
    },
    Builtin {
        name: "get_inverse_kin_has_solution",
        params: INVERSE,
        call: |context, args| flag(inverse(context, args)?.is_some()),
    },
];

/// What programs may name but this arm, which feels no forces, cannot do: a runtime exception once it is reached.
pub(super) const NOT_MODELLED: &[Builtin] = &[
    not_modelled(
        "servoc",
        &[
            required("pose"),
            optional("a"),
            optional("v"),
            optional("r"),
        ],
    ),
    not_modelled(
        "force_mode",
        &[
            required("task_frame"),
            required("selection_vector"),
            required("wrench"),
            required("type"),
            required("limits"),
        ],
    ),
    not_modelled("teach_mode", NONE),
    not_modelled("end_teach_mode", NONE),
    not_modelled("zero_ftsensor", NONE),
    not_modelled(
        "enable_external_ft_sensor",
        &[
            required("enable"),
            optional("sensor_mass"),
            optional("sensor_measuring_offset"),
            optional("sensor_cog"),
        ],
    ),
];

const fn not_modelled(name: &'static str, params: &'static [Param]) -> Builtin {
    Builtin {
        name,
        params,
        call: |_, _| Err("this simulated arm does not model it".to_owned()),
    }
}

const INVERSE: &[Param] = &[
    required("x"),
    optional("qnear"),
    number("maxPositionError", 1e-10),
    number("maxOrientationError", 1e-10),
    optional("tcp"),
];

fn inverse(context: &Context<'_>, args: &Args<'_>) -> Result<Option<Joints>, String> {
    let near = if args.is_given(1) {
        args.six(1)?
    } else {
        context.robot.drives.q
    };
    let goal = kinematics::from_pose(&args.pose(0)?);
    let tool = if args.is_given(4) {
        kinematics::from_pose(&args.pose(4)?)
    } else {
        *context.robot.flange_from_tool()
    };
    Ok(context.robot.dh.inverse(&goal, &tool, &near))
}

fn solve(context: &Context<'_>, pose: &Joints, near: &Joints) -> Option<Joints> {
    context.robot.dh.inverse(
        &kinematics::from_pose(pose),
        context.robot.flange_from_tool(),
        near,
    )
}

/// `movej` takes joints, or a pose that it solves near the present joints.
fn joints_of(context: &Context<'_>, args: &Args<'_>) -> Result<Joints, String> {
    match args.value(0) {
        Value::Pose(_) => {
            let pose = args.pose(0)?;
            solve(context, &pose, &context.robot.target.q)
                .ok_or_else(|| "pose is out of reach".to_owned())
        }
        _ => args.six(0),
    }
}

/// `movel` takes a pose, or joints of which it takes the pose.
fn pose_of(context: &Context<'_>, args: &Args<'_>) -> Result<Joints, String> {
    match args.value(0) {
        Value::Pose(_) => args.pose(0),
        _ => Ok(context.robot.tool_pose(&args.six(0)?)),
    }
}

fn line(
    context: &mut Context<'_>,
    goal: Joints,
    accel: f64,
    speed: f64,
    time_s: f64,
) -> Result<Outcome, String> {
    let robot = &context.robot;
    let from = robot.dh.flange(&robot.target.q) * robot.flange_from_tool();
    let motion = Motion::line(from, &kinematics::from_pose(&goal), speed, accel, time_s);
    blocking(context, motion)
}

fn begin(context: &mut Context<'_>, motion: Motion) -> Result<Wait, String> {
    if context.secondary {
        return Err("a secondary program may not move the arm".to_owned());
    }
    context
        .robot
        .begin(context.thread, motion)
        .map(Wait::Motion)
}

fn blocking(context: &mut Context<'_>, motion: Motion) -> Result<Outcome, String> {
    begin(context, motion).map(Outcome::Wait)
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

fn set_cog(context: &mut Context<'_>, args: &Args<'_>, index: usize) -> Result<(), String> {
    let numbers = args
        .value(index)
        .numbers()
        .and_then(|numbers| numbers.try_into().ok());
    context.robot.payload_cog_m =
        numbers.ok_or_else(|| args.wrong(index, "a list of three numbers"))?;
    Ok(())
}
