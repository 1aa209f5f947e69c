//! The values of voxels, in whichever type a scanner or a segmentation writes.

use std::str::FromStr;

/// Voxel values, along the first axis of the lattice first.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "each is the vector its name says")]
pub enum Voxels {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// The type of a voxel's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is the number its name says")]
pub enum VoxelType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// The order of a value's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ByteOrder {
    /// The lowest first.
    Little,
    /// The highest first.
    Big,
}

/// A number that a voxel may hold.
pub trait Value: Copy + PartialOrd + FromStr + Into<f64> + Send + Sync + 'static {
    /// The value of this type that equals `number`, if there is one.
    fn exactly(number: f64) -> Option<Self>;
}

/// Work on voxels of whichever type.
pub trait Visit {
    /// What the work gives.
    type Output;
    /// Does it.
    fn visit<T: Value>(self, values: &[T]) -> Self::Output;
}

/// Does `$work` with the vector of whichever type.
macro_rules! each {
    ($voxels:expr, $values:ident => $work:expr) => {
        match $voxels {
            Voxels::I8($values) => $work,
            Voxels::U8($values) => $work,
            Voxels::I16($values) => $work,
            Voxels::U16($values) => $work,
            Voxels::I32($values) => $work,
            Voxels::U32($values) => $work,
            Voxels::F32($values) => $work,
            Voxels::F64($values) => $work,
        }
    };
}

impl Voxels {
    /// No values yet, with room for `count`.
    pub fn with_capacity(kind: VoxelType, count: usize) -> Self {
        match kind {
            VoxelType::I8 => Self::I8(Vec::with_capacity(count)),
            VoxelType::U8 => Self::U8(Vec::with_capacity(count)),
            VoxelType::I16 => Self::I16(Vec::with_capacity(count)),
            VoxelType::U16 => Self::U16(Vec::with_capacity(count)),
            VoxelType::I32 => Self::I32(Vec::with_capacity(count)),
            VoxelType::U32 => Self::U32(Vec::with_capacity(count)),
            VoxelType::F32 => Self::F32(Vec::with_capacity(count)),
            VoxelType::F64 => Self::F64(Vec::with_capacity(count)),
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        each!(self, values => values.len())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Lets `work` see the values in their own type.
    pub fn visit<V: Visit>(&self, work: V) -> V::Output {
        each!(self, values => work.visit(values))
    }

    /// Appends packed values; bytes that are no whole value at the end are left out.
    pub fn append(&mut self, bytes: &[u8], order: ByteOrder) {
        each!(self, values => Packed::unpack(bytes, order, values));
    }

    /// Appends a value written in decimals; `None` if it is no number of this type.
    pub fn append_word(&mut self, word: &str) -> Option<()> {
        each!(self, values => values.push(word.parse().ok()?));
        Some(())
    }
}

impl VoxelType {
    /// Bytes of a value.
    pub fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A number as packed bytes.
trait Packed: Sized {
    fn unpack(bytes: &[u8], order: ByteOrder, values: &mut Vec<Self>);
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Value for $number {
            fn exactly(number: f64) -> Option<Self> {
                // A cast saturates, so that a number out of range does not equal what it became.
                let cast = number as $number;
                (f64::from(cast) == number).then_some(cast)
            }
        }

        impl Packed for $number {
            fn unpack(bytes: &[u8], order: ByteOrder, values: &mut Vec<Self>) {
                let packed = bytes.as_chunks::<{ size_of::<$number>() }>().0.iter().copied();
                match order {
                    ByteOrder::Little => values.extend(packed.map(<$number>::from_le_bytes)),
                    ByteOrder::Big => values.extend(packed.map(<$number>::from_be_bytes)),
                }
            }
        }
    )*};
}

numbers!(i8, u8, i16, u16, i32, u32, f32, f64);
