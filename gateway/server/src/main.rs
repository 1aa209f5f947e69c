//! The gateway's process: everything it does is in the library.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_gateway::Server>()
}
