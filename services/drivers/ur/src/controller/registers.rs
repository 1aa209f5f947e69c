//! The registers between [`Controller`](super::Controller) and its program: encoding of commands, decoding of states.
//! The table is in [`program`](crate::program).

use crate::{
    Command, Error, Fault, ProgramState, RobotMode, RuntimeState, SafetyMode, State,
    program::FIRST_REGISTER,
    rtde::wire::{self, Type, Value},
};

const INPUT_INTS: usize = 8;
const INPUT_DOUBLES: usize = 24;
const OUTPUT_INTS: usize = 7;
/// Any prime will do: it makes every change of one byte of a number change its remainder.
const CHECK_MODULUS: i32 = 997;

/// What goes with every command.
#[derive(Clone, Copy, Debug)]
pub struct Envelope {
    /// Changes with every package.
    pub counter: i32,
    /// Of the command.
    pub sequence: i32,
    /// Of the program meant.
    pub session: i32,
    /// A fault was seen, so a hold acknowledges it.
    pub fault_seen: bool,
}

/// One package of inputs, in the order of [`input_names`].
pub fn inputs(envelope: &Envelope, command: &Command) -> [Value; INPUT_INTS + INPUT_DOUBLES] {
    let mut doubles = [0.0; INPUT_DOUBLES];
    let (mut first, mut last) = (0, 0);
    let mode = match command {
        Command::Hold => 0,
        Command::Stream(window) => {
            (first, last) = (window.first, window.last.unwrap_or(0));
            let samples = window.joints_rad.as_flattened();
            doubles
                .iter_mut()
                .zip(samples)
                .for_each(|(slot, value)| *slot = *value);
            1
        }
        Command::MoveL {
            base_from_tool,
            speed_m_s,
            accel_m_s2,
        } => {
            doubles[..6].copy_from_slice(base_from_tool);
            doubles[6..8].copy_from_slice(&[*speed_m_s, *accel_m_s2]);
            2
        }
        Command::MoveJ {
            joints_rad,
            speed_rad_s,
            accel_rad_s2,
        } => {
            doubles[..6].copy_from_slice(joints_rad);
            doubles[6..8].copy_from_slice(&[*speed_rad_s, *accel_rad_s2]);
            3
        }
        Command::Stop => 4,
    };
    let acknowledged = i32::from(envelope.fault_seen);
    let (counter, sequence) = (envelope.counter, envelope.sequence);
    let ints = [
        counter,
        mode,
        sequence,
        envelope.session,
        acknowledged,
        first,
        last,
        check(
            &[counter, mode, sequence, acknowledged, first, last],
            &doubles,
        ),
    ];
    let mut values = [Value::Int32(0); INPUT_INTS + INPUT_DOUBLES];
    let all = ints
        .into_iter()
        .map(Value::Int32)
        .chain(doubles.into_iter().map(Value::Double));
    values
        .iter_mut()
        .zip(all)
        .for_each(|(slot, value)| *slot = value);
    values
}

/// The program computes the same, and does not take a package of which it differs by more than its rounding.
fn check(ints: &[i32; 6], doubles: &[f64; INPUT_DOUBLES]) -> i32 {
    let sum: f64 = (1..)
        .zip(doubles)
        .map(|(weight, value)| f64::from(weight) * value)
        .sum();
    let weighted = [7, 11, 13, 17, 19, 23]
        .iter()
        .zip(ints)
        .map(|(weight, number)| weight * (number % CHECK_MODULUS));
    // Commands are checked before: 300 times the largest value they may have is far within an i32.
    (sum * 1e5).floor() as i32 + weighted.sum::<i32>()
}

/// Names and types of the inputs.
pub fn input_names() -> Vec<(String, Type)> {
    let named = |kind: &str, count: usize, of: Type| -> Vec<(String, Type)> {
        (FIRST_REGISTER..FIRST_REGISTER + count)
            .map(|n| (format!("input_{kind}_register_{n}"), of))
            .collect()
    };
    [
        named("int", INPUT_INTS, Type::Int32),
        named("double", INPUT_DOUBLES, Type::Double),
    ]
    .concat()
}

/// Names and types of the outputs.
pub fn output_names() -> Vec<(String, Type)> {
    let state = [
        ("timestamp", Type::Double),
        ("actual_q", Type::Vector6D),
        ("target_q", Type::Vector6D),
        ("actual_qd", Type::Vector6D),
        ("actual_TCP_pose", Type::Vector6D),
        ("robot_mode", Type::Int32),
        ("safety_mode", Type::Int32),
        ("runtime_state", Type::UInt32),
        ("speed_scaling", Type::Double),
        ("target_speed_fraction", Type::Double),
    ];
    let registers = (FIRST_REGISTER..FIRST_REGISTER + OUTPUT_INTS)
        .map(|n| (format!("output_int_register_{n}"), Type::Int32));
    state
        .into_iter()
        .map(|(name, kind)| (name.to_owned(), kind))
        .chain(registers)
        .collect()
}

