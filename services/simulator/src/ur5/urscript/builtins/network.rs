//! Sockets. All reads wait until what they want has arrived, the other side has closed, or their time is over.

use super::{Args, Builtin, Context, Default, Outcome, Param, flag, number, required, value};
use crate::ur5::urscript::{
    sockets::{Socket, State},
    value::Value,
};

/// Numbers that one read may want.
const MAX_NUMBERS: i32 = 30;
/// How long a connection may take to open, s.
const OPEN_TIMEOUT_S: f64 = 2.0;
/// Longest line or string taken.
const MAX_TEXT: usize = 1023;

const NAME: Param = Param {
    name: "socket_name",
    default: Default::Text("socket_0"),
};
const TIMEOUT: Param = number("timeout", 2.0);
const NUMBERS: &[Param] = &[required("number"), NAME, TIMEOUT];

const fn text(name: &'static str, default: &'static str) -> Param {
    Param {
        name,
        default: Default::Text(default),
    }
}

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "socket_open",
        params: &[required("address"), required("port"), NAME],
        call: open,
    },
    Builtin {
        name: "socket_close",
        params: &[NAME],
        call: |context, args| {
            context.sockets.close(args.text(0)?);
            super::nothing()
        },
    },
    Builtin {
        name: "socket_read_binary_integer",
        params: NUMBERS,
        call: |context, args| {
            let count = count(args)?;
            read(context, args, 1, 2, |socket| {
                if socket.received().len() < 4 * count {
                    return Ok(None);
                }
                let bytes = socket.take(4 * count);
                let numbers = bytes.chunks_exact(4).map(|word| {
                    Value::Int(i32::from_be_bytes([word[0], word[1], word[2], word[3]]))
                });
                Ok(Some(counted(count, numbers)))
            })
            .map(|read| read.or_else_with(|| counted(0, vec![Value::Int(-1); count].into_iter())))
        },
    },
    Builtin {
        name: "socket_read_byte_list",
        params: NUMBERS,
        call: |context, args| {
            let count = count(args)?;
            read(context, args, 1, 2, |socket| {
                if socket.received().len() < count {
                    return Ok(None);
                }
                let bytes = socket.take(count);
                let numbers = bytes.iter().map(|byte| Value::Int(i32::from(*byte)));
                Ok(Some(counted(count, numbers)))
            })
            .map(|read| read.or_else_with(|| counted(0, vec![Value::Int(-1); count].into_iter())))
        },
    },
    Builtin {
        name: "socket_read_ascii_float",
        params: NUMBERS,
        call: |context, args| {
            let count = count(args)?;
            read(context, args, 1, 2, |socket| ascii_floats(socket, count)).map(|read| {
                read.or_else_with(|| counted(0, vec![Value::Float(f64::NAN); count].into_iter()))
            })
        },
    },
    Builtin {
        name: "socket_read_line",
        params: &[NAME, TIMEOUT],
        call: |context, args| {
            read(context, args, 0, 1, |socket| {
                let Some(end) = find(socket.received(), b"\n") else {
                    return too_long(socket);
                };
                let mut line = socket.take(end + 1);
                line.truncate(end);
                if line.last() == Some(&b'\r') {
                    line.pop();
                }
                Ok(Some(string(&line)))
            })
            .map(|read| read.or_else_with(|| string(b"")))
        },
    },
    Builtin {
        name: "socket_read_string",
        params: &[
            NAME,
            text("prefix", ""),
            text("suffix", ""),
            Param {
                name: "interpret_escape",
                default: Default::Flag(false),
            },
            TIMEOUT,
        ],
        call: |context, args| {
            let (prefix, suffix) = (args.text(1)?.to_owned(), args.text(2)?.to_owned());
            let (prefix, suffix) = if args.flag(3)? {
                (unescaped(&prefix), unescaped(&suffix))
            } else {
                (prefix.into_bytes(), suffix.into_bytes())
            };
            read(context, args, 0, 4, |socket| {
                if prefix.is_empty() && suffix.is_empty() {
                    let all = socket.received().len().min(MAX_TEXT);
                    return Ok((all > 0).then(|| string(&socket.take(all))));
                }
                let Some(begin) = find(socket.received(), &prefix) else {
                    return too_long(socket);
                };
                let begin = begin + prefix.len();
                let Some(length) = find(&socket.received()[begin..], &suffix) else {
                    return too_long(socket);
                };
                // Without a suffix the string is all that has arrived.
                let length = if suffix.is_empty() {
                    socket.received().len() - begin
                } else {
                    length
                };
                let taken = socket.take(begin + length + suffix.len());
                let text = &taken[begin..begin + length];
                Ok(Some(string(&text[..text.len().min(MAX_TEXT)])))
            })
            .map(|read| read.or_else_with(|| string(b"")))
        },
    },
    Builtin {
        name: "socket_send_int",
        params: &[required("value"), NAME],
        call: |context, args| {
            let bytes = args.whole(0)?.to_be_bytes();
            send(context, args, 1, &bytes)
        },
    },
    Builtin {
        name: "socket_send_byte",
        params: &[required("value"), NAME],
        call: |context, args| {
            let number = args.whole(0)?;
            let byte = u8::try_from(number).map_err(|_| format!("{number} is no byte"))?;
            send(context, args, 1, &[byte])
        },
    },
    Builtin {
        name: "socket_send_string",
        params: &[required("str"), NAME],
        call: |context, args| {
            let text = args.value(0).to_string();
            send(context, args, 1, text.as_bytes())
        },
    },
    Builtin {
        name: "socket_send_line",
        params: &[required("str"), NAME],
        call: |context, args| {
            let line = format!("{}\n", args.value(0));
            send(context, args, 1, line.as_bytes())
        },
    },
    Builtin {
        name: "socket_set_var",
        params: &[required("name"), required("value"), NAME],
        call: |context, args| {
            let line = format!("SET {} {}\n", args.text(0)?, args.whole(1)?);
            send(context, args, 2, line.as_bytes())
        },
    },
    // Asks with "GET name", and takes the number behind the name in the answer.
    Builtin {
        name: "socket_get_var",
        params: &[required("name"), NAME],
        call: |context, args| {
            let name = args.text(0)?.to_owned();
            if context.waited_s.is_none() {
                let request = format!("GET {name}\n");
                let socket = context.sockets.get(args.text(1)?);
                if !socket.is_some_and(|socket| socket.send(request.as_bytes())) {
                    return value(Value::Int(0));
                }
            }
            let answer = read_for(context, args.text(1)?, OPEN_TIMEOUT_S, |socket| {
                let Some(end) = find(socket.received(), b"\n") else {
                    return too_long(socket);
                };
                let line = String::from_utf8_lossy(&socket.take(end + 1)).into_owned();
                let number = line
                    .trim()
                    .strip_prefix(name.as_str())
                    .and_then(|number| number.trim().parse().ok());
                Ok(Some(Value::Int(number.unwrap_or(0))))
            })?;
            Ok(answer.or_else_with(|| Value::Int(0)))
        },
    },
];

