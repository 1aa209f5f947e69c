//! Simulated maxon EPOS4 drives on a CAN bus: a [`Node`] answers as the real drive does, frame by frame, and turns a
//! shaft with friction, load and hard stops; [`Drives`] are all of one bus; [`Bus`], [`socketcand`] and [`wire`] put them
//! on a wire that foreign CANopen masters speak.
//!
//! All but the last three are pure: time comes in as seconds of the cell's clock.

pub mod bus;
mod defects;
mod drive;
mod drives;
mod errors;
mod fault;
mod homing;
mod inputs;
mod interpolation;
mod mechanics;
mod network;
mod node;
mod objects;
mod outputs;
mod parameters;
mod pdo;
mod positioning;
mod shaft;
pub mod socketcand;
mod thermal;
mod trajectory;
pub mod wire;

pub use bus::Bus;
pub use drives::Drives;
pub use fault::{Active, Fault, MAX_FAULTS};
pub use mechanics::{Contact, INPUT_COUNT, Input, Mechanics};
pub use node::{Node, NodeConfig};
pub use shaft::Motor;
