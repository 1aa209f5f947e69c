//! The values of one drive's objects, and the rules under which a master may write them.

use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::AbortCode;
use epos4_link::canopen::sdo::server::Length;

use epos4_link::dictionary::{
    self, Access, Kind, Legal, Mapping, PDO_COUNT, PDO_ENTRIES_MAX, PDO_OFF, entries, has_index,
};
use epos4_link::objects;

/// Below it stand the objects of CiA 301.
const FIRST_MANUFACTURER_INDEX: u16 = 0x2000;

/// The values, in the order of [`entries`].
#[derive(Clone, Debug)]
pub struct Objects {
    node_id: u8,
    values: Vec<i64>,
    /// What a restart brings back.
    stored: Vec<i64>,
    /// Counts what masters change.
    revision: u64,
}

/// Whether the power stage is on: some objects may only be written while it is off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// The motor is free.
    Off,
    /// The motor is under control.
    On,
}

impl Objects {
    /// Factory values, then the given parameters, which are stored as a commissioning tool does.
    #[must_use]
    pub fn new(node_id: u8, parameters: &[(Address, i64)]) -> Self {
        let values = factory_values(node_id);
        let mut objects = Self {
            node_id,
            stored: values.clone(),
            values,
            revision: 0,
        };
        for (address, value) in parameters {
            objects.set(*address, *value);
        }
        objects.derive();
        objects.stored.clone_from(&objects.values);
        objects
    }

    /// A value; 0 for an object that the drive has not.
    #[must_use]
    pub fn get(&self, address: Address) -> i64 {
        debug_assert!(dictionary::place(address).is_some(), "no object {address}");
        dictionary::place(address).map_or(0, |place| self.values[place])
    }

    /// Sets a value as the drive itself does, without rules.
    pub fn set(&mut self, address: Address, value: i64) {
        debug_assert!(dictionary::place(address).is_some(), "no object {address}");
        if let Some(place) = dictionary::place(address) {
            self.values[place] = value;
        }
    }

    /// The bytes that a master reads.
    pub fn read(&self, address: Address) -> Result<Vec<u8>, AbortCode> {
        let place = find(address)?;
        Ok(entries()[place].kind.encode(self.values[place]))
    }

    /// Writes what a master sends.
    pub fn write(
        &mut self,
        address: Address,
        data: &[u8],
        length: Length,
        power: Power,
    ) -> Result<(), AbortCode> {
        let place = find(address)?;
        let entry = entries()[place];
        match (entry.access, power) {
            (Access::ReadOnly, _) => return Err(AbortCode::READ_ONLY),
            (Access::ReadWritePowerOff, Power::On) => return Err(AbortCode::DEVICE_STATE),
            _ => {}
        }
        let data = match length {
            Length::Given => data,
            Length::Unknown => data.get(..entry.kind.size()).unwrap_or(data),
        };
        let value = entry.kind.decode(data).ok_or(AbortCode::LENGTH)?;
        if !entry.legal.allows(value) {
            return Err(AbortCode::VALUE_RANGE);
        }
        match address.index {
            0x1010 => return self.store(value),
            0x1011 => return self.restore(value),
            0x3142 if value != 255 => self.check_input_function(address, value)?,
            0x1400..=0x1403 | 0x1800..=0x1803 if address.subindex == 1 => check_cob_id(value)?,
            0x1600..=0x1603 | 0x1A00..=0x1A03 => self.check_mapping(address, value)?,
            _ => {}
        }
        self.values[place] = value;
        self.derive();
        self.revision += 1;
        Ok(())
    }

    /// Brings back the stored values, as after a power cycle.
    pub fn restart(&mut self) {
        self.values.clone_from(&self.stored);
        self.derive();
        self.revision += 1;
    }

    /// Grows with everything that a master changes, and not with what the drive sets itself.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Brings back the stored values of the communication objects alone.
    pub fn restart_communication(&mut self) {
        let profile =
            entries().partition_point(|entry| entry.address.index < FIRST_MANUFACTURER_INDEX);
        self.values[..profile].clone_from_slice(&self.stored[..profile]);
    }

    /// The objects that a PDO carries: `record` is its mapping record, 0x1600 to 0x1603 or 0x1A00 to 0x1A03.
    pub fn mapped(&self, record: u16) -> impl Iterator<Item = (Address, Kind)> {
        let count = self
            .get(Address::new(record, 0))
            .clamp(0, i64::from(PDO_ENTRIES_MAX)) as u8;
        (1..=count).filter_map(move |subindex| {
            let address = mapped_address(self.get(Address::new(record, subindex)));
            Some((address, entries()[dictionary::place(address)?].kind))
        })
    }

