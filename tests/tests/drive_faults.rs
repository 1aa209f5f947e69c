//! Every fault of the simulated drives in every state of the service: home, move, bite, and holding after a bite.
#![allow(
    clippy::panic,
    clippy::unwrap_used,
    reason = "a test says why it failed by panicking"
)]
use arthro_simulator::bench::JawConfig;
use arthro_tests::drives::DriveWorld;
use arthro_instrument::drives::Command;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn try_it() {
    let begun = std::time::Instant::now();
    let mut world = DriveWorld::up(JawConfig::default()).await;
    println!("up {:?} {:?}", begun.elapsed(), world.truth());
    world.home_all().await;
    println!("homed {:?} {:?}", begun.elapsed(), world.truth());
    world.succeed(Command::OpenJaw).await;
    let report = world.run(Command::Bite { current_limit_ma: 400.0 }).await;
    println!("bit {:?} {:?} {report:?}", begun.elapsed(), world.truth());
}
