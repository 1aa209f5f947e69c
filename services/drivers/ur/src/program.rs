//! The URScript program that runs on the controller while a [`Controller`](crate::Controller) is connected.
//!
//! Each cycle it reads a package of input registers and reports in output registers, all in the upper range 24..47 that
//! is meant for RTDE clients (software 3.9 or 5.3):
//!
//! | register | input | output |
//! |---|---|---|
//! | int 24 | counter, changes with every package | session: this program runs |
//! | int 25 | mode: 0 hold, 1 stream, 2 movel, 3 movej, 4 stop | sequence running |
//! | int 26 | sequence, grows with every new command | sequence done |
//! | int 27 | session of the client | fault, 0 for none |
//! | int 28 | 1: the fault was seen | missed: cycles since the last package |
//! | int 29 | stream: number of the first sample in this package | number of the sample commanded last |
//! | int 30 | stream: number of its last sample, 0 if not known yet | beat, changes as long as the program lives |
//! | int 31 | check | |
//! | double 24..47 | stream: four samples of six joints; moves: target (24..29), speed (30), acceleration (31) | |
//!
//! The check is `floor(1e5 sum(i v_i))` over the doubles v_1 .. v_24 plus 7, 11, 13, 17, 19, 23 times counter, mode,
//! sequence, seen, first and last, each modulo 997. **A package that fails it, or names another session, is as if it had
//! not come.** Its samples are copied, so that what comes later cannot change what is being read.
//!
//! Rules, by what the program does:
//!
//! | state | what it does | what ends it |
//! |---|---|---|
//! | hold | Nothing moves; servoj is not called. | A new sequence. |
//! | stream | Each call of `servoj` consumes the next number; at a speed scaling below 1 the call takes longer, so the path is stretched and no sample is skipped. A package that is late or lost is bridged from the three samples that follow in the last one. The last sample is held. | A new sequence; a fault. |
//! | movel, movej | The controller's own move, in a thread. | Its end; a new sequence; a fault. |
//! | fault | It has stopped the arm (`stopl` out of a movel, else `stopj`), tells the fault and obeys nothing. | A hold whose client has seen the fault. |
//!
//! | fault | when |
//! |---|---|
//! | 1 client silent | Moving, and no package for [`Options::silent_cycles`]. |
//! | 2 lead | A sample farther from the measured joints than [`Servo::max_lead_rad`](crate::Servo::max_lead_rad). |
//! | 3 unknown command | A mode that is none of the above. |
//! | 4 starved | The window is used up: the arm stops, and does not go on when samples come later. |
//! | 5 step | A sample farther from the one before than [`Servo::max_speed_rad_s`](crate::Servo::max_speed_rad_s) allows. |
//! | 6 gap | The sample due is older than the window. |
//! | 7 paused | More packages came than cycles were run: somebody paused the program and resumed it. |
//!
//! **No old target is ever continued.** A stop, a fault or a new command forgets what moved before. Sequences only grow, so
//! that a late or repeated package starts nothing. A program that is started again takes what it finds in its registers
//! for done. Registers outlive their writers on both sides, so both name the session, a number new at each upload: a
//! program never obeys what an earlier client left behind, a client never believes what an earlier program reported.
//!
//! `servoj` and `stopj` behave here as the manual tells and the simulated controller does; how a real arm decelerates
//! between the `kill` of a motion thread and the `stopj` after it is to be seen at a real arm.

use std::fmt::Write;

use crate::{Error, Options, link::in_range};

const TEMPLATE: &str = include_str!("program/link.script");

/// The first register of each kind that the program uses.
pub(crate) const FIRST_REGISTER: usize = 24;

/// The program for these options. `session` is any number but 0 that no earlier program on this controller had.
///
/// # Errors
/// An option that is not finite or out of its range.
pub fn text(options: &Options, session: i32) -> Result<String, Error> {
    let servo = &options.servo;
    in_range(
        "servo.lookahead_s",
        servo.lookahead_s,
        0.03..=0.2,
        "0.03 to 0.2",
    )?;
    in_range("servo.gain", servo.gain, 100.0..=2000.0, "100 to 2000")?;
    in_range(
        "servo.max_lead_rad",
        servo.max_lead_rad,
        1e-3..=3.2,
        "0.001 to 3.2",
    )?;
    in_range(
        "servo.max_speed_rad_s",
        servo.max_speed_rad_s,
        1e-3..=20.0,
        "0.001 to 20",
    )?;
    in_range(
        "stop_accel_rad_s2",
        options.stop_accel_rad_s2,
        0.1..=80.0,
        "0.1 to 80",
    )?;
    in_range(
        "stop_accel_m_s2",
        options.stop_accel_m_s2,
        0.01..=30.0,
        "0.01 to 30",
    )?;
    in_range("payload_kg", options.payload_kg, 0.0..=50.0, "0 to 50")?;
    for value in options.tcp_offset {
        in_range("tcp_offset", value, -10.0..=10.0, "-10 to 10")?;
    }
    let values = [
        ("@SESSION@", session.to_string()),
        ("@TCP@", list(&options.tcp_offset)),
        ("@PAYLOAD_KG@", number(options.payload_kg)),
        ("@SILENT_CYCLES@", options.silent_cycles.max(1).to_string()),
        ("@STOP_ACCEL_RAD_S2@", number(options.stop_accel_rad_s2)),
        ("@STOP_ACCEL_M_S2@", number(options.stop_accel_m_s2)),
        ("@MAX_LEAD_RAD@", number(servo.max_lead_rad)),
        ("@MAX_SPEED_RAD_S@", number(servo.max_speed_rad_s)),
        ("@LOOKAHEAD_S@", number(servo.lookahead_s)),
        ("@GAIN@", number(servo.gain)),
    ];
    Ok(values
        .iter()
        .fold(TEMPLATE.to_owned(), |text, (name, value)| {
            text.replace(name, value)
        }))
}

fn list(values: &[f64]) -> String {
    let mut text = String::from("[");
    for (index, value) in values.iter().enumerate() {
        let separator = if index == 0 { "" } else { ", " };
        let _ = write!(text, "{separator}{}", number(*value));
    }
    text + "]"
}

/// Always with a decimal point: URScript tells integers from floats.
fn number(value: f64) -> String {
    format!("{value:.9}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Endpoint;

    #[test]
    fn every_placeholder_is_filled() {
        let text = text(&Options::new(Endpoint::new("x")), 7).unwrap();
        assert!(!text.contains('@'), "{text}");
        assert!(text.contains("write_output_integer_register(24, 7)"));
    }

    #[test]
    fn an_option_that_is_not_a_number_is_refused() {
        let mut options = Options::new(Endpoint::new("x"));
        options.tcp_offset[2] = f64::NAN;
        assert!(matches!(
            text(&options, 7),
            Err(Error::Value {
                field: "tcp_offset",
                ..
            })
        ));
    }
}
