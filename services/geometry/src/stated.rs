//! Which axes and which unit a file's coordinates are in: what the file says and what the caller says of it.
//!
//! A file says it in a comment of its header, as `space RAS` and `unit m`, or as `SPACE=RAS` and `UNIT=m` among other
//! words (3D Slicer writes `3D Slicer output. SPACE=LPS`).

use crate::Vector3;
use crate::surface::{Error, quoted};

/// The patient axes a file's coordinates are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// +x left, +y posterior, +z superior (DICOM).
    Lps,
    /// +x right, +y anterior, +z superior (Slicer).
    Ras,
}

/// The unit a file's coordinates are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Millimetres.
    Millimetre,
    /// Metres.
    Metre,
}

/// What the caller knows of a file that does not say it itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stated {
    /// Axes of the coordinates.
    pub space: Space,
    /// Unit of the coordinates.
    pub unit: Unit,
}

impl Stated {
    /// The coordinates of the house.
    pub const LPS_MM: Self = Self {
        space: Space::Lps,
        unit: Unit::Millimetre,
    };

    /// Factors on x, y and z that carry the file's coordinates to LPS and mm.
    pub fn to_lps_mm(self) -> Vector3 {
        let mm = match self.unit {
            Unit::Millimetre => 1.0,
            Unit::Metre => 1000.0,
        };
        match self.space {
            Space::Lps => Vector3::new(mm, mm, mm),
            Space::Ras => Vector3::new(-mm, -mm, mm),
        }
    }
}

/// What a file says of its own coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Statements {
    /// Their axes, if the file states them.
    pub space: Option<Space>,
    /// Their unit, if the file states it.
    pub unit: Option<Unit>,
}

impl Statements {
    /// Takes in what one comment states, if it states anything.
    pub(crate) fn read(&mut self, comment: &str) -> Result<(), Error> {
        if let Some(word) = statement(comment, "space") {
            agree("space", &mut self.space, parse_space(word)?)?;
        }
        if let Some(word) = statement(comment, "unit") {
            agree("unit", &mut self.unit, parse_unit(word)?)?;
        }
        Ok(())
    }

    /// Adds what the caller states; the two must not contradict each other.
    pub(crate) fn and(mut self, stated: Option<Stated>) -> Result<Self, Error> {
        if let Some(stated) = stated {
            agree("space", &mut self.space, stated.space)?;
            agree("unit", &mut self.unit, stated.unit)?;
        }
        Ok(self)
    }
}

/// The word after `key` in `key word`, or in `... key=word` as Slicer writes it.
fn statement<'a>(comment: &'a str, key: &str) -> Option<&'a str> {
    let mut words = comment.split_whitespace();
    if let (Some(first), Some(word), None) = (words.next(), words.next(), words.next())
        && first.trim_end_matches(':').eq_ignore_ascii_case(key)
    {
        return Some(word);
    }
    comment.split_whitespace().find_map(|word| {
        let (name, value) = word.split_once('=')?;
        name.eq_ignore_ascii_case(key).then_some(value)
    })
}

fn parse_space(word: &str) -> Result<Space, Error> {
    match word.to_ascii_uppercase().as_str() {
        "LPS" => Ok(Space::Lps),
        "RAS" => Ok(Space::Ras),
        _ => Err(Error::UnknownStatement {
            field: "space",
            value: quoted(word),
            known: "LPS and RAS",
        }),
    }
}

fn parse_unit(word: &str) -> Result<Unit, Error> {
    match word {
        "mm" => Ok(Unit::Millimetre),
        "m" => Ok(Unit::Metre),
        _ => Err(Error::UnknownStatement {
            field: "unit",
            value: quoted(word),
            known: "mm and m",
        }),
    }
}

fn agree<T: Copy + PartialEq + std::fmt::Debug>(
    field: &'static str,
    known: &mut Option<T>,
    found: T,
) -> Result<(), Error> {
    match *known {
        Some(first) if first != found => Err(Error::Contradiction {
            field,
            first: format!("{first:?}"),
            second: format!("{found:?}"),
        }),
        _ => {
            *known = Some(found);
            Ok(())
        }
    }
}
