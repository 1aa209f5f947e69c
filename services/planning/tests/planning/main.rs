//! Plans on the phantom and on real menisci, as properties, and over gRPC.
#![allow(clippy::unwrap_used, clippy::panic)]

mod menisci;
mod phantom;
mod properties;
mod reach;
mod server;
mod world;
