//! The header of a PCD file: which fields a point has and how they are written.

use super::MAX_VERTICES;
use crate::Point3;
use crate::stated::Statements;
use crate::surface::lines::{Line, Lines};
use crate::surface::scalar::Scalar;
use crate::surface::{Error, quoted, within};

/// Most numbers a point may have; the longest descriptor of PCL has 1980.
const MAX_NUMBERS: usize = 4096;

/// How the numbers of a file are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As words, a point a line.
    Ascii,
    /// As little-endian bytes, point by point.
    Binary,
    /// As little-endian bytes, field by field, packed by LZF.
    BinaryCompressed,
}

impl Encoding {
    const ALL: [Self; 3] = [Self::Ascii, Self::Binary, Self::BinaryCompressed];

    /// The word of the `DATA` line.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Binary => "binary",
            Self::BinaryCompressed => "binary_compressed",
        }
    }
}

/// What the header says.
pub(super) struct Header {
    pub(super) fields: Vec<Field>,
    pub(super) points: usize,
    pub(super) viewpoint: Option<Point3>,
    pub(super) encoding: Encoding,
    pub(super) statements: Statements,
}

/// One field of every point.
pub(super) struct Field {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// How many numbers of this type.
    pub(super) count: usize,
}

impl Field {
    /// Bytes of a point it takes.
    pub(super) fn bytes(&self) -> usize {
        self.count * self.scalar.size()
    }
}

/// Whether a file begins as a PCD file does.
pub(super) fn begins(bytes: &[u8]) -> bool {
    for mut line in Lines::new(bytes) {
        match line.comment('#') {
            Some(comment) if comment.starts_with(" .PCD") => return true,
            Some(_) => {}
            None if line.is_blank() => {}
            None => return matches!(line.word(), Some("VERSION" | "FIELDS" | "COLUMNS")),
        }
    }
    false
}

/// The entries of the header as they stand.
#[derive(Default)]
struct Entries<'a> {
    names: Vec<&'a str>,
    sizes: Vec<&'a str>,
    types: Vec<&'a str>,
    counts: Option<Vec<&'a str>>,
    width: Option<usize>,
    height: Option<usize>,
    points: Option<usize>,
    viewpoint: Option<Point3>,
}

impl Header {
    /// Takes the header off the front of the file.
    pub(super) fn read(lines: &mut Lines<'_>) -> Result<Self, Error> {
        let mut entries = Entries::default();
        let mut statements = Statements::default();
        loop {
            let mut line = lines.expect("`DATA`")?;
            if let Some(comment) = line.comment('#') {
                statements.read(&comment)?;
                continue;
            }
            match line.word().unwrap_or_default() {
                "VERSION" => continue,
                // The name of older versions.
                "FIELDS" | "COLUMNS" => entries.names = line.words(),
                "SIZE" => entries.sizes = line.words(),
                "TYPE" => entries.types = line.words(),
                "COUNT" => entries.counts = Some(line.words()),
                "WIDTH" => entries.width = Some(line.count("WIDTH")?),
                "HEIGHT" => entries.height = Some(line.count("HEIGHT")?),
                "POINTS" => entries.points = Some(line.count("POINTS")?),
                "VIEWPOINT" => entries.viewpoint = Some(read_viewpoint(&mut line)?),
                "DATA" => {
                    let encoding = read_encoding(&mut line)?;
                    line.end()?;
                    return Ok(Self {
                        fields: entries.fields(&line)?,
                        points: entries.points(&line)?,
                        viewpoint: entries.viewpoint,
                        encoding,
                        statements,
                    });
                }
                word => {
                    return Err(line.wrong(format!("{} is no word of a header", quoted(word))));
                }
            }
            line.end()?;
        }
    }

    /// Bytes of a point.
    pub(super) fn point_bytes(&self) -> usize {
        self.fields.iter().map(Field::bytes).sum()
    }
}