    fn store(&mut self, signature: i64) -> Result<(), AbortCode> {
        if signature != i64::from(objects::SAVE_SIGNATURE) {
            return Err(AbortCode::CANNOT_STORE);
        }
        let factory = factory_values(self.node_id);
        for (place, entry) in entries().iter().enumerate() {
            let kept = entry.access != Access::ReadOnly && !VOLATILE.contains(&entry.address);
            self.stored[place] = if kept {
                self.values[place]
            } else {
                factory[place]
            };
        }
        // The identity is no parameter but burnt in.
        let serial = self.get(objects::SERIAL_NUMBER.address);
        if let Some(place) = dictionary::place(objects::SERIAL_NUMBER.address) {
            self.stored[place] = serial;
        }
        Ok(())
    }

    /// Takes effect at the next restart.
    fn restore(&mut self, signature: i64) -> Result<(), AbortCode> {
        if signature != i64::from(objects::LOAD_SIGNATURE) {
            return Err(AbortCode::CANNOT_STORE);
        }
        self.stored = Self::new(
            self.node_id,
            &[(
                objects::SERIAL_NUMBER.address,
                self.get(objects::SERIAL_NUMBER.address),
            )],
        )
        .values;
        Ok(())
    }

    /// What the drive computes from other objects.
    fn derive(&mut self) {
        self.set(
            objects::MAIN_SENSOR_RESOLUTION.address,
            4 * self.get(objects::ENCODER_PULSES.address),
        );
        self.set(
            objects::RATED_TORQUE.address,
            self.get(objects::NOMINAL_CURRENT.address) * self.get(objects::TORQUE_CONSTANT.address)
                / 1000,
        );
    }

    /// A function may be given to one input alone.
    fn check_input_function(&self, address: Address, function: i64) -> Result<(), AbortCode> {
        let taken = (1..=8)
            .map(|input| objects::digital_input_function(input).address)
            .any(|other| other != address && self.get(other) == function);
        if taken {
            Err(AbortCode::PARAMETER_INCOMPATIBLE)
        } else {
            Ok(())
        }
    }

    /// A mapping may change while the PDO is off; an entry while the count is 0.
    fn check_mapping(&self, address: Address, value: i64) -> Result<(), AbortCode> {
        let communication = Address::new(address.index - 0x200, 1);
        if self.get(communication) & PDO_OFF == 0 {
            return Err(AbortCode::DEVICE_STATE);
        }
        if address.subindex == 0 {
            let bits: i64 = (1..=value as u8)
                .map(|subindex| self.get(Address::new(address.index, subindex)) & 0xFF)
                .sum();
            return if bits > 64 {
                Err(AbortCode::PDO_LENGTH)
            } else {
                Ok(())
            };
        }
        if self.get(Address::new(address.index, 0)) != 0 {
            return Err(AbortCode::SUBINDEX_NOT_WRITABLE);
        }
        if value == 0 {
            return Ok(());
        }
        let direction = if address.index < 0x1600 + PDO_COUNT {
            Mapping::Receive
        } else {
            Mapping::Transmit
        };
        let entry = find(mapped_address(value))
            .map(|place| entries()[place])
            .map_err(|_| AbortCode::NOT_MAPPABLE)?;
        if entry.mapping != direction || entry.kind.size() as i64 * 8 != value & 0xFF {
            return Err(AbortCode::NOT_MAPPABLE);
        }
        Ok(())
    }
}

/// Commands and targets are not stored.
const VOLATILE: &[Address] = &[
    objects::ERROR_HISTORY_COUNT.address,
    objects::CONTROLWORD.address,
    objects::TARGET_POSITION.address,
    objects::TARGET_VELOCITY.address,
    objects::TARGET_TORQUE.address,
];

fn factory_values(node_id: u8) -> Vec<i64> {
    entries()
        .iter()
        .map(|entry| entry.factory_value(node_id))
        .collect()
}

fn find(address: Address) -> Result<usize, AbortCode> {
    dictionary::place(address).ok_or(if has_index(address.index) {
        AbortCode::NO_SUBINDEX
    } else {
        AbortCode::NO_OBJECT
    })
}

/// Index, subindex and bit count are packed into 32 bits.
fn mapped_address(entry: i64) -> Address {
    Address::new((entry >> 16) as u16, (entry >> 8) as u8)
}

