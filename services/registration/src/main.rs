//! The registration server.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_registration::Server>()
}
