//! Values of URScript.

use std::{fmt, sync::Arc};

/// A value. Lists share their elements until one of them changes.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// What a function without `return` gives.
    None,
    /// `True`, `False`
    Bool(bool),
    /// Whole number, 32 bit.
    Int(i32),
    /// Number.
    Float(f64),
    /// Text.
    Text(Arc<str>),
    /// List of scalars, poses or flat lists.
    List(Arc<Vec<Value>>),
    /// `p[x, y, z, rx, ry, rz]`
    Pose([f64; 6]),
}

impl Value {
    /// A list of numbers.
    pub fn floats(values: &[f64]) -> Self {
        Self::List(Arc::new(
            values.iter().map(|value| Self::Float(*value)).collect(),
        ))
    }

    /// What it is, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Bool(_) => "bool",
            Self::Int(_) => "int",
            Self::Float(_) => "float",
            Self::Text(_) => "string",
            Self::List(_) => "list",
            Self::Pose(_) => "pose",
        }
    }

    /// Int or float.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Int(value) => Some(f64::from(*value)),
            Self::Float(value) => Some(*value),
            _ => None,
        }
    }

    /// A list of numbers, or the elements of a pose.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Self::List(items) => items.iter().map(Self::number).collect(),
            Self::Pose(pose) => Some(pose.to_vec()),
            _ => None,
        }
    }

    /// A list of six numbers, or the elements of a pose.
    pub fn six(&self) -> Option<[f64; 6]> {
        if let Self::Pose(pose) = self {
            Some(*pose)
        } else {
            self.numbers()?.try_into().ok()
        }
    }

    /// The same value, or equal numbers. `None` for values that cannot be compared.
    pub fn equals(&self, other: &Self) -> Option<bool> {
        match (self, other) {
            (Self::List(a), Self::List(b)) => Some(
                a.len() == b.len()
                    && a.iter()
                        .zip(b.iter())
                        .all(|(a, b)| a.equals(b) == Some(true)),
            ),
            (a, b) => match (a.number(), b.number()) {
                (Some(a), Some(b)) => Some(a == b),
                _ if a.kind() == b.kind() => Some(a == b),
                _ => None,
            },
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("None"),
            Self::Bool(true) => f.write_str("True"),
            Self::Bool(false) => f.write_str("False"),
            Self::Int(value) => write!(f, "{value}"),
            Self::Float(value) => write!(f, "{value}"),
            Self::Text(text) => f.write_str(text),
            Self::List(items) => {
                f.write_str("[")?;
                for (index, item) in items.iter().enumerate() {
                    write!(f, "{}{item}", if index == 0 { "" } else { ", " })?;
                }
                f.write_str("]")
            }
            Self::Pose(pose) => write!(f, "p{pose:?}"),
        }
    }
}
