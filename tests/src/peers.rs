//! Foreign programs that `tests/run` installs.

use std::path::PathBuf;
use std::process::Output;

use tokio::process::Command;

/// Where a foreign program is.
pub fn program(name: &str) -> PathBuf {
    let folder = std::env::var_os("ARTHRO_PEERS").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../target/peers")),
        PathBuf::from,
    );
    let path = folder.join("bin").join(name);
    assert!(
        path.is_file(),
        "{} does not exist; `tests/run system` installs it",
        path.display()
    );
    path
}

/// Runs a foreign program to its end.
pub async fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name))
        .args(arguments)
        .output()
        .await
        .expect("the program runs")
}

/// Standard output and standard error together.
pub fn text(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}
