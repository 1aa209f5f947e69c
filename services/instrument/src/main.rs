//! The instrument server.

fn main() -> std::process::ExitCode {
    arthro_bootstrap::main::<arthro_instrument::Server>()
}
