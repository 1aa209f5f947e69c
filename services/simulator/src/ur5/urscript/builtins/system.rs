//! Time, messages, and the program itself.

use super::{Builtin, Default, Outcome, Param, float, nothing, required};
use crate::ur5::{
    registers::Input,
    robot::{Message, WatchdogAction},
    urscript::interpreter::Wait,
};

/// Longest message to clients.
const MAX_MESSAGE: usize = 1000;

const NONE: &[Param] = &[];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "sync",
        params: NONE,
        call: |_, _| Ok(Outcome::Wait(Wait::Cycle)),
    },
    Builtin {
        name: "sleep",
        params: &[required("t")],
        call: |context, args| {
            Ok(Outcome::Wait(Wait::Until(
                context.robot.now_s() + args.number(0)?,
            )))
        },
    },
    Builtin {
        name: "get_steptime",
        params: NONE,
        call: |context, _| float(context.robot.step_s()),
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
            let text = shortened(format!("{}{}", args.value(0), args.value(1)));
            context.robot.log.push(Message::Text(text));
            nothing()
        },
    },
    Builtin {
        name: "popup",
        params: &[
            required("s"),
            Param {
                name: "title",
                default: Default::Text("Popup"),
            },
            Param {
                name: "warning",
                default: Default::Flag(false),
            },
            Param {
                name: "error",
                default: Default::Flag(false),
            },
            Param {
                name: "blocking",
                default: Default::Flag(false),
            },
        ],
        call: |context, args| {
            context
                .robot
                .log
                .push(Message::Popup(shortened(args.value(0).to_string())));
            nothing()
        },
    },
    Builtin {
        name: "protective_stop",
        params: NONE,
        call: |context, _| {
            context.robot.protective_stop("asked for by the program");
            Ok(Outcome::Wait(Wait::Cycle))
        },
    },
    Builtin {
        name: "assert",
        params: &[required("b")],
        call: |_, args| {
            if args.flag(0)? {
                nothing()
            } else {
                Err("assertion failed".to_owned())
            }
        },
    },
    Builtin {
        name: "rtde_set_watchdog",
        params: &[
            required("variable_name"),
            required("min_frequency"),
            Param {
                name: "action",
                default: Default::Text("pause"),
            },
        ],
        call: |context, args| {
            let name = args.text(0)?;
            let input = Input::from_name(name).ok_or_else(|| format!("no input {name}"))?;
            let action = match args.text(2)? {
                "pause" => WatchdogAction::Pause,
                "stop" => WatchdogAction::Stop,
                "ignore" => WatchdogAction::Ignore,
                other => return Err(format!("action {other} is none of pause, stop, ignore")),
            };
            context.robot.set_watchdog(input, args.positive(1)?, action);
            nothing()
        },
    },
];

fn shortened(mut text: String) -> String {
    let mut end = text.len().min(MAX_MESSAGE);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.truncate(end);
    text
}
