//! Serves the simulated operating cell.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_simulator::Server>()
}