/// A state as the controller sent it.
#[derive(Clone, Copy, Debug)]
pub struct Received {
    /// With what the program reports, if it is the one of this session; whether it lives is for the caller to judge.
    pub state: State,
    /// Changes as long as the program runs.
    pub beat: i32,
}

/// Reads one package in the order of [`output_names`].
///
/// # Errors
/// A package shorter than the recipe.
pub fn outputs(mut fields: &[u8], session: i32, sequence_sent: i32) -> Result<Received, Error> {
    let mut next = |kind| Value::decode(kind, &mut fields).ok_or(SHORT);
    let mut state = State {
        timestamp_s: double(next(Type::Double)?),
        actual_q: vector(next(Type::Vector6D)?),
        target_q: vector(next(Type::Vector6D)?),
        actual_qd: vector(next(Type::Vector6D)?),
        actual_tcp_pose: vector(next(Type::Vector6D)?),
        robot_mode: RobotMode::from_code(int(next(Type::Int32)?)),
        safety_mode: SafetyMode::from_code(int(next(Type::Int32)?)),
        runtime_state: RuntimeState::from_code(int(next(Type::UInt32)?)),
        speed_scaling: double(next(Type::Double)?),
        target_speed_fraction: double(next(Type::Double)?),
        program: ProgramState {
            sequence_sent,
            ..ProgramState::default()
        },
    };
    let mut registers = [0; OUTPUT_INTS];
    for register in &mut registers {
        *register = int(next(Type::Int32)?);
    }
    let [
        program_session,
        sequence_running,
        sequence_done,
        fault,
        missed_cycles,
        sample_consumed,
        beat,
    ] = registers;
    if session != 0 && program_session == session {
        state.program = ProgramState {
            ready: state.runtime_state == RuntimeState::Playing,
            sequence_sent,
            sequence_running,
            sequence_done,
            missed_cycles,
            // What an earlier stream had consumed says nothing of this one.
            sample_consumed: if sequence_running == sequence_sent {
                sample_consumed
            } else {
                0
            },
            fault: Fault::from_code(fault),
        };
    }
    Ok(Received { state, beat })
}

const SHORT: Error = Error::Wire(wire::Error::Short(b'U'));

fn double(value: Value) -> f64 {
    if let Value::Double(value) = value {
        value
    } else {
        f64::NAN
    }
}

fn vector(value: Value) -> [f64; 6] {
    if let Value::Vector6D(values) = value {
        values
    } else {
        [f64::NAN; 6]
    }
}

fn int(value: Value) -> i32 {
    match value {
        Value::Int32(value) => value,
        Value::UInt32(value) => value as i32,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Window;

    #[test]
    fn any_one_number_that_changes_on_its_way_changes_the_check() {
        let ints = [1_000_003, 1, 42, 0, 7, 0];
        let mut doubles = [0.0; INPUT_DOUBLES];
        doubles
            .iter_mut()
            .zip(1..)
            .for_each(|(slot, n)| *slot = 0.1 * f64::from(n) - 1.3);
        let whole = check(&ints, &doubles);
        for which in 0..6 {
            for bit in 0..31 {
                let mut changed = ints;
                changed[which] ^= 1 << bit;
                let apart = check(&changed, &doubles) - whole;
                assert!(apart.abs() > 2, "int {which}, bit {bit}: {apart}");
            }
        }
        for which in 0..INPUT_DOUBLES {
            let mut changed = doubles;
            changed[which] += 1e-4;
            assert!((check(&ints, &changed) - whole).abs() > 2, "double {which}");
        }
    }

    #[test]
    fn a_window_fills_the_registers_in_order() {
        let envelope = Envelope {
            counter: 5,
            sequence: 3,
            session: 9,
            fault_seen: false,
        };
        let joints_rad = std::array::from_fn(|n| [n as f64; 6]);
        let window = Window {
            first: 11,
            joints_rad,
            last: Some(13),
        };
        let values = inputs(&envelope, &Command::Stream(window));
        assert_eq!(values[5..7], [Value::Int32(11), Value::Int32(13)]);
        assert_eq!(values[8 + 6], Value::Double(1.0));
        assert_eq!(values[8 + 23], Value::Double(3.0));
        assert_eq!(values.len(), input_names().len());
    }
}
