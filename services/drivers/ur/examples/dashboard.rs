//! Tells what a controller is and does, and with `--power` brings the arm up:
//! `cargo run --example dashboard -- 192.168.0.10`.

use std::{env, time::Duration};

use ur_link::{Dashboard, Error, RobotMode};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Error> {
    let host = env::args().nth(1).unwrap_or_else(|| "127.0.0.1".into());
    let mut dashboard = Dashboard::connect(&host, 29999, Duration::from_secs(2)).await?;
    println!("software {}", dashboard.polyscope_version().await?);
    println!("robot    {}", dashboard.robot_mode().await?);
    println!("safety   {}", dashboard.safety_mode().await?);
    let (player, name) = dashboard.program_state().await?;
    println!("program  {player} {name}");
    match dashboard.is_in_remote_control().await {
        Ok(remote) => println!("remote   {remote}"),
        // CB3 has no such mode.
        Err(Error::Refused { answer, .. }) => println!("remote   {answer}"),
        Err(error) => return Err(error),
    }
    if env::args().any(|word| word == "--power") {
        dashboard.power_on().await?;
        // Accepted is not done: the mode says when it is.
        while dashboard.robot_mode().await? != RobotMode::Idle {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        dashboard.brake_release().await?;
    }
    dashboard.quit().await
}
