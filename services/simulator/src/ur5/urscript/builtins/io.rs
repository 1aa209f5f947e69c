//! Registers, digital and analog signals.

use super::{Args, Builtin, Context, Outcome, Param, flag, float, nothing, required, value};
use crate::ur5::{
    registers::{BITS, Bank, COUNT, Outputs},
    urscript::value::Value,
};

const REGISTER: &[Param] = &[required("address")];
const REGISTER_AND_VALUE: &[Param] = &[required("address"), required("value")];
const OUTPUT: &[Param] = &[required("n"), required("b")];
const DOMAIN: &[Param] = &[required("port"), required("domain")];
const NUMBER: &[Param] = &[required("n")];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "read_input_integer_register",
        params: REGISTER,
        call: |context, args| value(Value::Int(context.robot.inputs.ints[below(args, COUNT)?])),
    },
    Builtin {
        name: "read_input_float_register",
        params: REGISTER,
        call: |context, args| float(context.robot.inputs.doubles[below(args, COUNT)?]),
    },
    Builtin {
        name: "read_input_boolean_register",
        params: REGISTER,
        call: |context, args| flag(context.robot.inputs.bit(below(args, BITS)?)),
    },
    Builtin {
        name: "read_output_integer_register",
        params: REGISTER,
        call: |context, args| value(Value::Int(context.robot.outputs.ints[below(args, COUNT)?])),
    },
    Builtin {
        name: "read_output_float_register",
        params: REGISTER,
        call: |context, args| float(context.robot.outputs.doubles[below(args, COUNT)?]),
    },
    Builtin {
        name: "read_output_boolean_register",
        params: REGISTER,
        call: |context, args| flag(context.robot.outputs.bit(below(args, BITS)?)),
    },
    Builtin {
        name: "write_output_integer_register",
        params: REGISTER_AND_VALUE,
        call: |context, args| {
            let number = args.whole(1)?;
            write(context, args, COUNT, |bank, register| {
                bank.ints[register] = number
            })
        },
    },
    Builtin {
        name: "write_output_float_register",
        params: REGISTER_AND_VALUE,
        call: |context, args| {
            let number = args.number(1)?;
            write(context, args, COUNT, |bank, register| {
                bank.doubles[register] = number
            })
        },
    },
    Builtin {
        name: "write_output_boolean_register",
        params: REGISTER_AND_VALUE,
        call: |context, args| {
            let on = args.flag(1)?;
            write(context, args, BITS, |bank, register| {
                bank.set_bit(register, on)
            })
        },
    },
    Builtin {
        name: "set_standard_digital_out",
        params: OUTPUT,
        call: |context, args| set_output(context, args, Outputs::Standard),
    },
    Builtin {
        name: "set_configurable_digital_out",
        params: OUTPUT,
        call: |context, args| set_output(context, args, Outputs::Configurable),
    },
    Builtin {
        name: "set_tool_digital_out",
        params: OUTPUT,
        call: |context, args| set_output(context, args, Outputs::Tool),
    },
    Builtin {
        name: "get_standard_digital_out",
        params: NUMBER,
        call: |context, args| {
            let number = below(args, 8)?;
            flag(context.robot.digital_outputs >> number & 1 == 1)
        },
    },
    Builtin {
        name: "get_configurable_digital_out",
        params: NUMBER,
        call: |context, args| {
            let number = below(args, 8)?;
            flag(context.robot.digital_outputs >> (8 + number) & 1 == 1)
        },
    },
    Builtin {
        name: "get_tool_digital_out",
        params: NUMBER,
        call: |context, args| {
            let number = below(args, 2)?;
            flag(context.robot.digital_outputs >> (16 + number) & 1 == 1)
        },
    },
    // The older names: 0 to 7 standard, 8 and 9 at the tool.
    Builtin {
        name: "set_digital_out",
        params: OUTPUT,
        call: |context, args| {
            let number = below(args, 10)? as u32;
            let on = args.flag(1)?;
            if number < 8 {
                context.robot.set_output(Outputs::Standard, number, on);
            } else {
                context.robot.set_output(Outputs::Tool, number - 8, on);
            }
            nothing()
        },
    },
    Builtin {
        name: "get_digital_out",
        params: NUMBER,
        call: |context, args| {
            let number = below(args, 10)?;
            let bit = if number < 8 { number } else { number + 8 };
            flag(context.robot.digital_outputs >> bit & 1 == 1)
        },
    },
    Builtin {
        name: "get_digital_in",
        params: NUMBER,
        call: |_, args| flag(below(args, 10)? > 10),
    },
    Builtin {
        name: "get_standard_analog_in",
        params: NUMBER,
        call: |_, args| below(args, 2).and_then(|_| float(0.0)),
    },
    Builtin {
        name: "get_tool_analog_in",
        params: NUMBER,
        call: |_, args| below(args, 2).and_then(|_| float(0.0)),
    },
    Builtin {
        name: "get_analog_in",
        params: NUMBER,
        call: |_, args| below(args, 4).and_then(|_| float(0.0)),
    },
    Builtin {
        name: "get_standard_analog_out",
        params: NUMBER,
        call: |context, args| float(context.robot.analog_outputs[below(args, 2)?]),
    },
    Builtin {
        name: "set_analog_out",
        params: &[required("n"), required("f")],
        call: |context, args| {
            context.robot.analog_outputs[below(args, 2)?] = args.number(1)?.clamp(0.0, 1.0);
            nothing()
        },
    },
    // Current or voltage makes no difference to signals that lead nowhere.
    Builtin {
        name: "set_standard_analog_input_domain",
        params: DOMAIN,
        call: |_, args| domain(args),
    },
    Builtin {
        name: "set_tool_analog_input_domain",
        params: DOMAIN,
        call: |_, args| domain(args),
    },
    Builtin {
        name: "set_analog_outputdomain",
        params: DOMAIN,
        call: |_, args| domain(args),
    },
    // No signal is wired to the inputs of this cell.
    Builtin {
        name: "get_standard_digital_in",
        params: NUMBER,
        call: |_, args| flag(below(args, 8)? > 8),
    },
    Builtin {
        name: "get_configurable_digital_in",
        params: NUMBER,
        call: |_, args| flag(below(args, 8)? > 8),
    },
    Builtin {
        name: "get_tool_digital_in",
        params: NUMBER,
        call: |_, args| flag(below(args, 2)? > 2),
    },
    Builtin {
        name: "set_standard_analog_out",
        params: &[required("n"), required("f")],
        call: |context, args| {
            context.robot.analog_outputs[below(args, 2)?] = args.number(1)?.clamp(0.0, 1.0);
            nothing()
        },
    },
];

fn domain(args: &Args<'_>) -> Result<Outcome, String> {
    below(args, 2)?;
    match args.whole(1)? {
        0 | 1 => nothing(),
        other => Err(format!("domain {other} is neither 0 nor 1")),
    }
}

fn below(args: &Args<'_>, count: usize) -> Result<usize, String> {
    let number = args.whole(0)?;
    let register = usize::try_from(number)
        .ok()
        .filter(|register| *register < count);
    register.ok_or_else(|| format!("{number} is not within 0 to {}", count - 1))
}

fn write(
    context: &mut Context<'_>,
    args: &Args<'_>,
    count: usize,
    store: impl FnOnce(&mut Bank, usize),
) -> Result<Outcome, String> {
    let register = below(args, count)?;
    store(&mut context.robot.outputs, register);
    nothing()
}

fn set_output(
    context: &mut Context<'_>,
    args: &Args<'_>,
    group: Outputs,
) -> Result<Outcome, String> {
    let number = below(args, group.count() as usize)?;
    context
        .robot
        .set_output(group, number as u32, args.flag(1)?);
    nothing()
}
