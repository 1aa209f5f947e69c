//! The number types of binary files, and the same numbers as words.

use std::fmt;
use std::ops::RangeInclusive;

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// The order of a number's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Endian {
    Little,
    Big,
}

impl Scalar {
    /// Bytes it takes.
    pub(crate) const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(crate) const fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Takes a number off the front of `bytes`; `None` if they end within it. Exact but for integers beyond 2^53.
    pub(crate) fn take(self, bytes: &mut &[u8], endian: Endian) -> Option<f64> {
        macro_rules! take {
            ($type:ty) => {{
                let (number, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                match endian {
                    Endian::Little => <$type>::from_le_bytes(*number) as f64,
                    Endian::Big => <$type>::from_be_bytes(*number) as f64,
                }
            }};
        }
        Some(match self {
            Self::I8 => take!(i8),
            Self::U8 => take!(u8),
            Self::I16 => take!(i16),
            Self::U16 => take!(u16),
            Self::I32 => take!(i32),
            Self::U32 => take!(u32),
            Self::I64 => take!(i64),
            Self::U64 => take!(u64),
            Self::F32 => take!(f32),
            Self::F64 => take!(f64),
        })
    }

    /// The number that `word` spells; `None` if it is none of this type.
    pub(crate) fn parse(self, word: &str) -> Option<f64> {
        match self {
            Self::F32 => word.parse::<f32>().ok().map(f64::from),
            Self::F64 => word.parse().ok(),
            _ => {
                let number: i128 = word.parse().ok()?;
                self.integers().contains(&number).then_some(number as f64)
            }
        }
    }

    fn integers(self) -> RangeInclusive<i128> {
        let bits = 8 * self.size();
        match self {
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => 0..=(1 << bits) - 1,
            _ => -(1 << (bits - 1))..=(1 << (bits - 1)) - 1,
        }
    }
}

impl fmt::Display for Scalar {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::I8 => "int8",
            Self::U8 => "uint8",
            Self::I16 => "int16",
            Self::U16 => "uint16",
            Self::I32 => "int32",
            Self::U32 => "uint32",
            Self::I64 => "int64",
            Self::U64 => "uint64",
            Self::F32 => "float32",
            Self::F64 => "float64",
        })
    }
}
