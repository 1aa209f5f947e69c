//! Numbers and poses.

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use super::{Args, Builtin, Outcome, Param, float, required, value};
use crate::ur5::{kinematics, motion, urscript::value::Value};

const F: &[Param] = &[required("f")];
const POSES: &[Param] = &[required("p_from"), required("p_to")];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "sin",
        params: F,
        call: |_, args| float(args.number(0)?.sin()),
    },
    Builtin {
        name: "cos",
        params: F,
        call: |_, args| float(args.number(0)?.cos()),
    },
    Builtin {
        name: "tan",
        params: F,
        call: |_, args| float(args.number(0)?.tan()),
    },
    Builtin {
        name: "asin",
        params: F,
        call: |_, args| real(args.number(0)?.asin()),
    },
    Builtin {
        name: "acos",
        params: F,
        call: |_, args| real(args.number(0)?.acos()),
    },
    Builtin {
        name: "atan",
        params: F,
        call: |_, args| float(args.number(0)?.atan()),
    },
    Builtin {
        name: "atan2",
        params: &[required("x"), required("y")],
        call: |_, args| float(args.number(0)?.atan2(args.number(1)?)),
    },
    Builtin {
        name: "sqrt",
        params: F,
        call: |_, args| real(args.number(0)?.sqrt()),
    },
    Builtin {
        name: "pow",
        params: &[required("base"), required("exponent")],
        call: |_, args| real(args.number(0)?.powf(args.number(1)?)),
    },
    Builtin {
        name: "log",
        params: &[required("b"), required("f")],
        call: |_, args| real(args.number(1)?.log(args.number(0)?)),
    },
    Builtin {
        name: "floor",
        params: F,
        call: |_, args| whole(args.number(0)?.floor()),
    },
    Builtin {
        name: "ceil",
        params: F,
        call: |_, args| whole(args.number(0)?.ceil()),
    },
    Builtin {
        name: "d2r",
        params: &[required("d")],
        call: |_, args| float(args.number(0)?.to_radians()),
    },
    Builtin {
        name: "r2d",
        params: &[required("r")],
        call: |_, args| float(args.number(0)?.to_degrees()),
    },
    Builtin {
        name: "pose_trans",
        params: POSES,
        call: |_, args| pose(&(isometry(args, 0)? * isometry(args, 1)?)),
    },
    Builtin {
        name: "pose_inv",
        params: &[required("p_from")],
        call: |_, args| pose(&isometry(args, 0)?.inverse()),
    },
    Builtin {
        name: "pose_add",
        params: &[required("p_1"), required("p_2")],
        call: |_, args| {
            let (first, second) = (isometry(args, 0)?, isometry(args, 1)?);
            let mut sum = first;
            sum.translation.vector += second.translation.vector;
            sum.rotation = first.rotation * second.rotation;
            pose(&sum)
        },
    },
    Builtin {
        name: "pose_sub",
        params: &[required("p_to"), required("p_from")],
        call: |_, args| {
            let twist = kinematics::twist_between(&isometry(args, 1)?, &isometry(args, 0)?);
            value(Value::Pose(twist.into()))
        },
    },
    Builtin {
        name: "point_dist",
        params: POSES,
        call: |_, args| {
            let (from, to) = (isometry(args, 0)?, isometry(args, 1)?);
            float((to.translation.vector - from.translation.vector).norm())
        },
    },
    Builtin {
        name: "interpolate_pose",
        params: &[required("p_from"), required("p_to"), required("alpha")],
        call: |_, args| {
            pose(&motion::between(
                &isometry(args, 0)?,
                &isometry(args, 1)?,
                args.number(2)?,
            ))
        },
    },
    Builtin {
        name: "pose_dist",
        params: POSES,
        call: |_, args| {
            let (from, to) = (isometry(args, 0)?, isometry(args, 1)?);
            let twist = kinematics::twist_between(&from, &to);
            float(twist.norm())
        },
    },
    // A wrench at the origin of one frame as felt at that of another: force and torque turned, the lever added.
    Builtin {
        name: "wrench_trans",
        params: &[required("T_from_to"), required("w_from")],
        call: |_, args| {
            let from_to = isometry(args, 0)?;
            let [fx, fy, fz, tx, ty, tz] = args.six(1)?;
            let (force, torque) = (Vector3::new(fx, fy, fz), Vector3::new(tx, ty, tz));
            let turn = from_to.rotation.inverse();
            let force_to = turn * force;
            let torque_to = turn * (torque - from_to.translation.vector.cross(&force));
            value(Value::floats(
                &[force_to.as_slice(), torque_to.as_slice()].concat(),
            ))
        },
    },
    // Roll, pitch and yaw about fixed axes x, y, z.
    Builtin {
        name: "rotvec2rpy",
        params: &[required("rotation_vector")],
        call: |_, args| {
            let rotation = Rotation3::from_scaled_axis(three(args, 0)?);
            let (roll, pitch, yaw) = rotation.euler_angles();
            value(Value::floats(&[roll, pitch, yaw]))
        },
    },
    Builtin {
        name: "rpy2rotvec",
        params: &[required("rpy_vector")],
        call: |_, args| {
            let rpy = three(args, 0)?;
            let rotation = UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z);
            value(Value::floats(rotation.scaled_axis().as_slice()))
        },
    },
];

fn real(number: f64) -> Result<Outcome, String> {
    if number.is_finite() {
        float(number)
    } else {
        Err("the result is no number".to_owned())
    }
}

fn whole(number: f64) -> Result<Outcome, String> {
    if number.abs() < 2e9 {
        value(Value::Int(number as i32))
    } else {
        Err(format!("{number} is too large"))
    }
}

fn three(args: &Args<'_>, index: usize) -> Result<Vector3<f64>, String> {
    let numbers = args.value(index).numbers();
    match numbers.as_deref() {
        Some([x, y, z]) if x.is_finite() && y.is_finite() && z.is_finite() => {
            Ok(Vector3::new(*x, *y, *z))
        }
        _ => Err(args.wrong(index, "a list of three numbers")),
    }
}

fn isometry(args: &Args<'_>, index: usize) -> Result<Isometry3<f64>, String> {
    args.pose(index).map(|pose| kinematics::from_pose(&pose))
}

fn pose(isometry: &Isometry3<f64>) -> Result<Outcome, String> {
    value(Value::Pose(kinematics::to_pose(isometry)))
}