impl Entries<'_> {
    /// `last` is the last line of the header, where contradictions are reported.
    fn fields(&self, last: &Line<'_>) -> Result<Vec<Field>, Error> {
        if self.names.is_empty() {
            return Err(Error::Missing("FIELDS"));
        }
        let ones = vec!["1"; self.names.len()];
        let counts = self.counts.as_ref().unwrap_or(&ones);
        for (entry, words) in [
            ("SIZE", &self.sizes),
            ("TYPE", &self.types),
            ("COUNT", counts),
        ] {
            if words.len() != self.names.len() {
                return Err(last.wrong(format!(
                    "{entry} has {} words, FIELDS has {}",
                    words.len(),
                    self.names.len()
                )));
            }
        }
        let mut fields: Vec<Field> = Vec::with_capacity(self.names.len());
        for (index, name) in self.names.iter().enumerate() {
            let (kind, size) = (self.types[index], self.sizes[index]);
            let wrong = |what: String| last.wrong(format!("field {} {what}", quoted(name)));
            let field = Field {
                name: (*name).to_owned(),
                scalar: scalar(kind, size).ok_or_else(|| {
                    wrong(format!(
                        "is of TYPE {} and SIZE {}, which is no type of number",
                        quoted(kind),
                        quoted(size)
                    ))
                })?,
                count: counts[index].parse().map_err(|_| {
                    wrong(format!(
                        "has COUNT {}, must be a count",
                        quoted(counts[index])
                    ))
                })?,
            };
            if super::FIELDS.contains(name) {
                if field.count != 1 {
                    return Err(wrong(format!("has COUNT {}, must be 1", field.count)));
                }
                if fields.iter().any(|known| known.name == *name) {
                    return Err(wrong("is there twice".to_owned()));
                }
            }
            fields.push(field);
        }
        let numbers = fields
            .iter()
            .fold(0_usize, |sum, field| sum.saturating_add(field.count));
        within("number of a point", numbers, MAX_NUMBERS)?;
        Ok(fields)
    }

    fn points(&self, last: &Line<'_>) -> Result<usize, Error> {
        let grid = self
            .width
            .map(|width| width.saturating_mul(self.height.unwrap_or(1)));
        let points = match (self.points, grid) {
            (Some(points), Some(grid)) if points != grid => {
                return Err(last.wrong(format!("POINTS is {points}, WIDTH x HEIGHT is {grid}")));
            }
            (Some(points), _) | (None, Some(points)) => points,
            (None, None) => return Err(Error::Missing("POINTS")),
        };
        within("point", points, MAX_VERTICES)?;
        Ok(points)
    }
}

fn read_encoding(line: &mut Line<'_>) -> Result<Encoding, Error> {
    let word = line.word().unwrap_or_default();
    Encoding::ALL
        .into_iter()
        .find(|encoding| encoding.word() == word)
        .ok_or_else(|| line.wrong(format!("DATA is {}, which is not known", quoted(word))))
}

/// Position and orientation (w x y z) of the sensor; to say where the points were seen from the position is enough.
fn read_viewpoint(line: &mut Line<'_>) -> Result<Point3, Error> {
    let mut pose = [0.0; 7];
    for value in &mut pose {
        *value = line.number(Scalar::F32, "VIEWPOINT")?;
        if !value.is_finite() {
            return Err(line.wrong(format!("VIEWPOINT has {value}, must be finite")));
        }
    }
    Ok(Point3::new(pose[0], pose[1], pose[2]))
}

fn scalar(kind: &str, size: &str) -> Option<Scalar> {
    Some(match (kind, size) {
        ("I", "1") => Scalar::I8,
        ("I", "2") => Scalar::I16,
        ("I", "4") => Scalar::I32,
        ("I", "8") => Scalar::I64,
        ("U", "1") => Scalar::U8,
        ("U", "2") => Scalar::U16,
        ("U", "4") => Scalar::U32,
        ("U", "8") => Scalar::U64,
        ("F", "4") => Scalar::F32,
        ("F", "8") => Scalar::F64,
        _ => return None,
    })
}
