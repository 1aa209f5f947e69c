//! What an RTDE client can ask for, by name.

mod table;

use ur_link::rtde::wire::{Type, Value};

use super::{Controller, Since, Version, kinematics::Joints, registers::Register};

/// A field of an output recipe.
#[derive(Clone, Copy, Debug)]
pub struct Output(Source);

#[derive(Clone, Copy, Debug)]
enum Source {
    State(Read),
    Input(Register),
    Output(Register),
}

/// How the value of a field is found, by its type.
#[derive(Clone, Copy, Debug)]
enum Read {
    Double(fn(&Controller) -> f64),
    Six(fn(&Controller) -> Joints),
    Three(fn(&Controller) -> [f64; 3]),
    SixInts(fn(&Controller) -> [i32; 6]),
    Int(fn(&Controller) -> i32),
    Byte(fn(&Controller) -> u8),
    Word(fn(&Controller) -> u32),
    Long(fn(&Controller) -> u64),
}

/// A named value and the versions that have it.
type Row = (&'static str, Since, Read);

impl Output {
    /// The field of this name with its type; `None` for names this version of the controller does not know.
    pub fn from_name(name: &str, version: Version) -> Option<(Self, Type)> {
        if let Some((_, since, read)) = table::STATE.iter().find(|(known, ..)| *known == name) {
            return version
                .has(*since)
                .then_some((Self(Source::State(*read)), read.kind()));
        }
        let (source, register): (fn(Register) -> Source, _) = match name.split_once('_')? {
            ("input", rest) => (Source::Input, Register::from_name(rest)?),
            ("output", rest) => (Source::Output, Register::from_name(rest)?),
            _ => return None,
        };
        version
            .has(register.since())
            .then_some((Self(source(register)), register.kind()))
    }

    /// Its value now.
    pub fn read(self, controller: &Controller) -> Value {
        match self.0 {
            Source::State(read) => read.value(controller),
            Source::Input(register) => register.read(&controller.robot.inputs),
            Source::Output(register) => register.read(&controller.robot.outputs),
        }
    }
}

impl Read {
    fn kind(self) -> Type {
        match self {
            Self::Double(_) => Type::Double,
            Self::Six(_) => Type::Vector6D,
            Self::Three(_) => Type::Vector3D,
            Self::SixInts(_) => Type::Vector6Int32,
            Self::Int(_) => Type::Int32,
            Self::Byte(_) => Type::UInt8,
            Self::Word(_) => Type::UInt32,
            Self::Long(_) => Type::UInt64,
        }
    }

    fn value(self, controller: &Controller) -> Value {
        match self {
            Self::Double(read) => Value::Double(read(controller)),
            Self::Six(read) => Value::Vector6D(read(controller)),
            Self::Three(read) => Value::Vector3D(read(controller)),
            Self::SixInts(read) => Value::Vector6Int32(read(controller)),
            Self::Int(read) => Value::Int32(read(controller)),
            Self::Byte(read) => Value::UInt8(read(controller)),
            Self::Word(read) => Value::UInt32(read(controller)),
            Self::Long(read) => Value::UInt64(read(controller)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(name: &str, version: &str) -> Option<Type> {
        Output::from_name(name, version.parse().unwrap()).map(|(_, kind)| kind)
    }

    #[test]
    fn a_field_is_there_since_the_version_that_brought_it() {
        for (name, cb3, e) in [
            ("payload", ("3.10.0", "3.11.0"), ("5.5.0", "5.5.1")),
            (
                "payload_inertia",
                ("3.14.3", "3.15.0"),
                ("5.10.2", "5.11.0"),
            ),
            ("safety_status", ("3.9.1", "3.10.0"), ("5.3.1", "5.4.0")),
            (
                "output_int_register_24",
                ("3.8.0", "3.9.0"),
                ("5.2.9", "5.3.0"),
            ),
        ] {
            for (before, since) in [cb3, e] {
                assert_eq!(kind(name, before), None, "{name} {before}");
                assert!(kind(name, since).is_some(), "{name} {since}");
            }
        }
        assert_eq!(kind("ft_raw_wrench", "3.15.8"), None);
        assert_eq!(kind("ft_raw_wrench", "5.9.0"), Some(Type::Vector6D));
        assert_eq!(kind("actual_current_as_torque", "5.22.0"), None);
        assert_eq!(kind("nonsense", "5.22.0"), None);
    }

    #[test]
    fn every_name_is_there_once_and_reads_as_its_type() {
        let controller = Controller::new(crate::ur5::Config::default());
        let mut names: Vec<_> = table::STATE.iter().map(|(name, ..)| *name).collect();
        for (name, _, read) in table::STATE {
            assert_eq!(read.value(&controller).kind(), read.kind(), "{name}");
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), table::STATE.len());
    }
}
