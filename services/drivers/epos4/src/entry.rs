//! One object of a drive's dictionary as data: type, access, legal values, unit and factory value.

use crate::canopen::object::Address;

/// One object.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Where it stands.
    pub address: Address,
    /// What it holds.
    pub kind: Kind,
    /// Who may write it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Which values may be written.
    pub legal: Legal,
    /// The factory value, before the node id is added.
    pub default: i64,
    /// Whether the node id is part of the default: it is a COB-ID.
    pub plus_node_id: bool,
    /// Its name in the manual, lowercase.
    pub name: &'static str,
    /// Its unit from the factory; empty for a plain number.
    pub unit: &'static str,
}

/// A CANopen data type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Unsigned, 1 byte.
    U8,
    /// Unsigned, 2 bytes.
    U16,
    /// Unsigned, 4 bytes.
    U32,
    /// Signed, 1 byte.
    I8,
    /// Signed, 2 bytes.
    I16,
    /// Signed, 4 bytes.
    I32,
    /// This text.
    Text(&'static str),
}

/// Who may write an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The drive alone.
    ReadOnly,
    /// The master.
    ReadWrite,
    /// The master, while the power stage is off.
    ReadWritePowerOff,
}

/// Which PDOs may carry an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// None.
    No,
    /// Those that the drive sends.
    Transmit,
    /// Those that it receives.
    Receive,
}

/// Which values may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Legal {
    /// Lowest to highest.
    Between(i64, i64),
    /// These alone.
    OneOf(&'static [i64]),
}

/// Everything of an entry but its place, type and name: how the tables state it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rules {
    access: Access,
    mapping: Mapping,
    legal: Option<Legal>,
    default: i64,
    plus_node_id: bool,
}

// === impl Rules ===

impl Rules {
    pub(crate) const fn ro(default: i64) -> Self {
        Self {
            access: Access::ReadOnly,
            mapping: Mapping::No,
            legal: None,
            default,
            plus_node_id: false,
        }
    }

    pub(crate) const fn rw(default: i64) -> Self {
        Self {
            access: Access::ReadWrite,
            ..Self::ro(default)
        }
    }

    pub(crate) const fn power_off(self) -> Self {
        Self {
            access: Access::ReadWritePowerOff,
            ..self
        }
    }

    pub(crate) const fn tx(self) -> Self {
        Self {
            mapping: Mapping::Transmit,
            ..self
        }
    }

    pub(crate) const fn rx(self) -> Self {
        Self {
            mapping: Mapping::Receive,
            ..self
        }
    }

    pub(crate) const fn plus_node_id(self) -> Self {
        Self {
            plus_node_id: true,
            ..self
        }
    }

    pub(crate) const fn between(self, low: i64, high: i64) -> Self {
        Self {
            legal: Some(Legal::Between(low, high)),
            ..self
        }
    }

    pub(crate) const fn one_of(self, values: &'static [i64]) -> Self {
        Self {
            legal: Some(Legal::OneOf(values)),
            ..self
        }
    }
}

// === impl Entry ===

impl Entry {
    pub(crate) const fn new(
        address: Address,
        kind: Kind,
        name: &'static str,
        unit: &'static str,
        rules: Rules,
    ) -> Self {
        let legal = match rules.legal {
            Some(legal) => legal,
            None => {
                let (low, high) = kind.range();
                Legal::Between(low, high)
            }
        };
        Self {
            address,
            kind,
            access: rules.access,
            mapping: rules.mapping,
            legal,
            default: rules.default,
            plus_node_id: rules.plus_node_id,
            name,
            unit,
        }
    }

    /// The factory value of the object in a drive with this node id.
    #[must_use]
    pub fn factory_value(&self, node_id: u8) -> i64 {
        let offset = if self.plus_node_id { node_id } else { 0 };
        self.default + i64::from(offset)
    }
}

// === impl Kind ===

impl Kind {
    /// Bytes on the bus.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
            Self::Text(text) => text.len(),
        }
    }

    /// Lowest and highest value; 0 and 0 for a text.
    #[must_use]
    pub const fn range(self) -> (i64, i64) {
        match self {
            Self::U8 => (0, u8::MAX as i64),
            Self::U16 => (0, u16::MAX as i64),
            Self::U32 => (0, u32::MAX as i64),
            Self::I8 => (i8::MIN as i64, i8::MAX as i64),
            Self::I16 => (i16::MIN as i64, i16::MAX as i64),
            Self::I32 => (i32::MIN as i64, i32::MAX as i64),
            Self::Text(_) => (0, 0),
        }
    }

    /// Little-endian bytes of a value.
    #[must_use]
    pub fn encode(self, value: i64) -> Vec<u8> {
        match self {
            Self::Text(text) => text.as_bytes().to_vec(),
            number => value.to_le_bytes()[..number.size()].to_vec(),
        }
    }

    /// The value of exactly [`size`](Self::size) little-endian bytes.
    #[must_use]
    pub fn decode(self, bytes: &[u8]) -> Option<i64> {
        Some(match self {
            Self::U8 => i64::from(u8::from_le_bytes(bytes.try_into().ok()?)),
            Self::U16 => i64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            Self::U32 => i64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            Self::I8 => i64::from(i8::from_le_bytes(bytes.try_into().ok()?)),
            Self::I16 => i64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            Self::I32 => i64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            Self::Text(_) => return None,
        })
    }
}

// === impl Legal ===

impl Legal {
    /// Whether the value may be written.
    #[must_use]
    pub fn allows(self, value: i64) -> bool {
        match self {
            Self::Between(low, high) => (low..=high).contains(&value),
            Self::OneOf(values) => values.contains(&value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_survive_their_bytes() {
        for (kind, value) in [
            (Kind::I8, -4),
            (Kind::I32, -645_120),
            (Kind::U32, i64::from(u32::MAX)),
            (Kind::U16, 0x8611),
        ] {
            assert_eq!(kind.decode(&kind.encode(value)), Some(value));
        }
    }
}
