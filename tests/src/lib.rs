//! The world of the tests that cross services: a whole simulated cell with all services, each in a
//! process of its own, on free loopback ports.
//!
//! ```ignore
//! let cell = Cell::up().await;
//! let mut motion = cell.motion().await;
//! // ...
//! cell.teardown().await;
//! ```

#![allow(clippy::panic, reason = "a test says why it failed by panicking")]

pub mod case;
pub mod cell;
pub mod command;
pub mod drives;
pub mod load;
pub mod peers;
pub mod proxy;

pub use cell::Cell;
