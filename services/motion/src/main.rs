//! The motion server.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_motion::Server>()
}
