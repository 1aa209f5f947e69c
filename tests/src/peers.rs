//! Foreign programs that `tests/run` installs.

use std::path::PathBuf;
use std::process::Output;

use tokio::process::Command;

/// Runs a foreign program to its end.
pub async fn run(program: &str, arguments: &[&str]) -> Output {
    let folder = std::env::var_os("ARTHRO_PEERS").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../target/peers")),
        PathBuf::from,
    );
    let path = folder.join("bin").join(program);
    assert!(
        path.is_file(),
        "{} does not exist; `tests/run system` installs it",
        path.display()
    );
    Command::new(path)
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
