//! Drives a Universal Robots arm over its own wire protocols: the dashboard (29999), RTDE (30004), the primary, secondary
//! and realtime interfaces (30001 to 30003) and URScript. Real and simulated controllers are reached by the same code;
//! only the address differs.
//!
//! Whoever only watches takes [`rtde::Reader`]. Whoever moves an arm takes [`Controller`]: it powers the arm, uploads a
//! small URScript program (see [`program`]) and then exchanges one state and one command per controller cycle through
//! RTDE registers.
//!
//! ```no_run
//! use ur_link::{Command, Controller, Endpoint, Options, RobotLink};
//! # async fn demo() -> Result<(), ur_link::Error> {
//! let mut arm = Controller::connect(Options::new(Endpoint::new("192.168.0.10"))).await?;
//! let command = Command::MoveJ { joints_rad: [0.0, -1.5, 1.5, -1.5, -1.5, 0.0], speed_rad_s: 0.5, accel_rad_s2: 1.0 };
//! let mut sent = false;
//! loop {
//!     let state = arm.next_state().await?;
//!     arm.send(&command).await?; // one package per state: it is also the keep-alive
//!     if sent && state.program.finished() {
//!         break;
//!     }
//!     sent = true;
//! }
//! # Ok(()) }
//! ```
//!
//! Units are those of the robot, on purpose and only here: metres, radians, seconds, rotation vectors.
//! The parts can be used alone: [`rtde::wire`] is a codec without I/O for both directions, [`rtde::Client`] speaks RTDE
//! with any recipe ([`outputs!`], [`inputs!`]), [`Dashboard`] the dashboard protocol, [`Primary`] and [`Realtime`] read the
//! older interfaces, [`Script`] follows a program, [`Calibration`] is that of the very arm.
//!
//! Nothing here reconnects by itself: after an error a connection is of no more use, and whoever makes a new one decides
//! what that means. No reconnect moves anything.

mod calibration;
mod codes;
mod controller;
pub mod dashboard;
mod error;
mod identity;
mod link;
pub mod primary;
pub mod program;
pub mod realtime;
pub mod rtde;
pub mod script;
mod stream;

pub use calibration::{Calibration, Model};
pub use codes::{RobotMode, RuntimeState, SafetyMode};
pub use controller::Controller;
pub use dashboard::Dashboard;
pub use error::Error;
pub use identity::{Expected, Identity, Series};
pub use link::{Command, Endpoint, Fault, Options, ProgramState, RobotLink, Servo, Startup, State};
pub use primary::Primary;
pub use realtime::Realtime;
pub use script::Script;
pub use stream::{Stream, WINDOW_SAMPLES, Window};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
