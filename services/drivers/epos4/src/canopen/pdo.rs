//! Process data objects (CiA 301, 7.2.2): several objects in one frame that nobody confirms. A [`Mapping`] says which
//! objects, a [`Transmission`] when the frame comes, and [`setting_up`] in which order a node takes both.

use std::time::Duration;

use super::object::{Address, Object, Value};
use super::sdo::Payload;
use crate::frame::{Frame, MAX_DATA_LEN};

/// The number of PDOs in each direction that have a COB-ID of their own (CiA 301, 7.3.5).
pub const COUNT: u8 = 4;
/// The number of objects that one PDO of an EPOS4 carries at most.
pub const MAX_ENTRIES: usize = 12;
/// Bit 31 of a COB-ID: the PDO is off.
pub const OFF: u32 = 1 << 31;
/// Bit 30 of a COB-ID: the PDO does not answer remote frames. The EPOS4 has it set in every PDO that it sends.
pub const NO_REMOTE: u32 = 1 << 30;

/// The bytes of a PDO.
pub type Data = Payload<MAX_DATA_LEN>;

/// Which way a PDO goes, and its number, 1 to 4.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Pdo {
    /// The node sends it (TPDO).
    Transmit(u8),
    /// The node receives it (RPDO).
    Receive(u8),
}

/// One object of a mapping.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Mapped {
    /// Which object.
    pub address: Address,
    /// Its size.
    pub bits: u8,
}

/// The objects of a PDO, in their order.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Mapping {
    entries: Vec<Mapped>,
}

/// Why objects do not go into one PDO.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum MappingError {
    /// Too many objects.
    #[error("a pdo carries at most {MAX_ENTRIES} objects, not {0}")]
    Entries(usize),
    /// Too many bits.
    #[error("a pdo carries at most 64 bits, not {0}")]
    Bits(usize),
    /// Objects of whole bytes alone are read and written here.
    #[error("object {address} has {bits} bits, which is not 8, 16 or 32")]
    Size {
        /// Which object.
        address: Address,
        /// Its size.
        bits: u8,
    },
}

/// When a node sends a PDO, object 0x1800:02.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Transmission {
    /// With the next SYNC after a change.
    SyncOnChange,
    /// With every nth SYNC, 1 to 240.
    EverySync(u8),
    /// On change, at most once an inhibit time.
    OnChange,
}

/// What one write of the order of setting up a PDO writes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Write {
    /// Where.
    pub address: Address,
    /// Little-endian.
    pub data: Vec<u8>,
    /// Whether the node still has this value when all is written.
    pub lasts: bool,
}

// === impl Pdo ===

impl Pdo {
    /// The COB-ID of the predefined connection set for a node.
    pub const fn cob_id(self, node_id: u8) -> u16 {
        let base = match self {
            Self::Transmit(number) => 0x080 + 0x100 * number as u16,
            Self::Receive(number) => 0x100 + 0x100 * number as u16,
        };
        base + node_id as u16
    }

    /// The record of its communication parameters.
    pub const fn communication_index(self) -> u16 {
        match self {
            Self::Transmit(number) => 0x17FF + number as u16,
            Self::Receive(number) => 0x13FF + number as u16,
        }
    }

    /// The record of its mapping.
    pub const fn mapping_index(self) -> u16 {
        self.communication_index() + 0x200
    }

    /// Its COB-ID object, while it is on.
    pub const fn cob_id_entry(self, node_id: u8) -> u32 {
        let cob_id = self.cob_id(node_id) as u32;
        match self {
            Self::Transmit(_) => cob_id | NO_REMOTE,
            Self::Receive(_) => cob_id,
        }
    }
}

/// Node, number and data of a frame that a node sent as PDO; `None` when its COB-ID is none of the predefined set.
pub fn decode(frame: &Frame) -> Option<(u8, u8, Data)> {
    let cob_id = frame.cob_id()?;
    let number = (1..=COUNT).find(|number| {
        let base = Pdo::Transmit(*number).cob_id(0);
        (base + 1..=base + 0x7F).contains(&cob_id)
    })?;
    let node_id = (cob_id - Pdo::Transmit(number).cob_id(0)) as u8;
    Some((node_id, number, Data::new(frame.data())?))
}

// === impl Mapping ===