fn open(context: &mut Context<'_>, args: &Args<'_>) -> Result<Outcome, String> {
    let name = args.text(2)?;
    let Some(waited_s) = context.waited_s else {
        let number = args.whole(1)?;
        let port = u16::try_from(number).map_err(|_| format!("{number} is no port"))?;
        return match context.sockets.open(name, args.text(0)?, port) {
            Ok(()) => Ok(Outcome::Again),
            Err(reason) => {
                tracing::debug!(reason, "socket_open");
                flag(false)
            }
        };
    };
    match context.sockets.get(name).map(Socket::state) {
        Some(State::Open) => flag(true),
        Some(State::Connecting) if waited_s < OPEN_TIMEOUT_S => Ok(Outcome::Again),
        _ => {
            context.sockets.close(name);
            flag(false)
        }
    }
}

/// What has come of a read.
enum Read {
    Value(Value),
    NotYet,
    /// Time is over, the socket is closed, or there is none.
    Nothing,
}

impl Read {
    fn or_else_with(self, nothing: impl FnOnce() -> Value) -> Outcome {
        match self {
            Self::Value(value) => Outcome::Value(value),
            Self::NotYet => Outcome::Again,
            Self::Nothing => Outcome::Value(nothing()),
        }
    }
}

fn read(
    context: &mut Context<'_>,
    args: &Args<'_>,
    name: usize,
    timeout: usize,
    parse: impl FnOnce(&mut Socket) -> Result<Option<Value>, String>,
) -> Result<Read, String> {
    read_for(context, args.text(name)?, args.number(timeout)?, parse)
}

