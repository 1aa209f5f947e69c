//! Tool, payload and forces.

use super::{Args, Builtin, Context, Param, float, nothing, number, optional, required, value};
use crate::ur5::urscript::value::Value;

const NONE: &[Param] = &[];
const EXTERNAL_SENSOR: &[Param] = &[
    required("enable"),
    number("sensor_mass", 0.0),
    optional("sensor_measuring_offset"),
    optional("sensor_cog"),
];

pub(super) const FUNCTIONS: &[Builtin] = &[
    Builtin {
        name: "set_tcp",
        params: &[required("pose"), optional("tcp_name")],
        call: |context, args| {
            context.robot.set_tcp(args.pose(0)?);
            nothing()
        },
    },
    Builtin {
        name: "set_payload",
        params: &[required("m"), optional("cog")],
        call: |context, args| {
            set_mass(context, args)?;
            if args.is_given(1) {
                set_cog(context, args, 1)?;
            }
            nothing()
        },
    },
    Builtin {
        name: "set_payload_mass",
        params: &[required("m")],
        call: |context, args| {
            set_mass(context, args)?;
            nothing()
        },
    },
    Builtin {
        name: "set_payload_cog",
        params: &[required("CoG")],
        call: |context, args| {
            set_cog(context, args, 0)?;
            nothing()
        },
    },
    // The transition takes no time here.
    Builtin {
        name: "set_target_payload",
        params: &[
            required("m"),
            required("cog"),
            optional("inertia"),
            number("transition_time", 0.0),
        ],
        call: |context, args| {
            set_mass(context, args)?;
            set_cog(context, args, 1)?;
            nothing()
        },
    },
    Builtin {
        name: "get_tcp_offset",
        params: NONE,
        call: |context, _| value(Value::Pose(context.robot.tcp_offset)),
    },
    Builtin {
        name: "get_target_payload",
        params: NONE,
        call: |context, _| float(context.robot.payload_kg),
    },
    Builtin {
        name: "get_target_payload_cog",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.payload_cog_m)),
    },
    Builtin {
        name: "get_target_payload_inertia",
        params: NONE,
        call: |_, _| value(Value::floats(&[0.0; 6])),
    },
    // Nothing touches this arm. Force mode is accepted and keeps the arm where it is: it would move along the
    // compliant axes until something pushes back, and nothing would.
    Builtin {
        name: "force_mode",
        params: &[
            required("task_frame"),
            required("selection_vector"),
            required("wrench"),
            required("type"),
            required("limits"),
        ],
        call: |_, args| {
            args.pose(0)?;
            for list in [1, 2, 4] {
                args.six(list)?;
            }
            let kind = args.whole(3)?;
            if !(1..=3).contains(&kind) {
                return Err(format!("type {kind} is none of 1, 2, 3"));
            }
            nothing()
        },
    },
    Builtin {
        name: "end_force_mode",
        params: NONE,
        call: |_, _| nothing(),
    },
    Builtin {
        name: "force_mode_set_damping",
        params: &[required("damping")],
        call: |_, args| share(args, 0, 1.0),
    },
    Builtin {
        name: "force_mode_set_gain_scaling",
        params: &[required("scaling")],
        call: |_, args| share(args, 0, 2.0),
    },
    Builtin {
        name: "zero_ftsensor",
        params: NONE,
        call: |_, _| nothing(),
    },
    Builtin {
        name: "enable_external_ft_sensor",
        params: EXTERNAL_SENSOR,
        call: external_sensor,
    },
    Builtin {
        name: "ft_rtde_input_enable",
        params: EXTERNAL_SENSOR,
        call: external_sensor,
    },
    Builtin {
        name: "get_tcp_force",
        params: NONE,
        call: |context, _| value(Value::floats(&context.robot.wrench())),
    },
    Builtin {
        name: "force",
        params: NONE,
        call: |context, _| {
            let [x, y, z, ..] = context.robot.wrench();
            float(x.hypot(y).hypot(z))
        },
    },
    Builtin {
        name: "get_joint_torques",
        params: NONE,
        call: |context, _| {
            let drives = &context.robot.drives;
            value(Value::floats(&drives.torque_nm(&drives.qd, &drives.qdd)))
        },
    },
    // 0 steps back: no contact.
    Builtin {
        name: "tool_contact",
        params: &[optional("direction")],
        call: |_, _| value(Value::Int(0)),
    },
    Builtin {
        name: "set_gravity",
        params: &[required("d")],
        call: |_, args| {
            let numbers = args.value(0).numbers();
            let given = numbers.is_some_and(|numbers| {
                numbers.len() == 3 && numbers.iter().all(|number| number.is_finite())
            });
            if given {
                nothing()
            } else {
                Err(args.wrong(0, "a list of three numbers"))
            }
        },
    },
    Builtin {
        name: "set_tool_voltage",
        params: &[required("voltage")],
        call: |_, args| match args.whole(0)? {
            0 | 12 | 24 => nothing(),
            other => Err(format!("{other} V is none of 0, 12, 24")),
        },
    },
    Builtin {
        name: "set_tool_communication",
        params: &[
            required("enabled"),
            required("baud_rate"),
            required("parity"),
            required("stop_bits"),
            required("rx_idle_chars"),
            required("tx_idle_chars"),
        ],
        call: |_, _| nothing(),
    },
];

