//! Plans on the phantom and on real menisci, as properties, and over gRPC.
#![allow(clippy::unwrap_used, clippy::panic)]

mod evaluation;
mod menisci;
mod paper;
mod phantom;
mod properties;
mod reach;
mod server;
mod target;
mod view;
mod world;
