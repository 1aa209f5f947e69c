//! A classic CAN frame, and a frame with the time at which it was on the bus.

pub mod candump;
pub mod error;

use std::fmt;
use std::time::Duration;

use self::error::Class;

/// The longest payload of a classic CAN frame, bytes.
pub const MAX_DATA_LEN: usize = 8;

/// One classic CAN data or error frame. Remote frames are not used by CANopen devices of today and not represented.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Frame {
    id: Id,
    data: [u8; MAX_DATA_LEN],
    len: u8,
}

impl Frame {
    /// A frame with up to 8 bytes; `None` when there are more.
    pub fn new(id: Id, data: &[u8]) -> Option<Self> {
        let mut padded = [0; MAX_DATA_LEN];
        padded.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self {
            id,
            data: padded,
            len: data.len() as u8,
        })
    }

    /// A standard frame whose length is known when compiling, as all CANopen services are.
    pub const fn standard<const N: usize>(cob_id: u16, data: [u8; N]) -> Self {
        const {
            assert!(
                N <= MAX_DATA_LEN,
                "a classic CAN frame carries at most 8 bytes"
            )
        };
        let mut padded = [0; MAX_DATA_LEN];
        let mut i = 0;
        while i < N {
            padded[i] = data[i];
            i += 1;
        }
        Self {
            id: Id::standard(cob_id),
            data: padded,
            len: N as u8,
        }
    }

    /// The identifier.
    pub const fn id(&self) -> Id {
        self.id
    }

    /// The payload, 0 to 8 bytes.
    pub fn data(&self) -> &[u8] {
        &self.data[..usize::from(self.len)]
    }

    /// The 11-bit identifier, which CANopen calls COB-ID; `None` for extended and error frames.
    pub const fn cob_id(&self) -> Option<u16> {
        match self.id {
            Id::Standard(id) => Some(id),
            Id::Extended(_) | Id::Error(_) => None,
        }
    }
}

impl fmt::Debug for Frame {
    /// As `candump` prints it: `601#4041600000000000`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}#", self.id)?;
        self.data()
            .iter()
            .try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

/// What identifies a frame on the bus.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Id {
    /// 11 bits.
    Standard(u16),
    /// 29 bits.
    Extended(u32),
    /// Not a frame of a node but a report of the controller: the error class bits of `linux/can/error.h`, see
    /// [`error::Report`].
    Error(u32),
}

impl Id {
    /// The highest 11-bit identifier.
    pub const MAX_STANDARD: u16 = 0x7FF;
    /// The highest 29-bit identifier, and the mask of the error class bits.
    pub const MAX_EXTENDED: u32 = 0x1FFF_FFFF;
    /// Error class bit: the controller went bus-off.
    pub const ERROR_BUS_OFF: u32 = Class::BUS_OFF;
    /// What the kernel sets in the identifier of an error frame, CAN_ERR_FLAG of `linux/can.h`.
    pub const ERROR_FLAG: u32 = 0x2000_0000;

    /// An 11-bit identifier; higher bits are cut off.
    pub const fn standard(id: u16) -> Self {
        Self::Standard(id & Self::MAX_STANDARD)
    }

    /// A 29-bit identifier; higher bits are cut off.
    pub const fn extended(id: u32) -> Self {
        Self::Extended(id & Self::MAX_EXTENDED)
    }
}

impl fmt::Display for Id {
    /// Three hexadecimal digits for 11 bits, eight for 29, as `candump` and `socketcand` write them.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Standard(id) => write!(f, "{id:03X}"),
            Self::Extended(id) => write!(f, "{id:08X}"),
            Self::Error(class) => write!(f, "{:08X}", Self::ERROR_FLAG | class),
        }
    }
}

/// A received frame with the time at which it was on the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stamped {
    /// The frame.
    pub frame: Frame,
    /// The clock of the bus at that moment: the kernel's, or that of the simulated cell. Only differences mean anything.
    pub stamp: Duration,
}
