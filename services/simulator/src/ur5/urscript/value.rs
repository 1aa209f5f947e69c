//! Values of URScript.

use std::{fmt, sync::Arc};

/// Scalars in one value: bounds what one operation can cost.
pub const MAX_WEIGHT: usize = 4096;
/// Lists and structs inside each other.
const MAX_NESTING: usize = 4;

/// Elements and how many there may be.
#[derive(Clone, Debug, PartialEq)]
pub struct List {
    /// The elements.
    pub items: Vec<Value>,
    /// Most that methods may make of them.
    pub capacity: usize,
}

impl std::ops::Deref for List {
    type Target = [Value];

    fn deref(&self) -> &[Value] {
        &self.items
    }
}

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
    /// List of values; of lists of numbers, a matrix.
    List(Arc<List>),
    /// `p[x, y, z, rx, ry, rz]`
    Pose([f64; 6]),
    /// `struct(a=1)`
    Struct(Arc<Vec<(Arc<str>, Value)>>),
}

impl Value {
    /// A list of numbers.
    pub fn floats(values: &[f64]) -> Self {
        Self::list(values.iter().map(|value| Self::Float(*value)).collect())
    }

    /// A list that is full.
    pub fn list(items: Vec<Self>) -> Self {
        let capacity = items.len();
        Self::List(Arc::new(List { items, capacity }))
    }

    /// Scalars in it; of a text, a share of its length.
    pub fn weight(&self) -> usize {
        match self {
            Self::List(items) => 1 + items.iter().map(Self::weight).sum::<usize>(),
            Self::Struct(members) => {
                1 + members
                    .iter()
                    .map(|(_, value)| value.weight())
                    .sum::<usize>()
            }
            Self::Text(text) => 1 + text.len() / 16,
            Self::Pose(_) => 6,
            _ => 1,
        }
    }

    fn nesting(&self) -> usize {
        match self {
            Self::List(items) => 1 + items.iter().map(Self::nesting).max().unwrap_or_default(),
            Self::Struct(members) => {
                let inside = members.iter().map(|(_, value)| value.nesting());
                1 + inside.max().unwrap_or_default()
            }
            _ => 0,
        }
    }

    /// Its weight, when that and its depth are within what a program may make.
    pub fn bounded(&self) -> Result<usize, String> {
        let (weight, nesting) = (self.weight(), self.nesting());
        if weight > MAX_WEIGHT {
            return Err(format!(
                "a value of {weight} elements, at most {MAX_WEIGHT}"
            ));
        }
        if nesting > MAX_NESTING {
            return Err(format!("lists are at most {MAX_NESTING} levels deep"));
        }
        Ok(weight)
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
            Self::Struct(_) => "struct",
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
            Self::List(items) => list(f, "[", items.iter(), "]"),
            Self::Pose(pose) => {
                f.write_str("p")?;
                list(f, "[", pose.iter(), "]")
            }
            Self::Struct(members) => {
                f.write_str("struct(")?;
                for (index, (name, value)) in members.iter().enumerate() {
                    write!(f, "{}{name}={value}", if index == 0 { "" } else { ", " })?;
                }
                f.write_str(")")
            }
        }
    }
}

fn list<T: fmt::Display>(
    f: &mut fmt::Formatter<'_>,
    open: &str,
    items: impl Iterator<Item = T>,
    close: &str,
) -> fmt::Result {
    f.write_str(open)?;
    for (index, item) in items.enumerate() {
        write!(f, "{}{item}", if index == 0 { "" } else { ", " })?;
    }
    f.write_str(close)
}
