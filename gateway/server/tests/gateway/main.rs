//! The gateway as its clients see it, between small stand-ins of the four services it calls.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "clippy.toml allows them in tests, which leaves out the stand-ins that tests share"
)]

mod approval;
mod audit;
mod bench;
mod calibrations;
mod cases;
mod crash;
mod failover;
mod fakes;
mod halting;
mod input;
mod plans;
#[path = "../shared/postgres.rs"]
mod postgres;
mod procedure;
mod process;
mod recording;
mod recovery;
mod replicas;
mod storage;
mod verification;
mod watch;
