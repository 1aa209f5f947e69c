//! Numbers, lists, poses and texts.

use std::sync::Arc;

use super::{Args, Builtin, Outcome, Param, flag, float, required, value};
use crate::ur5::{kinematics, motion, urscript::value::Value};

/// Longest text a program can make.
const MAX_TEXT: usize = 1023;

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
        name: "norm",
        params: &[required("a")],
        call: |_, args| match args.value(0) {
            Value::Pose(pose) => {
                float(pose[..3].iter().map(|part| part * part).sum::<f64>().sqrt())
            }
            list @ Value::List(_) => {
                let numbers = list
                    .numbers()
                    .ok_or_else(|| args.wrong(0, "a list of numbers"))?;
                float(numbers.iter().map(|part| part * part).sum::<f64>().sqrt())
            }
            _ => float(args.number(0)?.abs()),
        },
    },
    Builtin {
        name: "length",
        params: &[required("v")],
        call: |_, args| match args.value(0) {
            Value::List(items) => value(Value::Int(items.len() as i32)),
            Value::Text(text) => value(Value::Int(text.len() as i32)),
            Value::Pose(_) => value(Value::Int(6)),
            _ => Err(args.wrong(0, "a list")),
        },
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
        name: "to_str",
        params: &[required("val")],
        call: |_, args| text(args.value(0).to_string()),
    },
    Builtin {
        name: "to_num",
        params: &[required("str")],
        call: |_, args| {
            let word = args.text(0)?.trim();
            if let Ok(number) = word.parse::<i32>() {
                return value(Value::Int(number));
            }
            real(word.parse().map_err(|_| format!("{word:?} is no number"))?)
        },
    },
    Builtin {
        name: "str_cat",
        params: &[required("op1"), required("op2")],
        call: |_, args| text(format!("{}{}", args.value(0), args.value(1))),
    },
    Builtin {
        name: "str_empty",
        params: &[required("str")],
        call: |_, args| flag(args.text(0)?.is_empty()),
    },
    Builtin {
        name: "integer_to_binary_list",
        params: &[required("x")],
        call: |_, args| {
            let number = args.whole(0)?;
            let bits = (0..32)
                .map(|bit| Value::Bool(number >> bit & 1 == 1))
                .collect();
            value(Value::List(Arc::new(bits)))
        },
    },
    Builtin {
        name: "binary_list_to_integer",
        params: &[required("l")],
        call: |_, args| {
            let Value::List(bits) = args.value(0) else {
                return Err(args.wrong(0, "a list of bools"));
            };
            if bits.len() > 32 {
                return Err(format!("{} bits, at most 32", bits.len()));
            }
            let word = bits
                .iter()
                .enumerate()
                .try_fold(0u32, |word, (bit, on)| match on {
                    Value::Bool(on) => Ok(word | u32::from(*on) << bit),
                    other => Err(format!("{} where a bool should be", other.kind())),
                })?;
            value(Value::Int(word as i32))
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

fn isometry(args: &Args<'_>, index: usize) -> Result<nalgebra::Isometry3<f64>, String> {
    args.pose(index).map(|pose| kinematics::from_pose(&pose))
}

fn pose(isometry: &nalgebra::Isometry3<f64>) -> Result<Outcome, String> {
    value(Value::Pose(kinematics::to_pose(isometry)))
}

fn text(text: String) -> Result<Outcome, String> {
    if text.len() > MAX_TEXT {
        return Err(format!(
            "a text of {} characters, at most {MAX_TEXT}",
            text.len()
        ));
    }
    value(Value::Text(Arc::from(text)))
}
