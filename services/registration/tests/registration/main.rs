//! The registration against problems whose truth is known, and its server against good and bad clients.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a helper that fails fails its test"
)]

mod calibration;
mod depth_cleaning;
mod depth_cloud;
mod depth_scene;
mod depth_service;
mod properties;
mod public_cases;
mod rendered_views;
mod service;
mod world;
mod wrong_models;
