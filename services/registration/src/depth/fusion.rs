//! More than one look at the same thing: frames of one camera that stands still are averaged pixel by pixel
//! ([`frames`]), clouds from several viewpoints are brought together in one frame ([`views`]).

pub mod frames;
pub mod views;
