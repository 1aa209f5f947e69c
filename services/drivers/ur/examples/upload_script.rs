//! Sends a program from a file and tells what became of it; **the arm may move**:
//! `cargo run --example upload_script -- 192.168.0.10 program.script`.

use std::{env, error::Error, fs, time::Duration};

use ur_link::{Primary, Script, script::Outcome};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut words = env::args().skip(1);
    let host = words.next().ok_or("give HOST and FILE")?;
    let script = Script::new(fs::read_to_string(words.next().ok_or("give FILE")?)?)?;
    let mut primary = Primary::connect(&host, 30001, Duration::from_secs(2)).await?;
    script.run(&mut primary, Duration::from_secs(5)).await?;
    println!("{} runs", script.name());
    match script
        .outcome(&mut primary, Duration::from_secs(600))
        .await?
    {
        Outcome::Ended => println!("it ended"),
        Outcome::Failed(exception) | Outcome::NotCompiled(exception) => {
            println!("it failed at {exception}");
        }
    }
    Ok(())
}
