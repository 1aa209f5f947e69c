//! Lists and matrices.

use super::{Builtin, Param, float, number, required, value};
use crate::ur5::urscript::{
    arrays,
    value::{List, MAX_WEIGHT, Value},
};
use std::sync::Arc;

const MATRIX: &[Param] = &[required("m")];

pub(super) const FUNCTIONS: &[Builtin] = &[
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
        name: "normalize",
        params: &[required("v")],
        call: |_, args| {
            let numbers = args
                .value(0)
                .numbers()
                .ok_or_else(|| args.wrong(0, "a list of numbers"))?;
            let norm = numbers.iter().map(|part| part * part).sum::<f64>().sqrt();
            if norm.is_finite() && norm > 0.0 {
                let unit: Vec<_> = numbers.iter().map(|part| part / norm).collect();
                value(Value::floats(&unit))
            } else {
                Err(format!("a vector of length {norm} has no direction"))
            }
        },
    },
    Builtin {
        name: "length",
        params: &[required("v")],
        call: |_, args| match args.value(0) {
            Value::Text(text) => value(Value::Int(text.chars().count() as i32)),
            _ => value(Value::Int(
                length(args.value(0)).ok_or_else(|| args.wrong(0, "a list"))?,
            )),
        },
    },
    Builtin {
        name: "get_list_length",
        params: &[required("v")],
        call: |_, args| {
            value(Value::Int(
                length(args.value(0)).ok_or_else(|| args.wrong(0, "a list"))?,
            ))
        },
    },
    Builtin {
        name: "make_list",
        params: &[
            required("length"),
            required("initial_value"),
            number("capacity", -1.0),
        ],
        call: |_, args| {
            let (length, capacity) = (args.whole(0)?, args.whole(2)?);
            let capacity = if capacity < 0 { length } else { capacity };
            let most = MAX_WEIGHT as i32;
            if !(0..=capacity).contains(&length) || capacity > most {
                return Err(format!(
                    "length {length} and capacity {capacity}, at most {most}"
                ));
            }
            if args.value(1).weight() * (length as usize).max(1) > MAX_WEIGHT {
                return Err(format!("a list of more than {MAX_WEIGHT} elements"));
            }
            value(Value::List(Arc::new(List {
                items: vec![args.value(1).clone(); length as usize],
                capacity: capacity as usize,
            })))
        },
    },
    Builtin {
        name: "size",
        params: MATRIX,
        call: |_, args| match arrays::matrix(args.value(0)) {
            Some(matrix) => value(Value::list(vec![
                Value::Int(matrix.nrows() as i32),
                Value::Int(matrix.ncols() as i32),
            ])),
            None => value(Value::Int(
                length(args.value(0)).ok_or_else(|| args.wrong(0, "a list"))?,
            )),
        },
    },
    Builtin {
        name: "transpose",
        params: MATRIX,
        call: |_, args| {
            let matrix = arrays::matrix(args.value(0)).ok_or_else(|| args.wrong(0, "a matrix"))?;
            value(arrays::rows(&matrix.transpose()))
        },
    },
    Builtin {
        name: "inv",
        params: MATRIX,
        call: |_, args| {
            let matrix = arrays::matrix(args.value(0)).ok_or_else(|| args.wrong(0, "a matrix"))?;
            if matrix.nrows() != matrix.ncols() || matrix.iter().any(|number| !number.is_finite()) {
                return Err("only a square matrix of finite numbers has an inverse".to_owned());
            }
            let inverse = matrix.try_inverse().ok_or("a singular matrix")?;
            value(arrays::rows(&inverse))
        },
    },
];

fn length(value: &Value) -> Option<i32> {
    match value {
        Value::List(items) => Some(items.len() as i32),
        Value::Pose(_) => Some(6),
        _ => None,
    }
}
