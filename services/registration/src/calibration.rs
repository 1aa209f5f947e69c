//! Finds where camera, tool and shaft are mounted, from poses of the arm.
//!
//! - [`hand_eye`]: the camera beside the arm or on the flange, from views of a board; the board's own mounting (the
//!   robot-world transform) comes with it.
//! - [`tool_tip`]: the tip in the flange, from poses that turn about it in a divot.
//! - [`shaft_axis`]: the line of the shaft in the flange, from poses that turn about it, or from two pivots on it.
//! - [`tool`]: tip and shaft together, as the configuration of an arm takes them.
//! - [`board`]: the pose of a board from where its corners are seen.
//!
//! Every answer has a covariance and passes gates on poses, span, outliers, residual and uncertainty; one that does
//! not is refused by name, value and limit ([`gate`]).

pub mod board;
pub mod closed_form;
pub mod gate;
pub mod hand_eye;
pub mod input;
mod least_squares;
pub mod noise;
mod robot_world;
mod robust;
pub mod shaft_axis;
pub mod span;
pub mod tool;
pub mod tool_tip;
