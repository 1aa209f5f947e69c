//! The primary and secondary interfaces (ports 30001 and 30002, read-only on 30011 and 30012): ten times a second the
//! robot's state in sub-packages, and on the primary one the messages of controller and programs.
//!
//! [`wire`] cuts packets off a stream and reads them without I/O; [`Primary`] is a client that gives them one by one.

mod client;
mod state;
pub mod wire;

pub use client::Primary;
pub use state::{
    Cartesian, Configuration, Force, Joint, Kinematics, Masterboard, Mode, RobotState, Tool,
};
pub use wire::{Message, Notice};
