//! The URScript program that runs on the controller while a [`Controller`](crate::Controller) is connected.
//!
//! Each cycle it reads a command from input registers and reports in output registers; all in the upper range 24..47
//! that is meant for external clients:
//!
//! | register | input | output |
//! |---|---|---|
//! | int 24 | counter, changes with every package | session: this program runs |
//! | int 25 | mode: 0 hold, 1 servo, 2 movel, 3 movej, 4 stop | sequence running |
//! | int 26 | sequence, changes with every new command | sequence done |
//! | int 27 | session of the client | fault |
//! | int 28 | 1: the fault was seen | missed cycles |
//! | double 24..29 | target: joints, or base from tool | |
//! | double 30, 31 | speed, acceleration | |
//!
//! Registers outlive their writers on both sides, so both name the session, a number new at each upload: a program never
//! obeys what an earlier client left behind, a client never believes what an earlier program reported.

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
