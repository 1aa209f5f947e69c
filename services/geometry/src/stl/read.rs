//! Reads an STL file and makes one vertex of corners that coincide.

use std::collections::HashMap;

use super::{FACET_BYTES, HEADER_BYTES, MAX_TRIANGLES, MAX_VERTICES};
use crate::Cloud;
use crate::stated::Statements;
use crate::surface::lines::{Line, Lines};
use crate::surface::scalar::{Endian, Scalar};
use crate::surface::{self, Error, Kind, Surface, quoted, within};

/// Whether the bytes are an STL file: of just the length that a binary file announces, or opened by the word `solid`.
pub fn is_stl(bytes: &[u8]) -> bool {
    is_binary(bytes) || is_ascii(bytes)
}

/// Reads a file as it stands.
///
/// # Errors
/// When the file is not an STL file, is cut short, or holds what a [`Surface`] must not.
pub fn read(bytes: &[u8]) -> Result<Surface, Error> {
    // Binary files that begin with `solid` exist, so the length is asked first.
    let (welded, statements) = if !is_binary(bytes) && is_ascii(bytes) {
        read_words(bytes)?
    } else {
        read_numbers(bytes)?
    };
    if welded.triangles.is_empty() {
        return Err(Error::Missing("faces"));
    }
    Ok(Surface {
        kind: Kind::Stl,
        cloud: welded.cloud,
        triangles: welded.triangles,
        statements,
        viewpoint: None,
    })
}

fn is_ascii(bytes: &[u8]) -> bool {
    let mut lines = Lines::new(bytes);
    let first = lines.find(|line| !line.is_blank());
    first.is_some_and(|mut line| is_word(line.word(), "solid"))
}

fn is_binary(bytes: &[u8]) -> bool {
    announced(bytes).is_some_and(|facets| bytes.len() == HEADER_BYTES + facets * FACET_BYTES)
}

/// How many facets the header of a binary file announces.
fn announced(bytes: &[u8]) -> Option<usize> {
    let mut count = bytes.get(HEADER_BYTES - 4..)?;
    Some(Scalar::U32.take(&mut count, Endian::Little)? as usize)
}

fn read_numbers(bytes: &[u8]) -> Result<(Welded, Statements), Error> {
    let Some(facets) = announced(bytes) else {
        return Err(Error::Byte {
            byte: bytes.len(),
            what: "the file ends here, it neither begins with `solid` nor holds a header"
                .to_owned(),
        });
    };
    within("triangle", facets, MAX_TRIANGLES)?;
    if !is_binary(bytes) {
        return Err(Error::Byte {
            byte: bytes.len(),
            what: format!(
                "the file ends here, {facets} announced triangles end at byte {}",
                HEADER_BYTES + facets * FACET_BYTES
            ),
        });
    }
    let mut statements = Statements::default();
    let header = String::from_utf8_lossy(&bytes[..HEADER_BYTES - 4]);
    statements.read(header.split('\0').next().unwrap_or_default())?;

    let mut welded = Welded::with_capacity(facets);
    for facet in bytes[HEADER_BYTES..].chunks_exact(FACET_BYTES) {
        let mut numbers = &facet[12..];
        let mut corners = [[0.0; 3]; 3];
        for coordinate in corners.as_flattened_mut() {
            *coordinate = Scalar::F32
                .take(&mut numbers, Endian::Little)
                .unwrap_or(f64::NAN);
        }
        welded.push(corners)?;
    }
    Ok((welded, statements))
}

fn read_words(bytes: &[u8]) -> Result<(Welded, Statements), Error> {
    let mut lines = Lines::new(bytes);
    let mut welded = Welded::with_capacity(0);
    let mut statements = Statements::default();
    // A file may hold several solids.
    while let Some(mut line) = lines.find(|line| !line.is_blank()) {
        expect(&mut line, &["solid"])?;
        statements.read(&line.text())?;
        loop {
            let mut line = lines.expect("`endsolid`")?;
            let word = line.word();
            if is_word(word, "endsolid") {
                break;
            }
            if !is_word(word, "facet") {
                let word = quoted(word.unwrap_or_default());
                return Err(line.wrong(format!("{word} must be `facet` or `endsolid`")));
            }
            welded.push(read_facet(&mut lines)?)?;
        }
    }
    Ok((welded, statements))
}

/// What follows the line that begins a facet.
fn read_facet(lines: &mut Lines<'_>) -> Result<[[f64; 3]; 3], Error> {
    expect(&mut lines.expect("`outer loop`")?, &["outer", "loop"])?;
    let mut corners = [[0.0; 3]; 3];
    for corner in &mut corners {
        let mut line = lines.expect("`vertex`")?;
        expect(&mut line, &["vertex"])?;
        for (coordinate, name) in corner.iter_mut().zip(["x", "y", "z"]) {
            *coordinate = line.number(Scalar::F64, name)?;
        }
        line.end()?;
    }
    expect(&mut lines.expect("`endloop`")?, &["endloop"])?;
    expect(&mut lines.expect("`endfacet`")?, &["endfacet"])?;
    Ok(corners)
}

fn expect(line: &mut Line<'_>, words: &[&str]) -> Result<(), Error> {
    for expected in words {
        let word = line.word();
        if !is_word(word, expected) {
            let word = quoted(word.unwrap_or_default());
            return Err(line.wrong(format!("{word} must be `{expected}`")));
        }
    }
    Ok(())
}

fn is_word(word: Option<&str>, expected: &str) -> bool {
    word.is_some_and(|word| word.eq_ignore_ascii_case(expected))
}

/// Triangles whose corners that coincide are one vertex.
struct Welded {
    cloud: Cloud,
    triangles: Vec<[u32; 3]>,
    /// By the bits of its coordinates. Only looked up, never walked through: the order of vertices is the file's.
    vertex_at: HashMap<[u64; 3], u32>,
}

impl Welded {
    fn with_capacity(triangles: usize) -> Self {
        Self {
            cloud: Cloud::default(),
            triangles: Vec::with_capacity(triangles),
            // A closed surface has half as many vertices as triangles.
            vertex_at: HashMap::with_capacity(triangles / 2),
        }
    }

    fn push(&mut self, corners: [[f64; 3]; 3]) -> Result<(), Error> {
        within("triangle", self.triangles.len() + 1, MAX_TRIANGLES)?;
        let mut triangle = [0; 3];
        for (index, corner) in triangle.iter_mut().zip(corners) {
            // Adding zero makes -0 the 0 that it equals.
            let bits = corner.map(|coordinate| (coordinate + 0.0).to_bits());
            *index = match self.vertex_at.get(&bits) {
                Some(known) => *known,
                None => {
                    let vertex = self.cloud.points.len();
                    within("vertex", vertex + 1, MAX_VERTICES)?;
                    let point = surface::point(vertex, corner, ["x", "y", "z"])?;
                    self.cloud.points.push(point);
                    self.vertex_at.insert(bits, vertex as u32);
                    vertex as u32
                }
            };
        }
        self.triangles.push(triangle);
        Ok(())
    }
}