/// Bits 0 to 10 are the COB-ID, 30 and 31 are flags.
fn check_cob_id(value: i64) -> Result<(), AbortCode> {
    if Legal::Between(1, 0x7FF).allows(value & 0x3FFF_FFFF) {
        Ok(())
    } else {
        Err(AbortCode::VALUE_RANGE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objects() -> Objects {
        Objects::new(
            3,
            &[
                (objects::ENCODER_PULSES.address, 512),
                (objects::SERIAL_NUMBER.address, 42),
            ],
        )
    }

    fn write(
        objects: &mut Objects,
        index: u16,
        subindex: u8,
        data: &[u8],
    ) -> Result<(), AbortCode> {
        objects.write(
            Address::new(index, subindex),
            data,
            Length::Given,
            Power::On,
        )
    }

    #[test]
    fn each_refusal_has_its_abort_code() {
        let mut objects = objects();
        for (index, subindex, data, code) in [
            (0x6072, 0, &[0, 0][..], AbortCode::NO_OBJECT),
            (0x1018, 9, &[0, 0, 0, 0], AbortCode::NO_SUBINDEX),
            (0x6041, 0, &[0, 0], AbortCode::READ_ONLY),
            (0x6040, 0, &[0], AbortCode::LENGTH),
            (0x6040, 0, &[0, 0, 0, 0], AbortCode::LENGTH),
            (0x605A, 0, &[2, 0], AbortCode::VALUE_RANGE),
            (0x6007, 0, &[1, 0], AbortCode::VALUE_RANGE),
            (0x6060, 0, &[7], AbortCode::VALUE_RANGE),
            (0x6098, 0, &[3], AbortCode::VALUE_RANGE),
            (0x3001, 2, &[0xFF, 0xFF, 0, 0], AbortCode::VALUE_RANGE),
            (0x1003, 0, &[1], AbortCode::VALUE_RANGE),
            (0x3010, 1, &[0, 2, 0, 0], AbortCode::DEVICE_STATE),
            (0x3142, 4, &[0], AbortCode::PARAMETER_INCOMPATIBLE),
            (0x1010, 1, &[1, 2, 3, 4], AbortCode::CANNOT_STORE),
            (0x1A00, 1, &[0x10, 0, 0x41, 0x60], AbortCode::DEVICE_STATE),
            (
                0x1A01,
                1,
                &[0x10, 0, 0x41, 0x60],
                AbortCode::SUBINDEX_NOT_WRITABLE,
            ),
            (0x1801, 1, &[0, 0, 0, 0x80], AbortCode::VALUE_RANGE),
        ] {
            assert_eq!(
                write(&mut objects, index, subindex, data),
                Err(code),
                "0x{index:04X}:{subindex}"
            );
        }
    }

    #[test]
    fn a_mapping_is_changed_in_the_order_of_the_standard() {
        let mut objects = objects();
        write(&mut objects, 0x1A02, 0, &[0]).unwrap();
        assert_eq!(
            write(&mut objects, 0x1A02, 1, &[0x20, 0, 0x7A, 0x60]),
            Err(AbortCode::NOT_MAPPABLE)
        );
        assert_eq!(
            write(&mut objects, 0x1A02, 1, &[0x10, 0, 0x64, 0x60]),
            Err(AbortCode::NOT_MAPPABLE)
        );
        for (subindex, object) in [(1, 0x6064_0020_u32), (2, 0x606C_0020), (3, 0x6041_0010)] {
            write(&mut objects, 0x1A02, subindex, &object.to_le_bytes()).unwrap();
        }
        assert_eq!(
            write(&mut objects, 0x1A02, 0, &[3]),
            Err(AbortCode::PDO_LENGTH)
        );
        write(&mut objects, 0x1A02, 0, &[2]).unwrap();
        let mapped: Vec<_> = objects.mapped(0x1A02).collect();
        assert_eq!(
            mapped,
            [
                (objects::POSITION_ACTUAL.address, Kind::I32),
                (objects::VELOCITY_ACTUAL.address, Kind::I32)
            ]
        );
    }

    #[test]
    fn saved_parameters_survive_a_restart_and_others_do_not() {
        let mut objects = objects();
        write(&mut objects, 0x6081, 0, &5000_u32.to_le_bytes()).unwrap();
        write(&mut objects, 0x607A, 0, &77_i32.to_le_bytes()).unwrap();
        objects.restart();
        assert_eq!(objects.get(objects::PROFILE_VELOCITY.address), 1000);
        write(&mut objects, 0x6081, 0, &5000_u32.to_le_bytes()).unwrap();
        write(&mut objects, 0x607A, 0, &77_i32.to_le_bytes()).unwrap();
        write(&mut objects, 0x1010, 1, b"save").unwrap();
        objects.restart();
        assert_eq!(objects.get(objects::PROFILE_VELOCITY.address), 5000);
        assert_eq!(objects.get(objects::TARGET_POSITION.address), 0);
        assert_eq!(objects.get(objects::SERIAL_NUMBER.address), 42);
        write(&mut objects, 0x1011, 1, b"load").unwrap();
        objects.restart();
        assert_eq!(objects.get(objects::PROFILE_VELOCITY.address), 1000);
        assert_eq!(objects.get(objects::MAIN_SENSOR_RESOLUTION.address), 2000);
        assert_eq!(objects.get(objects::SERIAL_NUMBER.address), 42);
    }

    #[test]
    fn a_write_of_unknown_size_takes_the_size_of_the_object() {
        let mut objects = objects();
        objects
            .write(
                objects::MODES_OF_OPERATION.address,
                &[6, 0xAA, 0xAA, 0xAA],
                Length::Unknown,
                Power::Off,
            )
            .unwrap();
        assert_eq!(objects.get(objects::MODES_OF_OPERATION.address), 6);
    }
}
