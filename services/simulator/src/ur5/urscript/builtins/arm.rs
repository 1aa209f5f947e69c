//! What the arm knows about itself.

use super::{Builtin, Param, flag, float, number, required, value};
use crate::ur5::{kinematics, measurements::JOINT_TEMPERATURE_C, urscript::value::Value};

const NONE: &[Param] = &[];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "get_actual_joint_positions",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.drives.q)),
    },
    // The older name of the same.
    Builtin {
        name: "get_joint_positions",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.drives.q)),
    },
    // Only the present is kept.
    Builtin {
        name: "get_actual_joint_positions_history",
        params: &[number("steps", 0.0)],
        call: |context, args| match args.whole(0)? {
            0 => value(Value::floats(&context.robot.drives.q)),
            steps => Err(format!("no positions of {steps} steps before are kept")),
        },
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
        name: "get_target_joint_accelerations",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.target_qdd)),
    },
    Builtin {
        name: "get_actual_tcp_pose",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            value(Value::Pose(robot.tool_pose(&robot.drives.q)))
        },
    },
    Builtin {
        name: "get_actual_tool_flange_pose",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            let flange = robot.dh.flange(&robot.drives.q);
            value(Value::Pose(kinematics::to_pose(&flange)))
        },
    },
    Builtin {
        name: "get_target_tcp_pose",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            value(Value::Pose(robot.tool_pose(&robot.target.q)))
        },
    },
    Builtin {
        name: "get_target_waypoint",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            let pose = robot.waypoint();
            value(Value::Pose(pose))
        },
    },
    Builtin {
        name: "get_actual_tcp_speed",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            let speed = robot.tool_speed(&robot.drives.q, &robot.drives.qd);
            value(Value::floats(&speed))
        },
    },
    Builtin {
        name: "get_target_tcp_speed",
        params: NONE,
        call: |context, _| {
            let robot = &context.robot;
            let speed = robot.tool_speed(&robot.target.q, &robot.target.qd);
            value(Value::floats(&speed))
        },
    },
    Builtin {
        name: "get_joint_temp",
        params: &[required("j")],
        call: |_, args| match args.whole(0)? {
            0..=5 => float(JOINT_TEMPERATURE_C),
            other => Err(format!("joint {other} is not within 0 to 5")),
        },
    },
    Builtin {
        name: "get_controller_temp",
        params: NONE,
        call: |_, _| float(JOINT_TEMPERATURE_C),
    },
    Builtin {
        name: "is_steady",
        params: NONE,
        call: |context, _| flag(context.robot.is_steady()),
    },
    Builtin {
        name: "get_freedrive_status",
        params: NONE,
        call: |_, _| value(Value::Int(0)),
    },
    Builtin {
        name: "get_target_speed_fraction",
        params: NONE,
        call: |context, _| float(context.robot.speed_slider),
    },
    Builtin {
        name: "powerdown",
        params: NONE,
        call: |context, _| {
            context.robot.power_off();
            super::nothing()
        },
    },
];
