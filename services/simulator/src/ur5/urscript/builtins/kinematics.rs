//! Forward and inverse kinematics for programs.

use nalgebra::DMatrix;

use super::{
    Args, Builtin, Context, Param, flag, motion::solve, number, optional, required, value,
};
use crate::ur5::{
    kinematics::{self, Joints},
    urscript::{arrays, value::Value},
};

const INVERSE: &[Param] = &[
    required("x"),
    optional("qnear"),
    number("maxPositionError", 1e-10),
    number("maxOrientationError", 1e-10),
    optional("tcp"),
];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "get_forward_kin",
        params: &[optional("q"), optional("tcp")],
        call: |context, args| {
            let joints = joints(context, args, 0)?;
            let tool = tool(context, args, 1)?;
            let flange = context.robot.dh.flange(&joints);
            value(Value::Pose(kinematics::to_pose(&(flange * tool))))
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
    Builtin {
        name: "get_jacobian",
        params: &[optional("q"), optional("tcp")],
        call: |context, args| {
            let joints = joints(context, args, 0)?;
            let tool = tool(context, args, 1)?;
            let jacobian = context.robot.dh.jacobian(&joints, &tool);
            let jacobian = DMatrix::from_fn(6, 6, |row, column| jacobian[(row, column)]);
            value(arrays::rows(&jacobian))
        },
    },
    Builtin {
        name: "is_within_safety_limits",
        params: &[required("pose")],
        call: |context, args| {
            let range = context.robot.config.joint_range_rad;
            let six = args.six(0)?;
            let joints = match args.value(0) {
                Value::Pose(_) => solve(context.robot, &six, &context.robot.target.q),
                _ => Some(six),
            };
            flag(joints.is_some_and(|joints| joints.iter().all(|joint| joint.abs() <= range)))
        },
    },
];

fn inverse(context: &Context<'_>, args: &Args<'_>) -> Result<Option<Joints>, String> {
    let near = joints(context, args, 1)?;
    let goal = kinematics::from_pose(&args.pose(0)?);
    let tool = tool(context, args, 4)?;
    Ok(context.robot.dh.inverse(&goal, &tool, &near))
}

/// As given, or those of the arm.
fn joints(context: &Context<'_>, args: &Args<'_>, index: usize) -> Result<Joints, String> {
    if args.is_given(index) {
        args.six(index)
    } else {
        Ok(context.robot.drives.q)
    }
}

/// As given, or that of the arm.
fn tool(
    context: &Context<'_>,
    args: &Args<'_>,
    index: usize,
) -> Result<nalgebra::Isometry3<f64>, String> {
    if args.is_given(index) {
        Ok(kinematics::from_pose(&args.pose(index)?))
    } else {
        Ok(*context.robot.flange_from_tool())
    }
}
