//! Which axes and which unit a file's coordinates are in: what its header says and what the caller says of it.

use ply_rs_bw::ply::Header;

use super::Error;
use crate::Vector3;

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

/// Factors on x, y and z that carry the file's coordinates to LPS and mm.
pub(super) fn to_lps_mm(header: &Header, stated: Option<Stated>) -> Result<Vector3, Error> {
    let mut space = stated.map(|stated| stated.space);
    let mut unit = stated.map(|stated| stated.unit);
    for comment in &header.comments {
        if let Some(word) = statement(comment, "space") {
            agree("space", &mut space, parse_space(&word)?)?;
        }
        if let Some(word) = statement(comment, "unit") {
            agree("unit", &mut unit, parse_unit(&word)?)?;
        }
    }
    let space = space.ok_or(Error::Unstated("space", "space LPS"))?;
    let unit = unit.ok_or(Error::Unstated("unit", "unit mm"))?;
    let mm = match unit {
        Unit::Millimetre => 1.0,
        Unit::Metre => 1000.0,
    };
    Ok(match space {
        Space::Lps => Vector3::new(mm, mm, mm),
        Space::Ras => Vector3::new(-mm, -mm, mm),
    })
}

/// The word after `key` in `key word`, or in `... key=word` as Slicer writes it.
fn statement(comment: &str, key: &str) -> Option<String> {
    let words: Vec<&str> = comment.split_whitespace().collect();
    if let [first, word] = words[..]
        && first.trim_end_matches(':').eq_ignore_ascii_case(key)
    {
        return Some(word.to_owned());
    }
    words.iter().find_map(|word| {
        let (name, value) = word.split_once('=')?;
        name.eq_ignore_ascii_case(key).then(|| value.to_owned())
    })
}

fn parse_space(word: &str) -> Result<Space, Error> {
    match word.to_ascii_uppercase().as_str() {
        "LPS" => Ok(Space::Lps),
        "RAS" => Ok(Space::Ras),
        _ => Err(Error::UnknownStatement {
            field: "space",
            value: word.to_owned(),
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
            value: word.to_owned(),
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
