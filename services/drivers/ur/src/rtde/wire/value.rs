//! The ten field types of RTDE and their values.

use std::fmt;

/// Type of a recipe field, or why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Type {
    /// 1 byte, 0 or not.
    Bool,
    /// 1 byte.
    UInt8,
    /// 4 bytes.
    UInt32,
    /// 8 bytes.
    UInt64,
    /// 4 bytes, two's complement.
    Int32,
    /// 8 bytes, IEEE 754.
    Double,
    /// 3 doubles.
    Vector3D,
    /// 6 doubles.
    Vector6D,
    /// 6 signed integers.
    Vector6Int32,
    /// 6 unsigned integers.
    Vector6UInt32,
    /// The controller does not know the name.
    NotFound,
    /// Another client writes this input.
    InUse,
}

impl Type {
    pub(super) const ALL: [Self; 12] = [
        Self::Bool,
        Self::UInt8,
        Self::UInt32,
        Self::UInt64,
        Self::Int32,
        Self::Double,
        Self::Vector3D,
        Self::Vector6D,
        Self::Vector6Int32,
        Self::Vector6UInt32,
        Self::NotFound,
        Self::InUse,
    ];

    /// The word on the wire.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Bool => "BOOL",
            Self::UInt8 => "UINT8",
            Self::UInt32 => "UINT32",
            Self::UInt64 => "UINT64",
            Self::Int32 => "INT32",
            Self::Double => "DOUBLE",
            Self::Vector3D => "VECTOR3D",
            Self::Vector6D => "VECTOR6D",
            Self::Vector6Int32 => "VECTOR6INT32",
            Self::Vector6UInt32 => "VECTOR6UINT32",
            Self::NotFound => "NOT_FOUND",
            Self::InUse => "IN_USE",
        }
    }

    /// From the word on the wire.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }

    /// Bytes of one value; 0 for the refusals.
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bool | Self::UInt8 => 1,
            Self::UInt32 | Self::Int32 => 4,
            Self::UInt64 | Self::Double => 8,
            Self::Vector3D | Self::Vector6Int32 | Self::Vector6UInt32 => 24,
            Self::Vector6D => 48,
            Self::NotFound | Self::InUse => 0,
        }
    }

    /// The field can be exchanged.
    pub const fn is_field(self) -> bool {
        !matches!(self, Self::NotFound | Self::InUse)
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// One value of a recipe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// `BOOL`
    Bool(bool),
    /// `UINT8`
    UInt8(u8),
    /// `UINT32`
    UInt32(u32),
    /// `UINT64`
    UInt64(u64),
    /// `INT32`
    Int32(i32),
    /// `DOUBLE`
    Double(f64),
    /// `VECTOR3D`
    Vector3D([f64; 3]),
    /// `VECTOR6D`
    Vector6D([f64; 6]),
    /// `VECTOR6INT32`
    Vector6Int32([i32; 6]),
    /// `VECTOR6UINT32`
    Vector6UInt32([u32; 6]),
}

impl Value {
    /// Its type.
    pub const fn kind(&self) -> Type {
        match self {
            Self::Bool(_) => Type::Bool,
            Self::UInt8(_) => Type::UInt8,
            Self::UInt32(_) => Type::UInt32,
            Self::UInt64(_) => Type::UInt64,
            Self::Int32(_) => Type::Int32,
            Self::Double(_) => Type::Double,
            Self::Vector3D(_) => Type::Vector3D,
            Self::Vector6D(_) => Type::Vector6D,
            Self::Vector6Int32(_) => Type::Vector6Int32,
            Self::Vector6UInt32(_) => Type::Vector6UInt32,
        }
    }

    /// Appends the bytes.
    pub fn encode(&self, out: &mut Vec<u8>) {
        match self {
            Self::Bool(value) => out.push(u8::from(*value)),
            Self::UInt8(value) => out.push(*value),
            Self::UInt32(value) => out.extend(value.to_be_bytes()),
            Self::UInt64(value) => out.extend(value.to_be_bytes()),
            Self::Int32(value) => out.extend(value.to_be_bytes()),
            Self::Double(value) => out.extend(value.to_be_bytes()),
            Self::Vector3D(values) => values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes())),
            Self::Vector6D(values) => values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes())),
            Self::Vector6Int32(values) => values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes())),
            Self::Vector6UInt32(values) => values
                .iter()
                .for_each(|value| out.extend(value.to_be_bytes())),
        }
    }

    /// Takes one value of this type off the front. `None` when bytes are missing, or the type is a refusal.
    pub fn decode(kind: Type, bytes: &mut &[u8]) -> Option<Self> {
        Some(match kind {
            Type::Bool => Self::Bool(take::<1>(bytes)? != [0]),
            Type::UInt8 => Self::UInt8(u8::from_be_bytes(take(bytes)?)),
            Type::UInt32 => Self::UInt32(u32::from_be_bytes(take(bytes)?)),
            Type::UInt64 => Self::UInt64(u64::from_be_bytes(take(bytes)?)),
            Type::Int32 => Self::Int32(i32::from_be_bytes(take(bytes)?)),
            Type::Double => Self::Double(f64::from_be_bytes(take(bytes)?)),
            Type::Vector3D => Self::Vector3D(vector(bytes, f64::from_be_bytes)?),
            Type::Vector6D => Self::Vector6D(vector(bytes, f64::from_be_bytes)?),
            Type::Vector6Int32 => Self::Vector6Int32(vector(bytes, i32::from_be_bytes)?),
            Type::Vector6UInt32 => Self::Vector6UInt32(vector(bytes, u32::from_be_bytes)?),
            Type::NotFound | Type::InUse => return None,
        })
    }
}

/// Decodes exactly these fields; `None` when the bytes are fewer or more.
pub fn take_values(kinds: &[Type], mut bytes: &[u8]) -> Option<Vec<Value>> {
    let values = kinds
        .iter()
        .map(|kind| Value::decode(*kind, &mut bytes))
        .collect::<Option<Vec<_>>>()?;
    bytes.is_empty().then_some(values)
}

/// Takes `N` bytes off the front.
pub fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (head, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*head)
}

fn vector<T: Copy + Default, const N: usize, const B: usize>(
    bytes: &mut &[u8],
    decode: impl Fn([u8; B]) -> T,
) -> Option<[T; N]> {
    let mut values = [T::default(); N];
    for value in &mut values {
        *value = decode(take(bytes)?);
    }
    Some(values)
}
