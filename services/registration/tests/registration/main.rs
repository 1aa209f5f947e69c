//! The registration against problems whose truth is known, and its server against good and bad clients.

mod properties;
mod public_cases;
mod rendered_views;
mod service;
mod world;
