//! Plans on the phantom and on real menisci, as properties, and over gRPC.
#![allow(clippy::unwrap_used, clippy::panic)]

mod evaluation;
mod menisci;
mod paper;
mod phantom;
mod properties;
mod server;
<<<<<<< HEAD
mod target;
=======
mod view;
>>>>>>> a6925e266447a0d2e1c5345faf4e04d8c4ea1a2a
mod world;
