//! The planning server.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_planning::Server>()
}
