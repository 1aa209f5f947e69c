//! Strings, counted in characters.

use std::sync::Arc;

use super::{Args, Builtin, Default, Outcome, Param, flag, number, required, value};
use crate::ur5::urscript::value::Value;

/// Longest text a program can make.
const MAX_TEXT: usize = 1023;

const STR: &[Param] = &[required("str")];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "to_str",
        params: &[required("val")],
        call: |_, args| text(args.value(0).to_string()),
    },
    Builtin {
        name: "to_num",
        params: STR,
        call: |_, args| {
            let word = args.text(0)?.trim();
            if let Ok(number) = word.parse::<i32>() {
                return value(Value::Int(number));
            }
            let number: f64 = word.parse().map_err(|_| format!("{word:?} is no number"))?;
            if number.is_finite() {
                value(Value::Float(number))
            } else {
                Err(format!("{word:?} is no number"))
            }
        },
    },
    Builtin {
        name: "str_at",
        params: &[required("src"), required("index")],
        call: |_, args| {
            let (source, at) = (args.text(0)?, args.whole(1)?);
            let character = usize::try_from(at)
                .ok()
                .and_then(|at| source.chars().nth(at))
                .ok_or_else(|| format!("index {at} in {} characters", source.chars().count()))?;
            text(character.to_string())
        },
    },
    Builtin {
        name: "str_cat",
        params: &[required("op1"), required("op2")],
        call: |_, args| text(format!("{}{}", args.value(0), args.value(1))),
    },
    Builtin {
        name: "str_empty",
        params: STR,
        call: |_, args| flag(args.text(0)?.is_empty()),
    },
    Builtin {
        name: "str_find",
        params: &[
            required("src"),
            required("target"),
            number("start_from", 0.0),
        ],
        call: |_, args| {
            let (source, target) = (args.text(0)?, args.text(1)?);
            let start = usize::try_from(args.whole(2)?).map_err(|_| "start_from is below 0")?;
            let skipped: usize = source.chars().take(start).map(char::len_utf8).sum();
            let found = source[skipped..].find(target);
            let position =
                found.map_or(-1, |bytes| source[..skipped + bytes].chars().count() as i32);
            value(Value::Int(position))
        },
    },
    Builtin {
        name: "str_len",
        params: STR,
        call: |_, args| value(Value::Int(args.text(0)?.chars().count() as i32)),
    },
    Builtin {
        name: "str_sub",
        params: &[required("src"), required("index"), number("len", -1.0)],
        call: |_, args| {
            let (source, at, length) = (args.text(0)?, args.whole(1)?, args.whole(2)?);
            let count = source.chars().count();
            let at = usize::try_from(at)
                .ok()
                .filter(|at| *at <= count)
                .ok_or_else(|| format!("index {at} in {count} characters"))?;
            // Without a length, or with a negative one: the rest.
            let length = usize::try_from(length).unwrap_or(count);
            text(source.chars().skip(at).take(length).collect())
        },
    },
    Builtin {
        name: "integer_to_binary_list",
        params: &[required("x")],
        call: |_, args| {
            let number = args.whole(0)?;
            let bits = (0..32)
                .map(|bit| Value::Bool(number >> bit & 1 == 1))
                .collect();
            value(Value::list(bits))
        },
    },
    Builtin {
        name: "binary_list_to_integer",
        params: &[required("l")],
        call: binary_list_to_integer,
    },
    Builtin {
        name: "textmsg",
        params: &[
            required("s1"),
            Param {
                name: "s2",
                default: Default::Text(""),
            },
        ],
        call: |context, args| {
            let text = super::system::shortened(format!("{}{}", args.value(0), args.value(1)));
            context
                .robot
                .log
                .push(crate::ur5::robot::Message::Text(text));
            super::nothing()
        },
    },
];

fn binary_list_to_integer(_: &mut super::Context<'_>, args: &Args<'_>) -> Result<Outcome, String> {
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
