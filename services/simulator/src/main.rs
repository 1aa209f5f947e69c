//! Serves the simulated operating cell, or with `ur5` or `epos4` as first argument one such device alone.

use std::process::ExitCode;

use arthro_simulator::standalone;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os();
    let name = arguments.next();
    let mut rest = arguments.peekable();
    if rest.next_if(|first| first == "ur5").is_some() {
        return standalone::ur5::main(name.into_iter().chain(rest)).into();
    }
    if rest.next_if(|first| first == "epos4").is_some() {
        return standalone::epos4::main(name.into_iter().chain(rest)).into();
    }
    arthro_bootstrap::main::<arthro_simulator::Server>()
}
