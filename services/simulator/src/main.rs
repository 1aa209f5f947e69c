//! Serves the simulated operating cell, or with `ur5` as first argument one controller alone.

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os();
    let name = arguments.next();
    let mut rest = arguments.peekable();
    if rest.next_if(|first| first == "ur5").is_some() {
        return arthro_simulator::standalone::main(name.into_iter().chain(rest)).into();
    }
    arthro_bootstrap::main::<arthro_simulator::Server>()
}
