//! The journal itself, without a gateway around it: what both databases promise, and what only one can break.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "clippy.toml allows them in tests, which leaves out what tests share"
)]

mod contract;
#[path = "../shared/postgres.rs"]
mod postgres;
mod store;
mod values;