/// A timeout of 0 or less waits without end.
fn read_for(
    context: &mut Context<'_>,
    name: &str,
    timeout_s: f64,
    parse: impl FnOnce(&mut Socket) -> Result<Option<Value>, String>,
) -> Result<Read, String> {
    let Some(socket) = context.sockets.get(name) else {
        return Ok(Read::Nothing);
    };
    if let Some(value) = parse(socket)? {
        return Ok(Read::Value(value));
    }
    let late = timeout_s > 0.0 && context.waited_s.unwrap_or(0.0) >= timeout_s - 1e-9;
    Ok(if late || socket.is_exhausted() {
        Read::Nothing
    } else {
        Read::NotYet
    })
}

fn send(
    context: &mut Context<'_>,
    args: &Args<'_>,
    name: usize,
    bytes: &[u8],
) -> Result<Outcome, String> {
    let socket = context.sockets.get(args.text(name)?);
    flag(socket.is_some_and(|socket| socket.send(bytes)))
}

fn count(args: &Args<'_>) -> Result<usize, String> {
    let number = args.whole(0)?;
    if (1..=MAX_NUMBERS).contains(&number) {
        Ok(number as usize)
    } else {
        Err(format!("number is {number}, not within 1 to {MAX_NUMBERS}"))
    }
}

/// A list that begins with how many of its numbers were read.
fn counted(count: usize, numbers: impl Iterator<Item = Value>) -> Value {
    let mut list = vec![Value::Int(count as i32)];
    list.extend(numbers);
    Value::list(list)
}

/// `(1.0, 2.0)`: numbers between brackets. What stands before the bracket, and what is no such list, is left out.
fn ascii_floats(socket: &mut Socket, count: usize) -> Result<Option<Value>, String> {
    let Some(end) = find(socket.received(), b")") else {
        return too_long(socket);
    };
    let taken = socket.take(end + 1);
    let text = String::from_utf8_lossy(&taken[..end]).into_owned();
    let list = text.rsplit('(').next().unwrap_or_default();
    let numbers: Vec<f64> = list
        .split(',')
        .map_while(|number| number.trim().parse().ok())
        .filter(|number: &f64| number.is_finite())
        .take(count)
        .collect();
    let rest = vec![f64::NAN; count - numbers.len()];
    let floats = numbers
        .iter()
        .chain(&rest)
        .map(|number| Value::Float(*number));
    Ok(Some(counted(numbers.len(), floats)))
}

/// Nothing yet, unless so much has arrived without an end that none will be found.
fn too_long(socket: &mut Socket) -> Result<Option<Value>, String> {
    let arrived = socket.received().len();
    if arrived > MAX_TEXT * 2 {
        let beginning = socket.take(MAX_TEXT);
        return Ok(Some(string(&beginning)));
    }
    Ok(None)
}

fn string(bytes: &[u8]) -> Value {
    let mut text = String::from_utf8_lossy(bytes).into_owned();
    while text.len() > MAX_TEXT {
        text.pop();
    }
    Value::Text(text.into())
}

fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    if wanted.is_empty() {
        return Some(0);
    }
    bytes
        .windows(wanted.len())
        .position(|window| window == wanted)
}

/// `\n`, `\r` and `\t` as what they stand for.
fn unescaped(text: &str) -> Vec<u8> {
    text.replace("\\n", "\n")
        .replace("\\r", "\r")
        .replace("\\t", "\t")
        .into_bytes()
}
