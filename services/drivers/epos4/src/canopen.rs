//! CANopen (CiA 301): the bytes of each service and the state machines on top of them, without I/O.

pub mod emcy;
pub mod heartbeat;
pub mod nmt;
pub mod object;
pub mod pdo;
pub mod sdo;
pub mod sync;
