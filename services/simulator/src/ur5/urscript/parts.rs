//! Parts of values: elements of lists and poses, members of structs, and the methods of lists.

use std::{ops::RangeInclusive, sync::Arc};

use super::value::{MAX_WEIGHT, Value};

/// From a variable to one of its parts.
pub type Path = Arc<[PathStep]>;

/// One step of a [`Path`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathStep {
    /// `[index]`, whose value is on the stack.
    Index,
    /// `.name`
    Member(Arc<str>),
}

/// Methods of lists (software 5.15).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// `append(value)`
    Append,
    /// `capacity()`
    Capacity,
    /// `clear()`
    Clear,
    /// `extend(list)`
    Extend,
    /// `insert(index, value)`
    Insert,
    /// `length()`
    Length,
    /// `pop()`
    Pop,
    /// `remove(index)`
    Remove,
    /// `slice(begin, end)`
    Slice,
    /// `to_string()`
    ToString,
}

impl Method {
    /// As programs call it.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "append" => Self::Append,
            "capacity" => Self::Capacity,
            "clear" => Self::Clear,
            "extend" => Self::Extend,
            "insert" => Self::Insert,
            "length" => Self::Length,
            "pop" => Self::Pop,
            "remove" => Self::Remove,
            "slice" => Self::Slice,
            "to_string" => Self::ToString,
            _ => return None,
        })
    }

    /// How many arguments it takes.
    pub fn arguments(self) -> RangeInclusive<usize> {
        match self {
            Self::Append | Self::Extend | Self::Remove => 1..=1,
            Self::Insert => 2..=2,
            Self::Slice => 1..=2,
            Self::Capacity | Self::Clear | Self::Length | Self::Pop | Self::ToString => 0..=0,
        }
    }

    /// Calls it for what a path leads to; the arguments are as many as it takes.
    ///
    /// # Errors
    /// No list, an index outside, or a list that is full.
    pub fn call(
        self,
        variable: &mut Value,
        path: &[PathStep],
        indices: &[Value],
        arguments: &[Value],
    ) -> Result<Value, String> {
        let value = part(variable, path, indices)?;
        if self == Self::ToString {
            return Ok(Value::Text(Arc::from(value.to_string())));
        }
        let Value::List(list) = value else {
            return Err(format!("{} has no such method", value.kind()));
        };
        let argument = |index: usize| arguments.get(index).unwrap_or(&Value::None);
        match self {
            Self::Capacity => return Ok(Value::Int(list.capacity as i32)),
            Self::Length => return Ok(Value::Int(list.len() as i32)),
            Self::Slice => {
                let begin = position(argument(0), list.len() + 1)?;
                let end = match arguments.get(1) {
                    Some(end) => position(end, list.len() + 1)?,
                    None => list.len(),
                };
                let items = list
                    .get(begin..end)
                    .ok_or("a slice that ends before it begins")?;
                return Ok(Value::list(items.to_vec()));
            }
            _ => {}
        }
        let capacity = list.capacity;
        let more = match (self, argument(0)) {
            (Self::Append | Self::Insert, _) => 1,
            (Self::Extend, Value::List(other)) => other.len(),
            (Self::Extend, other) => {
                return Err(format!("{} where a list should be", other.kind()));
            }
            _ => 0,
        };
        if list.len() + more > capacity {
            return Err(format!("a list of at most {capacity} elements is full"));
        }
        let items = &mut Arc::make_mut(list).items;
        match self {
            Self::Append => items.push(argument(0).clone()),
            Self::Insert => {
                let at = position(argument(0), items.len() + 1)?;
                items.insert(at, argument(1).clone());
            }
            Self::Extend => {
                if let Value::List(other) = argument(0) {
                    items.extend_from_slice(other);
                }
            }
            Self::Pop => return items.pop().ok_or_else(|| "pop of an empty list".to_owned()),
            Self::Remove => {
                let at = position(argument(0), items.len())?;
                return Ok(items.remove(at));
            }
            Self::Clear => items.clear(),
            Self::Capacity | Self::Length | Self::Slice | Self::ToString => {}
        }
        Ok(Value::None)
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

/// `value.name`
pub fn member(value: &Value, name: &str) -> Result<Value, String> {
    let Value::Struct(members) = value else {
        return Err(format!("{} has no members", value.kind()));
    };
    let found = members.iter().find(|(member, _)| **member == *name);
    found
        .map(|(_, value)| value.clone())
        .ok_or_else(|| format!("no member {name}"))
}

/// `variable[index].name = value`. A list takes the elements of another as far as it has room for them.
pub fn store(
    variable: &mut Value,
    path: &[PathStep],
    indices: &[Value],
    value: Value,
) -> Result<(), String> {
    let Some((last, way)) = path.split_last() else {
        return Err("nothing to store into".to_owned());
    };
    let (index, indices) = match (last, indices.split_last()) {
        (PathStep::Index, Some((index, before))) => (index, before),
        _ => (&Value::None, indices),
    };
    let owner = part(variable, way, indices)?;
    if let (Value::Pose(pose), PathStep::Index) = (&mut *owner, last) {
        let number = value.number().ok_or("a pose is made of numbers")?;
        pose[position(index, 6)?] = number;
        return Ok(());
    }
    *step(owner, last, index)? = value;
    Ok(())
}

/// The index of an element of so many.
fn position(index: &Value, length: usize) -> Result<usize, String> {
    let number = match index {
        Value::Int(number) => Some(f64::from(*number)),
        Value::Float(number) if number.fract() == 0.0 => Some(*number),
        _ => None,
    };
    let number = number.ok_or_else(|| format!("{} where an index should be", index.kind()))?;
    if (0.0..length.min(MAX_WEIGHT) as f64).contains(&number) {
        Ok(number as usize)
    } else {
        Err(format!("index {number} in a list of {length}"))
    }
}

/// What a path leads to.
fn part<'v>(
    variable: &'v mut Value,
    path: &[PathStep],
    indices: &[Value],
) -> Result<&'v mut Value, String> {
    let mut indices = indices.iter();
    path.iter().try_fold(variable, |value, next| {
        let index = match next {
            PathStep::Index => indices.next().unwrap_or(&Value::None),
            PathStep::Member(_) => &Value::None,
        };
        step(value, next, index)
    })
}

fn step<'v>(value: &'v mut Value, step: &PathStep, index: &Value) -> Result<&'v mut Value, String> {
    match (value, step) {
        (Value::List(list), PathStep::Index) => {
            let at = position(index, list.len())?;
            Ok(&mut Arc::make_mut(list).items[at])
        }
        (Value::Struct(members), PathStep::Member(name)) => Arc::make_mut(members)
            .iter_mut()
            .find(|(member, _)| member == name)
            .map(|(_, value)| value)
            .ok_or_else(|| format!("no member {name}")),
        (other, PathStep::Index) => Err(format!("{} has no elements", other.kind())),
        (other, PathStep::Member(_)) => Err(format!("{} has no members", other.kind())),
    }
}
