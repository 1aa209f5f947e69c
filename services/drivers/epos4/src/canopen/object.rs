//! What an object dictionary entry is: its address, and for the known ones a type and a unit.

use std::fmt;
use std::marker::PhantomData;

/// Where an object stands in the dictionary.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// 0x1000 to 0xFFFF for what a drive has.
    pub index: u16,
    /// 0 when the object is a single value.
    pub subindex: u8,
}

impl Address {
    /// The object at `index`, `subindex`.
    pub const fn new(index: u16, subindex: u8) -> Self {
        Self { index, subindex }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}:{:02X}", self.index, self.subindex)
    }
}

impl fmt::Debug for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// An object whose type is known when compiling.
#[derive(Debug)]
pub struct Object<T> {
    /// Where it stands.
    pub address: Address,
    /// Its name in the drive's manual, lowercase.
    pub name: &'static str,
    /// Its unit; empty for a plain number.
    pub unit: &'static str,
    value: PhantomData<fn() -> T>,
}

impl<T> Object<T> {
    /// The object at `index`, `subindex`.
    pub const fn new(index: u16, subindex: u8, name: &'static str, unit: &'static str) -> Self {
        Self {
            address: Address::new(index, subindex),
            name,
            unit,
            value: PhantomData,
        }
    }
}

impl<T> Clone for Object<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Object<T> {}

/// A CANopen data type of fixed size, little-endian on the bus.
pub trait Value: Copy + fmt::Debug {
    /// Bytes.
    const SIZE: usize;
    /// From exactly [`Self::SIZE`] bytes; `None` for any other number.
    fn from_le_slice(bytes: &[u8]) -> Option<Self>;
    /// As on the bus.
    fn to_le_vec(self) -> Vec<u8>;
}

macro_rules! integer_value {
    ($($type:ty),*) => {$(
        impl Value for $type {
            const SIZE: usize = size_of::<$type>();
            fn from_le_slice(bytes: &[u8]) -> Option<Self> {
                Some(Self::from_le_bytes(bytes.try_into().ok()?))
            }
            fn to_le_vec(self) -> Vec<u8> {
                self.to_le_bytes().to_vec()
            }
        }
    )*};
}
integer_value!(u8, u16, u32, i8, i16, i32);
