//! Prints joints and modes ten times a second: `cargo run --example read_state -- 192.168.0.10`.

use std::{env, time::Duration};

use ur_link::{Error, RobotMode, SafetyMode, rtde::Reader};

ur_link::outputs! {
    struct State {
        actual_q: [f64; 6],
        robot_mode: RobotMode,
        safety_mode: SafetyMode,
    }
}

fn main() -> Result<(), Error> {
    let host = env::args().nth(1).unwrap_or_else(|| "127.0.0.1".into());
    let mut reader = Reader::<State>::connect(&host, 30004, 10.0, Duration::from_secs(2))?;
    loop {
        let sample = reader.next(Duration::from_secs(1))?;
        let State {
            actual_q,
            robot_mode,
            safety_mode,
        } = sample.state;
        println!(
            "{:10.3} s  {robot_mode} {safety_mode}  {actual_q:.4?}  missed {}  late {:?}",
            sample.timestamp_s, sample.skipped, sample.lateness
        );
    }
}
