//! The gateway as its clients see it, between small stand-ins of the four services it calls.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "clippy.toml allows them in tests, which leaves out the stand-ins that tests share"
)]

mod bench;
mod cases;
mod crash;
mod fakes;
mod halting;
mod input;
mod plans;
mod procedure;
mod recovery;
