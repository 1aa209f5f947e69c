//! Surfaces out of scans against shapes whose surface is known by formula, and against a real knee.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a helper that fails fails its test"
)]

mod accuracy;
mod real_knee;
mod refusals;
mod service;
mod shapes;
mod watertight;
