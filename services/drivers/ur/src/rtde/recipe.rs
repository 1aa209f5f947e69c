//! Typed recipes: a struct with the fields that are wanted, checked against the table of [`fields`](super::fields) while
//! it is compiled. [`outputs!`](crate::outputs) makes one of what a controller sends, [`inputs!`](crate::inputs) one of
//! what a client sends.

use super::wire::{Type, take};
use crate::{RobotMode, RuntimeState, SafetyMode};

/// A Rust type that can stand for a field.
pub trait FieldValue: Copy + Send + Sync + 'static {
    /// Type on the wire.
    const TYPE: Type;

    /// Takes the value off the front; `None` when bytes are missing.
    fn decode(bytes: &mut &[u8]) -> Option<Self>;

    /// Appends the bytes.
    fn encode(self, out: &mut Vec<u8>);
}

/// What a controller sends, as a struct. Made by [`outputs!`](crate::outputs).
pub trait Outputs: Copy + Send + Sync + 'static {
    /// Names and types in the order of the struct.
    const FIELDS: &'static [(&'static str, Type)];

    /// Reads the fields off the front; `None` when bytes are missing.
    fn decode(bytes: &mut &[u8]) -> Option<Self>;
}

/// What a client sends, as a struct. Made by [`inputs!`](crate::inputs).
pub trait Inputs: Copy + Send + Sync + 'static {
    /// Names and types in the order of the struct.
    const FIELDS: &'static [(&'static str, Type)];

    /// Appends the fields.
    fn encode(&self, out: &mut Vec<u8>);
}

/// Bytes of all fields.
pub const fn payload_bytes(fields: &[(&str, Type)]) -> usize {
    let mut bytes = 0;
    let mut at = 0;
    while at < fields.len() {
        bytes += fields[at].1.bytes();
        at += 1;
    }
    bytes
}

/// Bytes before this field; `None` when the recipe does not have it.
pub fn offset_of(fields: &[(&str, Type)], name: &str) -> Option<usize> {
    let at = fields.iter().position(|(known, _)| *known == name)?;
    Some(payload_bytes(&fields[..at]))
}

