//! Speaks CANopen (CiA 301) and CiA 402 with maxon EPOS4 drives over any of three buses: the kernel's SocketCAN, a
//! `socketcand` server, or a bus within the process.
//!
//! The codecs ([`frame`], [`canopen`], [`cia402`], [`bus::socketcand::text`]) do no I/O and serve both ends of the wire. [`network`] is the
//! master of a bus: it reads and writes typed [`objects`] of its nodes and reports heartbeats and emergencies.

pub mod bus;
pub mod canopen;
pub mod cia402;
pub mod dictionary;
pub mod eds;
mod entry;
pub mod frame;
pub mod network;
pub mod objects;

/// The examples of the README, compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
