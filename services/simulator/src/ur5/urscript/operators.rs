//! What operators do with values.

use std::cmp::Ordering;

use super::{
    arrays,
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

/// `-a`, `not a`
pub fn unary(operator: Unary, operand: &Value) -> Result<Value, String> {
    match (operator, operand) {
        (Unary::Not, value) => Ok(Value::Bool(!truth(value)?)),
        (Unary::Negate, Value::Int(value)) => Ok(Value::Int(value.wrapping_neg())),
        (Unary::Negate, Value::Float(value)) => Ok(Value::Float(-value)),
        (Unary::Negate, Value::List(_)) => {
            arrays::elementwise(Binary::Subtract, &Value::Int(0), operand)
        }
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
        return arrays::binary(operator, left, right).unwrap_or_else(|| Err(mismatch()));
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