/// A struct of fields that the controller sends.
///
/// Fields bear the names of the RTDE guide, or `NAME as OWN_NAME`. A name that no controller has, or a type that is not
/// the field's, does not compile. `robot_mode`, `safety_mode` and `runtime_state` may be the enums of this crate.
///
/// ```
/// use ur_link::{RobotMode, rtde::Outputs};
///
/// ur_link::outputs! {
///     /// What a monitor shows.
///     pub struct Watch {
///         /// Measured joints, rad.
///         actual_q: [f64; 6],
///         actual_TCP_pose as tool_pose: [f64; 6],
///         robot_mode: RobotMode,
///         output_int_register_24 as session: i32,
///     }
/// }
///
/// assert_eq!(Watch::FIELDS[1].0, "actual_TCP_pose");
/// let mut bytes = &[0; 104][..];
/// let watch = Watch::decode(&mut bytes).unwrap();
/// assert_eq!(watch.robot_mode, RobotMode::Disconnected);
/// ```
///
/// ```compile_fail
/// ur_link::outputs! {
///     struct Watch { actual_joints: [f64; 6] }
/// }
/// ```
///
/// ```compile_fail
/// ur_link::outputs! {
///     struct Watch { actual_q: f64 }
/// }
/// ```
#[macro_export]
macro_rules! outputs {
    ($(#[$outer:meta])* $vis:vis struct $name:ident { $($fields:tt)+ }) => {
        $crate::__recipe! { outputs [$(#[$outer])* $vis struct $name] [] $($fields)+ }
    };
}

/// A struct of fields that the client sends.
///
/// Names, types and `as` are those of [`outputs!`](crate::outputs); a mask and its values belong in one recipe.
///
/// ```
/// use ur_link::rtde::Inputs;
///
/// ur_link::inputs! {
///     /// The speed slider.
///     struct Slider {
///         speed_slider_mask as mask: u32,
///         speed_slider_fraction as fraction: f64,
///     }
/// }
///
/// let mut bytes = Vec::new();
/// Slider { mask: 1, fraction: 0.5 }.encode(&mut bytes);
/// assert_eq!(bytes[..4], [0, 0, 0, 1]);
/// ```
///
/// ```compile_fail
/// ur_link::inputs! {
///     struct Joints { actual_q: [f64; 6] }
/// }
/// ```
#[macro_export]
macro_rules! inputs {
    ($(#[$outer:meta])* $vis:vis struct $name:ident { $($fields:tt)+ }) => {
        $crate::__recipe! { inputs [$(#[$outer])* $vis struct $name] [] $($fields)+ }
    };
}

/// Gives every field its own name, then writes the struct.
#[doc(hidden)]
#[macro_export]
macro_rules! __recipe {
    ($way:ident $head:tt [$($done:tt)*] $(#[$meta:meta])* $field:ident as $own:ident : $kind:ty $(, $($rest:tt)*)?) => {
        $crate::__recipe! { $way $head [$($done)* { [$(#[$meta])*] $field $own $kind }] $($($rest)*)? }
    };
    ($way:ident $head:tt [$($done:tt)*] $(#[$meta:meta])* $field:ident : $kind:ty $(, $($rest:tt)*)?) => {
        $crate::__recipe! { $way $head [$($done)* { [$(#[$meta])*] $field $field $kind }] $($($rest)*)? }
    };
    (
        $way:ident [$(#[$outer:meta])* $vis:vis struct $name:ident]
        [$({ [$(#[$meta:meta])*] $field:ident $own:ident $kind:ty })+]
    ) => {
        $(#[$outer])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[allow(non_snake_case)]
        $vis struct $name {
            $(
                $(#[$meta])*
                #[doc = concat!("`", stringify!($field), "`")]
                $vis $own: $kind,
            )+
        }

        $(const _: () = assert!(
            $crate::rtde::fields::is(
                $crate::__recipe!(@find $way stringify!($field)),
                <$kind as $crate::rtde::FieldValue>::TYPE,
            ),
            concat!(stringify!($field), " of type ", stringify!($kind), " is none of the RTDE ", stringify!($way)),
        );)+

        $crate::__recipe! { @trait $way $name $({ $field $own $kind })+ }
    };
    (@find outputs $name:expr) => { $crate::rtde::fields::output($name) };
    (@find inputs $name:expr) => { $crate::rtde::fields::input($name) };
    (@trait outputs $name:ident $({ $field:ident $own:ident $kind:ty })+) => {
        impl $crate::rtde::Outputs for $name {
            const FIELDS: &'static [(&'static str, $crate::rtde::wire::Type)] =
                &[$((stringify!($field), <$kind as $crate::rtde::FieldValue>::TYPE)),+];

            fn decode(bytes: &mut &[u8]) -> ::core::option::Option<Self> {
                ::core::option::Option::Some(Self {
                    $($own: $crate::rtde::FieldValue::decode(bytes)?,)+
                })
            }
        }
    };
    (@trait inputs $name:ident $({ $field:ident $own:ident $kind:ty })+) => {
        impl $crate::rtde::Inputs for $name {
            const FIELDS: &'static [(&'static str, $crate::rtde::wire::Type)] =
                &[$((stringify!($field), <$kind as $crate::rtde::FieldValue>::TYPE)),+];

            fn encode(&self, out: &mut ::std::vec::Vec<u8>) {
                $($crate::rtde::FieldValue::encode(self.$own, out);)+
            }
        }
    };
}

macro_rules! numbers {
    ($($of:ty => $kind:ident),+ $(,)?) => {$(
        impl FieldValue for $of {
            const TYPE: Type = Type::$kind;

            fn decode(bytes: &mut &[u8]) -> Option<Self> {
                take(bytes).map(Self::from_be_bytes)
            }

            fn encode(self, out: &mut Vec<u8>) {
                out.extend(self.to_be_bytes());
            }
        }
    )+};
}

numbers! {
    u8 => UInt8,
    u32 => UInt32,
    u64 => UInt64,
    i32 => Int32,
    f64 => Double,
}

macro_rules! vectors {
    ($($of:ty, $count:literal => $kind:ident),+ $(,)?) => {$(
        impl FieldValue for [$of; $count] {
            const TYPE: Type = Type::$kind;

            fn decode(bytes: &mut &[u8]) -> Option<Self> {
                let mut values = Self::default();
                for value in &mut values {
                    *value = <$of>::from_be_bytes(take(bytes)?);
                }
                Some(values)
            }

            fn encode(self, out: &mut Vec<u8>) {
                self.iter().for_each(|value| out.extend(value.to_be_bytes()));
            }
        }
    )+};
}

vectors! {
    f64, 3 => Vector3D,
    f64, 6 => Vector6D,
    i32, 6 => Vector6Int32,
    u32, 6 => Vector6UInt32,
}

impl FieldValue for bool {
    const TYPE: Type = Type::Bool;

    fn decode(bytes: &mut &[u8]) -> Option<Self> {
        take::<1>(bytes).map(|byte| byte != [0])
    }

    fn encode(self, out: &mut Vec<u8>) {
        out.push(u8::from(self));
    }
}

macro_rules! codes {
    ($($of:ty, $wire:ty),+ $(,)?) => {$(
        impl FieldValue for $of {
            const TYPE: Type = <$wire as FieldValue>::TYPE;

            fn decode(bytes: &mut &[u8]) -> Option<Self> {
                <$wire>::decode(bytes).map(|code| Self::from_code(code as i32))
            }

            fn encode(self, out: &mut Vec<u8>) {
                (self.code() as $wire).encode(out);
            }
        }
    )+};
}

codes! {
    RobotMode, i32,
    SafetyMode, i32,
    RuntimeState, u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::outputs! {
        struct Everything {
            timestamp: f64,
            actual_TCP_pose as tool_pose: [f64; 6],
            joint_mode: [i32; 6],
            elbow_position: [f64; 3],
            actual_digital_input_bits: u64,
            robot_mode: RobotMode,
            safety_mode: SafetyMode,
            runtime_state: RuntimeState,
            output_bit_register_64 as done: bool,
            tool_output_mode: u8,
            robot_status_bits: u32
        }
    }

    crate::inputs! {
        struct Setting {
            input_int_register_24 as mode: i32,
            input_double_register_24 as target: f64,
            input_bit_register_100 as go: bool,
            external_force_torque: [f64; 6],
        }
    }

    #[test]
    fn a_recipe_reads_its_fields_in_order_and_needs_them_all() {
        let mut bytes = Vec::new();
        1.5f64.encode(&mut bytes);
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0].encode(&mut bytes);
        [253i32, 253, 253, 253, 253, -1].encode(&mut bytes);
        [0.1, 0.2, 0.3].encode(&mut bytes);
        u64::MAX.encode(&mut bytes);
        RobotMode::Running.encode(&mut bytes);
        SafetyMode::Unknown(77).encode(&mut bytes);
        RuntimeState::Playing.encode(&mut bytes);
        true.encode(&mut bytes);
        9u8.encode(&mut bytes);
        3u32.encode(&mut bytes);
        assert_eq!(bytes.len(), payload_bytes(Everything::FIELDS));
        let state = Everything::decode(&mut &bytes[..]).unwrap();
        assert_eq!(state.tool_pose, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(state.joint_mode[5], -1);
        assert_eq!(state.safety_mode, SafetyMode::Unknown(77));
        assert!(state.done);
        assert_eq!((state.tool_output_mode, state.robot_status_bits), (9, 3));
        for end in 0..bytes.len() {
            assert_eq!(Everything::decode(&mut &bytes[..end]), None);
        }
    }

    #[test]
    fn inputs_are_written_in_order() {
        let setting = Setting {
            mode: -2,
            target: 0.5,
            go: true,
            external_force_torque: [0.0; 6],
        };
        let mut bytes = Vec::new();
        setting.encode(&mut bytes);
        assert_eq!(bytes.len(), payload_bytes(Setting::FIELDS));
        assert_eq!(bytes[..4], (-2i32).to_be_bytes());
        assert_eq!(bytes[12], 1);
    }

    #[test]
    fn the_place_of_a_field_is_known() {
        assert_eq!(offset_of(Everything::FIELDS, "joint_mode"), Some(56));
        assert_eq!(offset_of(Everything::FIELDS, "nothing"), None);
    }
}
