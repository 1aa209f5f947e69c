//! Real-Time Data Exchange, the controller's binary state and register interface on port 30004.
//!
//! [`Client`] is asynchronous, [`Reader`] blocks a thread of its own; both give the newest state however many wait. Which
//! fields are exchanged is told by structs that [`outputs!`](crate::outputs) and [`inputs!`](crate::inputs) make, or
//! by names at run time ([`Client::setup_outputs`]). [`wire`] is the codec without I/O, for both directions.

mod client;
pub mod fields;
mod freshness;
mod inbox;
mod reader;
mod recipe;
mod sample;
mod version;
pub mod wire;

pub use client::{Client, InputRecipe, OutputRecipe, Publication};
pub use reader::{Latest, Reader, Writer};
pub use recipe::{FieldValue, Inputs, Outputs};
pub use sample::{Sample, Subscription};
pub use version::{ControllerVersion, Since};
