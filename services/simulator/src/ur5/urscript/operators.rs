//! What operators and indices do with values.

use std::{cmp::Ordering, sync::Arc};

use super::{
    syntax::{Binary, Unary},
    value::Value,
};

/// A condition must be a bool.
pub fn truth(value: &Value) -> Result<bool, String> {
    if let Value::Bool(value) = value {
        Ok(*value)
    } else {
        Err(format!("{} where a bool should be", value.kind()))
    }
}

/// A list whose own elements are lists.
pub fn is_nested(value: &Value) -> bool {
    matches!(value, Value::List(items) if items.iter().any(|item| matches!(item, Value::List(_))))
}

fn position(index: &Value, length: usize) -> Result<usize, String> {
    let number = match index {
        Value::Int(number) => Some(f64::from(*number)),
        Value::Float(number) if number.fract() == 0.0 => Some(*number),
        _ => None,
    };
    let number = number.ok_or_else(|| format!("{} where an index should be", index.kind()))?;
    if number >= 0.0 && number < length as f64 {
        Ok(number as usize)
    } else {
        Err(format!("index {number} in a list of {length}"))
    }
}

/// `list[index]`
pub fn item(list: &Value, index: &Value) -> Result<Value, String> {
    match list {
        Value::List(items) => Ok(items[position(index, items.len())?].clone()),
        Value::Pose(pose) => Ok(Value::Float(pose[position(index, 6)?])),
        other => Err(format!("{} has no elements", other.kind())),
    }
}

/// `variable[index] = value`
pub fn store_item(variable: &mut Value, index: &Value, value: Value) -> Result<(), String> {
    match variable {
        Value::List(items) => {
            let at = position(index, items.len())?;
            if is_nested(&value) {
                return Err("lists are at most two levels deep".to_owned());
            }
            Arc::make_mut(items)[at] = value;
        }
        Value::Pose(pose) => {
            let number = value.number().ok_or("a pose is made of numbers")?;
            pose[position(index, 6)?] = number;
        }
        other => return Err(format!("{} has no elements", other.kind())),
    }
    Ok(())
}

/// `-a`, `not a`
pub fn unary(operator: Unary, operand: &Value) -> Result<Value, String> {
    match (operator, operand) {
        (Unary::Not, value) => Ok(Value::Bool(!truth(value)?)),
        (Unary::Negate, Value::Int(value)) => Ok(Value::Int(value.wrapping_neg())),
        (Unary::Negate, Value::Float(value)) => Ok(Value::Float(-value)),
        (Unary::Negate, other) => Err(format!("- of {}", other.kind())),
    }
}

/// Operators that evaluate both sides.
pub fn binary(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    let mismatch = || format!("{} and {} do not go together", left.kind(), right.kind());
    match operator {
        Binary::Equal => return left.equals(right).map(Value::Bool).ok_or_else(mismatch),
        Binary::NotEqual => {
            return left
                .equals(right)
                .map(|equal| Value::Bool(!equal))
                .ok_or_else(mismatch);
        }
        Binary::Xor => return Ok(Value::Bool(truth(left)? != truth(right)?)),
        _ => {}
    }
    if let (Value::Int(a), Value::Int(b)) = (left, right) {
        match operator {
            Binary::Add => return Ok(Value::Int(a.wrapping_add(*b))),
            Binary::Subtract => return Ok(Value::Int(a.wrapping_sub(*b))),
            Binary::Multiply => return Ok(Value::Int(a.wrapping_mul(*b))),
            Binary::Modulo if *b != 0 => return Ok(Value::Int(a.wrapping_rem(*b))),
            _ => {}
        }
    }
    let (Some(a), Some(b)) = (left.number(), right.number()) else {
        return Err(mismatch());
    };
    let ordered = |wanted: &[Ordering]| {
        Ok(Value::Bool(
            a.partial_cmp(&b)
                .is_some_and(|order| wanted.contains(&order)),
        ))
    };
    match operator {
        Binary::Add => Ok(Value::Float(a + b)),
        Binary::Subtract => Ok(Value::Float(a - b)),
        Binary::Multiply => Ok(Value::Float(a * b)),
        Binary::Divide | Binary::Modulo if b == 0.0 => Err("division by zero".to_owned()),
        // Of two whole numbers, too, the quotient is a float.
        Binary::Divide => Ok(Value::Float(a / b)),
        Binary::Modulo => Ok(Value::Float(a % b)),
        Binary::Less => ordered(&[Ordering::Less]),
        Binary::LessEqual => ordered(&[Ordering::Less, Ordering::Equal]),
        Binary::Greater => ordered(&[Ordering::Greater]),
        Binary::GreaterEqual => ordered(&[Ordering::Greater, Ordering::Equal]),
        Binary::Equal | Binary::NotEqual | Binary::Xor => Err(mismatch()),
    }
}