/// What programs may name but this arm cannot do: a runtime exception once it is reached.
pub(super) const NOT_MODELLED: &[Builtin] = &[
    not_modelled(
        "direct_torque",
        &[
            required("torque"),
            optional("friction_comp"),
            optional("viscous_scale"),
            optional("coulomb_scale"),
        ],
    ),
    not_modelled(
        "get_mass_matrix",
        &[optional("q"), optional("include_rotors_inertia")],
    ),
    not_modelled(
        "get_coriolis_and_centrifugal_torques",
        &[optional("q"), optional("qd")],
    ),
    not_modelled(
        "get_jacobian_time_derivative",
        &[optional("q"), optional("qd"), optional("tcp")],
    ),
    not_modelled(
        "conveyor_pulse_decode",
        &[required("type"), required("A"), required("B")],
    ),
    not_modelled(
        "track_conveyor_linear",
        &[required("direction"), required("ticks_per_meter")],
    ),
    not_modelled(
        "track_conveyor_circular",
        &[
            required("center"),
            required("ticks_per_revolution"),
            number("rotate_tool", 0.0),
        ],
    ),
    not_modelled("stop_conveyor_tracking", &[optional("a")]),
    not_modelled(
        "set_conveyor_tick_count",
        &[
            required("tick_count"),
            optional("absolute_encoder_resolution"),
        ],
    ),
    not_modelled("get_conveyor_tick_count", NONE),
    not_modelled("path_offset_enable", NONE),
    not_modelled("path_offset_disable", &[optional("a")]),
    not_modelled("path_offset_set", &[required("offset"), required("type")]),
    not_modelled("screw_driving", &[required("f"), required("v_limit")]),
    not_modelled("end_screw_driving", NONE),
    not_modelled(
        "modbus_add_signal",
        &[
            required("IP"),
            required("slave_number"),
            required("signal_address"),
            required("signal_type"),
            required("signal_name"),
            optional("sequential_mode"),
        ],
    ),
    not_modelled(
        "modbus_get_signal_status",
        &[required("signal_name"), optional("is_secondary_program")],
    ),
    not_modelled(
        "modbus_set_output_register",
        &[
            required("signal_name"),
            required("register_value"),
            optional("is_secondary_program"),
        ],
    ),
    not_modelled(
        "modbus_set_output_signal",
        &[
            required("signal_name"),
            required("digital_value"),
            optional("is_secondary_program"),
        ],
    ),
    not_modelled("rpc_factory", &[required("type"), required("url")]),
    not_modelled("load_program", &[required("path")]),
    not_modelled(
        "interpreter_mode",
        &[optional("clearQueueOnEnter"), optional("clearOnEnd")],
    ),
];

const fn not_modelled(name: &'static str, params: &'static [Param]) -> Builtin {
    Builtin {
        name,
        params,
        call: |_, _| Err("this simulated arm does not model it".to_owned()),
    }
}

fn external_sensor(_: &mut Context<'_>, args: &Args<'_>) -> Result<super::Outcome, String> {
    args.flag(0)?;
    args.number(1)?;
    nothing()
}

fn share(args: &Args<'_>, index: usize, most: f64) -> Result<super::Outcome, String> {
    let number = args.number(index)?;
    if (0.0..=most).contains(&number) {
        nothing()
    } else {
        Err(format!("{number} is not within 0 to {most}"))
    }
}

fn set_mass(context: &mut Context<'_>, args: &Args<'_>) -> Result<(), String> {
    let mass_kg = args.number(0)?;
    if mass_kg < 0.0 {
        return Err(format!("mass is {mass_kg} kg, at least 0"));
    }
    context.robot.payload_kg = mass_kg;
    Ok(())
}

fn set_cog(context: &mut Context<'_>, args: &Args<'_>, index: usize) -> Result<(), String> {
    let numbers = args
        .value(index)
        .numbers()
        .filter(|numbers| numbers.iter().all(|number| number.is_finite()))
        .and_then(|numbers| numbers.try_into().ok());
    context.robot.payload_cog_m =
        numbers.ok_or_else(|| args.wrong(index, "a list of three numbers"))?;
    Ok(())
}
