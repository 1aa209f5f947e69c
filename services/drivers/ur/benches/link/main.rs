//! A stand-in controller that stamps each state with the system's monotonic clock when it sends it, and our clients beside it.
//! `tests/bench/rtde.py` runs them, and clients from elsewhere against the same stand-in:
//!
//! ```text
//! link serve HOST RATE                 RATE states a second, or "flood"; port 30004; ends with its input
//! link read KIND HOST HZ SECONDS       KIND is client, reader or latest; prints one line of JSON
//! ```
#![allow(missing_docs, clippy::unwrap_used)]

mod read;
mod serve;

use std::process::ExitCode;

use rustix::time::{ClockId, clock_gettime};

/// CLOCK_MONOTONIC, s. All processes of a machine share it.
fn now_s() -> f64 {
    let time = clock_gettime(ClockId::Monotonic);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

const PORT: u16 = 30004;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["serve", host, rate] => serve::serve(host, rate.parse().ok()),
        ["read", kind, host, hz, seconds] => {
            println!(
                "{}",
                read::read(kind, host, hz.parse().unwrap(), seconds.parse().unwrap())
            );
        }
        // As part of `cargo bench` there is nothing to do: the figures mean something only beside others'.
        _ => println!("link: run by tests/bench/rtde.py"),
    }
    ExitCode::SUCCESS
}
