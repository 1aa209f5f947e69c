//! The header of a PLY file: how the body is written and what stands in it.

use super::{MAX_TRIANGLES, MAX_VERTICES};
use crate::stated::Statements;
use crate::surface::lines::{Line, Lines};
use crate::surface::scalar::Scalar;
use crate::surface::{Error, quoted, within};

/// How the numbers of a file are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As words, an element a line.
    Ascii,
    /// As bytes, the lowest first.
    BinaryLittleEndian,
    /// As bytes, the highest first.
    BinaryBigEndian,
}

impl Encoding {
    const ALL: [Self; 3] = [Self::Ascii, Self::BinaryLittleEndian, Self::BinaryBigEndian];

    /// The word of the `format` line.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::BinaryLittleEndian => "binary_little_endian",
            Self::BinaryBigEndian => "binary_big_endian",
        }
    }
}

/// What the header says.
pub(super) struct Header {
    pub(super) encoding: Encoding,
    /// In the order of the body.
    pub(super) elements: Vec<Element>,
    pub(super) statements: Statements,
}

/// So many things that have the same properties.
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    /// In the order of the body.
    pub(super) properties: Vec<Property>,
}

pub(super) struct Property {
    pub(super) name: String,
    pub(super) value: Value,
}

/// How a property is written.
#[derive(Clone, Copy)]
pub(super) enum Value {
    One(Scalar),
    /// A count, then so many items.
    List {
        count: Scalar,
        item: Scalar,
    },
}

impl Header {
    /// Takes the header off the front of the file.
    pub(super) fn read(lines: &mut Lines<'_>) -> Result<Self, Error> {
        let mut first = lines.expect("`ply`")?;
        if first.word() != Some("ply") {
            return Err(first.wrong("must be `ply`".to_owned()));
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut statements = Statements::default();
        loop {
            let mut line = lines.expect("`end_header`")?;
            match line.word().unwrap_or_default() {
                "format" => encoding = Some(read_encoding(&mut line)?),
                "comment" => {
                    statements.read(&line.text())?;
                    continue;
                }
                "obj_info" => continue,
                "element" => {
                    let element = read_element(&mut line)?;
                    if elements.iter().any(|known| known.name == element.name) {
                        return Err(
                            line.wrong(format!("element {} is there twice", quoted(&element.name)))
                        );
                    }
                    elements.push(element);
                }
                "property" => {
                    let property = read_property(&mut line)?;
                    let element = elements.last_mut().ok_or_else(|| {
                        line.wrong("a property stands before any element".to_owned())
                    })?;
                    if element.properties.iter().any(|p| p.name == property.name) {
                        return Err(line.wrong(format!(
                            "property {} is there twice",
                            quoted(&property.name)
                        )));
                    }
                    element.properties.push(property);
                }
                "end_header" => {
                    line.end()?;
                    break;
                }
                word => {
                    return Err(line.wrong(format!("{} is no word of a header", quoted(word))));
                }
            }
            line.end()?;
        }
        Ok(Self {
            encoding: encoding.ok_or(Error::Missing("`format` line"))?,
            elements,
            statements,
        })
    }

    /// Refuses by the header, before anything is allocated. An element takes at least one byte of the file.
    pub(super) fn check_counts(&self, file_bytes: usize) -> Result<(), Error> {
        for element in &self.elements {
            let limit = match element.name.as_str() {
                "vertex" => MAX_VERTICES,
                "face" => MAX_TRIANGLES,
                _ => file_bytes,
            };
            within(&element.name, element.count, limit.min(file_bytes))?;
        }
        Ok(())
    }
}

fn read_encoding(line: &mut Line<'_>) -> Result<Encoding, Error> {
    let word = line.word().unwrap_or_default();
    let encoding = Encoding::ALL
        .into_iter()
        .find(|encoding| encoding.word() == word)
        .ok_or_else(|| line.wrong(format!("{} is no known format", quoted(word))))?;
    match line.word() {
        Some("1.0") => Ok(encoding),
        version => Err(line.wrong(format!(
            "the version is {}, known is 1.0",
            quoted(version.unwrap_or_default())
        ))),
    }
}

fn read_element(line: &mut Line<'_>) -> Result<Element, Error> {
    Ok(Element {
        name: line.expect_word("name")?.to_owned(),
        count: line.count("number of elements")?,
        properties: Vec::new(),
    })
}

fn read_property(line: &mut Line<'_>) -> Result<Property, Error> {
    let value = match line.word().unwrap_or_default() {
        "list" => {
            let count = read_scalar(line)?;
            if !count.is_integer() {
                return Err(line.wrong(format!("the length of a list is no {count}")));
            }
            Value::List {
                count,
                item: read_scalar(line)?,
            }
        }
        word => Value::One(scalar(line, word)?),
    };
    Ok(Property {
        name: line.expect_word("name")?.to_owned(),
        value,
    })
}

fn read_scalar(line: &mut Line<'_>) -> Result<Scalar, Error> {
    let word = line.word().unwrap_or_default();
    scalar(line, word)
}

fn scalar(line: &Line<'_>, word: &str) -> Result<Scalar, Error> {
    Ok(match word {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return Err(line.wrong(format!("{} is no type of number", quoted(word)))),
    })
}
