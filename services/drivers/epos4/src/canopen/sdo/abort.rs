//! Why a drive, or a client, ends an SDO transfer: CiA 301 codes and the three that maxon adds.

use std::fmt;

/// An SDO abort code.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct AbortCode(pub u32);

macro_rules! abort_codes {
    ($($(#[$doc:meta])* $name:ident = $code:literal, $text:literal;)*) => {
        impl AbortCode {
            $(#[doc = $text] pub const $name: Self = Self($code);)*

            /// Every code that has a name here.
            pub const NAMED: &[Self] = &[$(Self::$name),*];

            /// What the code means; `None` for one that no table has.
            pub const fn text(self) -> Option<&'static str> {
                match self.0 {
                    $($code => Some($text),)*
                    _ => None,
                }
            }
        }
    };
}

abort_codes! {
    TOGGLE_BIT = 0x0503_0000, "toggle bit not alternated";
    TIMED_OUT = 0x0504_0000, "sdo protocol timed out";
    UNKNOWN_COMMAND = 0x0504_0001, "command specifier not valid or unknown";
    BLOCK_SIZE = 0x0504_0002, "invalid block size";
    SEQUENCE_NUMBER = 0x0504_0003, "invalid sequence number";
    CRC = 0x0504_0004, "crc error";
    OUT_OF_MEMORY = 0x0504_0005, "out of memory";
    UNSUPPORTED_ACCESS = 0x0601_0000, "unsupported access to an object";
    WRITE_ONLY = 0x0601_0001, "attempt to read a write-only object";
    READ_ONLY = 0x0601_0002, "attempt to write a read-only object";
    SUBINDEX_NOT_WRITABLE = 0x0601_0003, "subindex cannot be written, subindex 0 must be 0 for write access";
    NO_OBJECT = 0x0602_0000, "object does not exist in the object dictionary";
    NOT_MAPPABLE = 0x0604_0041, "object cannot be mapped to a pdo";
    PDO_LENGTH = 0x0604_0042, "mapped objects exceed the pdo length";
    PARAMETER_INCOMPATIBLE = 0x0604_0043, "general parameter incompatibility";
    INTERNAL_INCOMPATIBLE = 0x0604_0047, "general internal incompatibility in the device";
    HARDWARE = 0x0606_0000, "access failed due to a hardware error";
    LENGTH = 0x0607_0010, "data type or length does not match";
    TOO_LONG = 0x0607_0012, "data type does not match, too long";
    TOO_SHORT = 0x0607_0013, "data type does not match, too short";
    NO_SUBINDEX = 0x0609_0011, "subindex does not exist";
    VALUE_RANGE = 0x0609_0030, "value range of parameter exceeded";
    VALUE_TOO_HIGH = 0x0609_0031, "value of parameter written too high";
    VALUE_TOO_LOW = 0x0609_0032, "value of parameter written too low";
    GENERAL = 0x0800_0000, "general error";
    CANNOT_STORE = 0x0800_0020, "data cannot be transferred or stored";
    DEVICE_STATE = 0x0800_0022, "data cannot be transferred or stored because of the present device state";
    PASSWORD = 0x0F00_FFBE, "password incorrect";
    ILLEGAL_COMMAND = 0x0F00_FFBF, "command code is illegal, does not exist";
    NMT_STATE = 0x0F00_FFC0, "device is in wrong nmt state";
}

impl fmt::Display for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "0x{:08X} ({})",
            self.0,
            self.text().unwrap_or("unknown abort code")
        )
    }
}

impl fmt::Debug for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
