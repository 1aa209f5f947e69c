//! Real-Time Data Exchange, the controller's binary state and register interface on port 30004.

mod client;
pub mod wire;

pub use client::{Client, InputRecipe, OutputRecipe};