impl Mapping {
    /// These objects in this order.
    pub fn new(entries: impl IntoIterator<Item = Mapped>) -> Result<Self, MappingError> {
        let entries: Vec<Mapped> = entries.into_iter().take(MAX_ENTRIES + 1).collect();
        if entries.len() > MAX_ENTRIES {
            return Err(MappingError::Entries(entries.len()));
        }
        if let Some(Mapped { address, bits }) = entries
            .iter()
            .find(|mapped| ![8, 16, 32].contains(&mapped.bits))
        {
            return Err(MappingError::Size {
                address: *address,
                bits: *bits,
            });
        }
        let bits = entries.iter().map(|mapped| usize::from(mapped.bits)).sum();
        if bits > 8 * MAX_DATA_LEN {
            return Err(MappingError::Bits(bits));
        }
        Ok(Self { entries })
    }

    /// The objects.
    pub fn entries(&self) -> &[Mapped] {
        &self.entries
    }

    /// Bytes of a frame.
    pub fn len(&self) -> usize {
        self.entries.iter().map(|mapped| mapped.len()).sum()
    }

    /// Whether nothing is mapped.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The value of a mapped object; `None` when it is not mapped or the frame is too short.
    pub fn value<T: Value>(&self, object: Object<T>, data: &Data) -> Option<T> {
        let range = self.range(object.address)?;
        T::from_le_slice(data.as_slice().get(range)?)
    }

    /// A frame's data with these values, each of an object of its own; `None` when they are not exactly those mapped.
    pub fn pack(&self, values: &[(Address, Vec<u8>)]) -> Option<Data> {
        if values.len() != self.entries.len() {
            return None;
        }
        let mut bytes = [0; MAX_DATA_LEN];
        let bytes = &mut bytes[..self.len()];
        for mapped in &self.entries {
            let (_, value) = values
                .iter()
                .find(|(address, _)| *address == mapped.address)?;
            if value.len() != mapped.len() {
                return None;
            }
            bytes[self.range(mapped.address)?].copy_from_slice(value);
        }
        Data::new(bytes)
    }

    fn range(&self, address: Address) -> Option<std::ops::Range<usize>> {
        let mut start = 0;
        for mapped in &self.entries {
            let end = start + mapped.len();
            if mapped.address == address {
                return Some(start..end);
            }
            start = end;
        }
        None
    }
}

// === impl Mapped ===

impl Mapped {
    /// As a mapping entry on the bus: index, subindex, bits.
    pub const fn entry(self) -> u32 {
        (self.address.index as u32) << 16 | (self.address.subindex as u32) << 8 | self.bits as u32
    }

    fn len(self) -> usize {
        usize::from(self.bits / 8)
    }
}

impl<T: Value> From<Object<T>> for Mapped {
    fn from(object: Object<T>) -> Self {
        Self {
            address: object.address,
            bits: (8 * T::SIZE) as u8,
        }
    }
}

// === impl Transmission ===

impl Transmission {
    /// The number in object 0x1800:02.
    pub const fn code(self) -> u8 {
        match self {
            Self::SyncOnChange => 0,
            Self::EverySync(n) => n,
            Self::OnChange => 255,
        }
    }
}

/// What is written to have a PDO sent or received, in the order that nodes ask for: off, no objects, the objects, their
/// number, the communication parameters, on. The inhibit time counts in steps of 100 us, for PDOs that the node sends.
pub fn setting_up(
    pdo: Pdo,
    node_id: u8,
    mapping: &Mapping,
    transmission: Transmission,
    inhibit: Duration,
) -> Vec<Write> {
    let (communication, map) = (pdo.communication_index(), pdo.mapping_index());
    let count = mapping.entries.len() as u8;
    let mut writes = turning_off(pdo, node_id);
    writes.push(Write::passing(Address::new(map, 0), 0_u8));
    writes.extend(
        (1..)
            .zip(&mapping.entries)
            .map(|(subindex, mapped)| Write::lasting(Address::new(map, subindex), mapped.entry())),
    );
    writes.push(Write::lasting(Address::new(map, 0), count));
    writes.push(Write::lasting(
        Address::new(communication, 2),
        transmission.code(),
    ));
    if let Pdo::Transmit(_) = pdo {
        let steps = u16::try_from(inhibit.as_micros() / 100).unwrap_or(u16::MAX);
        writes.push(Write::lasting(Address::new(communication, 3), steps));
    }
    writes.push(Write::lasting(
        Address::new(communication, 1),
        pdo.cob_id_entry(node_id),
    ));
    writes
}

