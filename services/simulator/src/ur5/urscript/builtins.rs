//! The functions that URScript brings along. Names, parameters and defaults are those of the script manual for CB3.

mod arm;
mod io;
mod kinematics;
mod lists;
mod maths;
mod motion;
mod network;
mod system;
mod texts;
mod tool;
pub mod versions;

use std::sync::Arc;

use super::{interpreter::Wait, sockets::Sockets, value::Value};
use crate::ur5::robot::{Robot, ThreadId};

/// One function.
pub struct Builtin {
    /// As programs call it.
    pub name: &'static str,
    /// In order.
    pub params: &'static [Param],
    call: fn(&mut Context<'_>, &Args<'_>) -> Result<Outcome, String>,
}

/// One parameter.
pub struct Param {
    /// As programs name it.
    pub name: &'static str,
    /// Without one the argument must be given.
    pub default: Default,
}

/// Value of an argument that is not given.
#[derive(Clone, Copy)]
pub enum Default {
    /// None: it must be.
    Required,
    /// Number.
    Number(f64),
    /// Bool.
    Flag(bool),
    /// Text.
    Text(&'static str),
    /// The function finds its own.
    Absent,
}

/// What a function may touch.
pub struct Context<'a> {
    /// The arm.
    pub robot: &'a mut Robot,
    /// Who calls.
    pub thread: ThreadId,
    /// In a `sec`, which may not move.
    pub secondary: bool,
    /// Sockets of the program.
    pub sockets: &'a mut Sockets,
    /// How long a call that answered [`Outcome::Again`] has waited; `None` the first time.
    pub waited_s: Option<f64>,
}

/// What a function gives.
pub enum Outcome {
    /// At once.
    Value(Value),
    /// None, but later.
    Wait(Wait),
    /// Not yet: the same call comes again in the next cycle.
    Again,
}

/// The function of this name with its number.
pub fn find(name: &str) -> Option<(usize, &'static Builtin)> {
    all().enumerate().find(|(_, builtin)| builtin.name == name)
}

/// Calls a function by number; the arguments are complete.
///
/// # Errors
/// What becomes a runtime exception.
pub fn call(
    number: usize,
    context: &mut Context<'_>,
    arguments: &[Value],
) -> Result<Outcome, String> {
    let Some(builtin) = all().nth(number) else {
        return Err(format!("no built-in {number}"));
    };
    let args = Args {
        values: arguments,
        params: builtin.params,
    };
    (builtin.call)(context, &args).map_err(|text| format!("{}(): {text}", builtin.name))
}

/// How many plain operations a call counts for.
pub fn cost(number: usize) -> u32 {
    let searches = all()
        .nth(number)
        .is_some_and(|builtin| builtin.name.starts_with("get_inverse_kin"));
    if searches { 200 } else { 5 }
}

fn all() -> impl Iterator<Item = &'static Builtin> {
    arm::FUNCTIONS
        .iter()
        .chain(io::FUNCTIONS)
        .chain(kinematics::FUNCTIONS)
        .chain(lists::FUNCTIONS)
        .chain(maths::FUNCTIONS)
        .chain(motion::FUNCTIONS)
        .chain(network::FUNCTIONS)
        .chain(system::FUNCTIONS)
        .chain(texts::FUNCTIONS)
        .chain(tool::FUNCTIONS)
        .chain(tool::NOT_MODELLED)
}

/// Names with the most and the fewest arguments that they take.
#[cfg(test)]
pub fn signatures() -> &'static [(&'static str, usize, usize)] {
    static SIGNATURES: std::sync::OnceLock<Vec<(&'static str, usize, usize)>> =
        std::sync::OnceLock::new();
    SIGNATURES.get_or_init(|| {
        let least = |builtin: &Builtin| {
            let required = |param: &&Param| matches!(param.default, Default::Required);
            builtin.params.iter().filter(required).count()
        };
        all()
            .map(|builtin| (builtin.name, builtin.params.len(), least(builtin)))
            .collect()
    })
}

/// Arguments of one call.
pub struct Args<'a> {
    values: &'a [Value],
    params: &'static [Param],
}

impl Args<'_> {
    fn value(&self, index: usize) -> &Value {
        self.values.get(index).unwrap_or(&Value::None)
    }

    fn wrong(&self, index: usize, wanted: &str) -> String {
        let name = self
            .params
            .get(index)
            .map_or("argument", |param| param.name);
        format!("{name} is {}, not {wanted}", self.value(index).kind())
    }

    fn number(&self, index: usize) -> Result<f64, String> {
        let number = self
            .value(index)
            .number()
            .ok_or_else(|| self.wrong(index, "a number"))?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(format!("{number} where a finite number should be"))
        }
    }

    fn positive(&self, index: usize) -> Result<f64, String> {
        let number = self.number(index)?;
        let name = self
            .params
            .get(index)
            .map_or("argument", |param| param.name);
        if number > 0.0 {
            Ok(number)
        } else {
            Err(format!("{name} is {number}, must be above 0"))
        }
    }

    fn whole(&self, index: usize) -> Result<i32, String> {
        match self.value(index) {
            Value::Int(value) => Ok(*value),
            Value::Float(value) if value.fract() == 0.0 && value.abs() < 2e9 => Ok(*value as i32),
            _ => Err(self.wrong(index, "a whole number")),
        }
    }

    fn flag(&self, index: usize) -> Result<bool, String> {
        if let Value::Bool(value) = self.value(index) {
            Ok(*value)
        } else {
            Err(self.wrong(index, "a bool"))
        }
    }

    fn text(&self, index: usize) -> Result<&str, String> {
        if let Value::Text(text) = self.value(index) {
            Ok(text)
        } else {
            Err(self.wrong(index, "a string"))
        }
    }

    /// Six finite numbers: joints, or a twist.
    fn six(&self, index: usize) -> Result<[f64; 6], String> {
        let six = self
            .value(index)
            .six()
            .ok_or_else(|| self.wrong(index, "a list of six numbers"))?;
        if six.iter().all(|number| number.is_finite()) {
            Ok(six)
        } else {
            Err(self.wrong(index, "finite"))
        }
    }

    fn pose(&self, index: usize) -> Result<[f64; 6], String> {
        match self.value(index) {
            Value::Pose(_) => self.six(index),
            _ => Err(self.wrong(index, "a pose")),
        }
    }

    fn is_given(&self, index: usize) -> bool {
        !matches!(self.value(index), Value::None)
    }
}

impl Default {
    /// As a constant; `None` for an argument that must be given.
    pub fn value(self) -> Option<Value> {
        match self {
            Self::Required => None,
            Self::Number(value) => Some(Value::Float(value)),
            Self::Flag(value) => Some(Value::Bool(value)),
            Self::Text(text) => Some(Value::Text(Arc::from(text))),
            Self::Absent => Some(Value::None),
        }
    }
}

const fn required(name: &'static str) -> Param {
    Param {
        name,
        default: Default::Required,
    }
}

const fn number(name: &'static str, default: f64) -> Param {
    Param {
        name,
        default: Default::Number(default),
    }
}

const fn optional(name: &'static str) -> Param {
    Param {
        name,
        default: Default::Absent,
    }
}

fn value(value: Value) -> Result<Outcome, String> {
    Ok(Outcome::Value(value))
}

fn float(value: f64) -> Result<Outcome, String> {
    Ok(Outcome::Value(Value::Float(value)))
}

fn flag(value: bool) -> Result<Outcome, String> {
    Ok(Outcome::Value(Value::Bool(value)))
}

fn nothing() -> Result<Outcome, String> {
    Ok(Outcome::Value(Value::None))
}