/// What is written to have a PDO neither sent nor received.
pub fn turning_off(pdo: Pdo, node_id: u8) -> Vec<Write> {
    let address = Address::new(pdo.communication_index(), 1);
    vec![Write::passing(address, pdo.cob_id_entry(node_id) | OFF)]
}

impl Write {
    fn lasting(address: Address, value: impl Value) -> Self {
        Self {
            address,
            data: value.to_le_vec(),
            lasts: true,
        }
    }

    fn passing(address: Address, value: impl Value) -> Self {
        Self {
            lasts: false,
            ..Self::lasting(address, value)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objects;

    fn motion() -> Mapping {
        Mapping::new([objects::STATUSWORD.into(), objects::POSITION_ACTUAL.into()]).unwrap()
    }

    #[test]
    fn cob_ids_and_records_are_those_of_the_predefined_set() {
        assert_eq!(Pdo::Transmit(1).cob_id(2), 0x182);
        assert_eq!(Pdo::Transmit(4).cob_id(127), 0x4FF);
        assert_eq!(Pdo::Receive(1).cob_id(2), 0x202);
        assert_eq!(Pdo::Receive(4).cob_id(2), 0x502);
        assert_eq!(
            [
                Pdo::Transmit(1),
                Pdo::Transmit(4),
                Pdo::Receive(1),
                Pdo::Receive(4)
            ]
            .map(|pdo| (pdo.communication_index(), pdo.mapping_index())),
            [
                (0x1800, 0x1A00),
                (0x1803, 0x1A03),
                (0x1400, 0x1600),
                (0x1403, 0x1603)
            ]
        );
        let frame = Frame::standard(0x282, [1, 2, 3]);
        assert_eq!(decode(&frame), Some((2, 2, Data::new(&[1, 2, 3]).unwrap())));
        for other in [0x180, 0x200, 0x202, 0x581, 0x701] {
            assert_eq!(decode(&Frame::standard(other, [0])), None, "{other:03X}");
        }
    }

    #[test]
    fn what_is_packed_is_read_again_and_what_is_missing_is_not_made_up() {
        let mapping = motion();
        let values = [
            (objects::POSITION_ACTUAL.address, (-21_504_i32).to_le_vec()),
            (objects::STATUSWORD.address, 0x0637_u16.to_le_vec()),
        ];
        let data = mapping.pack(&values).unwrap();
        assert_eq!(data.as_slice(), [0x37, 0x06, 0x00, 0xAC, 0xFF, 0xFF]);
        assert_eq!(mapping.value(objects::STATUSWORD, &data), Some(0x0637));
        assert_eq!(
            mapping.value(objects::POSITION_ACTUAL, &data),
            Some(-21_504)
        );
        assert_eq!(mapping.value(objects::CURRENT_ACTUAL, &data), None);
        let short = Data::new(&[0x37, 0x06, 0x00]).unwrap();
        assert_eq!(mapping.value(objects::POSITION_ACTUAL, &short), None);
        assert_eq!(mapping.pack(&values[..1]), None);
    }

    #[test]
    fn more_than_a_frame_holds_is_refused_with_the_limit() {
        let three = [Mapped::from(objects::POSITION_ACTUAL); 3];
        assert_eq!(Mapping::new(three), Err(MappingError::Bits(96)));
        let many = [Mapped::from(objects::ERROR_REGISTER); 13];
        assert_eq!(Mapping::new(many), Err(MappingError::Entries(13)));
        let odd = Mapped {
            bits: 7,
            ..objects::STATUSWORD.into()
        };
        assert!(matches!(
            Mapping::new([odd]),
            Err(MappingError::Size { bits: 7, .. })
        ));
    }

    #[test]
    fn a_pdo_is_off_while_its_objects_change() {
        let writes = setting_up(
            Pdo::Transmit(2),
            3,
            &motion(),
            Transmission::OnChange,
            Duration::from_millis(10),
        );
        let shown: Vec<String> = writes
            .iter()
            .map(|write| format!("{} {:02X?}", write.address, write.data))
            .collect();
        assert_eq!(
            shown,
            [
                "0x1801:01 [83, 02, 00, C0]",
                "0x1A01:00 [00]",
                "0x1A01:01 [10, 00, 41, 60]",
                "0x1A01:02 [20, 00, 64, 60]",
                "0x1A01:00 [02]",
                "0x1801:02 [FF]",
                "0x1801:03 [64, 00]",
                "0x1801:01 [83, 02, 00, 40]",
            ]
        );
    }
}
