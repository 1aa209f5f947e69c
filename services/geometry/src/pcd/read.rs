//! Reads the points of a PCD file by its header.

use std::borrow::Cow;

use super::header::{Encoding, Header};
use super::{FIELDS, lzf};
use crate::Cloud;
use crate::surface::lines::Lines;
use crate::surface::scalar::{Endian, Scalar};
use crate::surface::{self, Error, Kind, Surface, within};

/// Most bytes a packed file may unpack to: 128 for each of the points it may have.
pub const MAX_UNPACKED_BYTES: usize = 128 * super::MAX_VERTICES;

/// Reads a file as it stands.
///
/// # Errors
/// When the file is not a PCD file, is cut short, or holds what a [`Surface`] must not.
pub fn read(bytes: &[u8]) -> Result<Surface, Error> {
    let mut lines = Lines::new(bytes);
    let header = Header::read(&mut lines)?;
    let is_there = |name: &&str| header.fields.iter().any(|field| field.name == *name);
    if !FIELDS[..3].iter().all(is_there) {
        return Err(Error::Missing("fields x, y and z"));
    }
    let wanted = match FIELDS[3..].iter().all(is_there) {
        true => &FIELDS[..],
        false => &FIELDS[..3],
    };
    let cloud = match header.encoding {
        Encoding::Ascii => read_words(&header, wanted, lines)?,
        Encoding::Binary | Encoding::BinaryCompressed => {
            let start = bytes.len() - lines.rest().len();
            read_numbers(&header, wanted, lines.rest(), start)?
        }
    };
    if cloud.points.is_empty() {
        return Err(Error::Missing("points"));
    }
    Ok(Surface {
        kind: Kind::Pcd,
        cloud,
        triangles: Vec::new(),
        statements: header.statements,
        viewpoint: header.viewpoint,
    })
}

fn read_words(header: &Header, wanted: &[&str], mut lines: Lines<'_>) -> Result<Cloud, Error> {
    // A point takes at least two bytes of the file: a digit and the end of its line.
    within("point", header.points, lines.rest().len())?;
    let mut cloud = Cloud::new(Vec::with_capacity(header.points));
    for point in 0..header.points {
        let mut line = lines.expect("the last point")?;
        let mut values = [0.0; 6];
        for field in &header.fields {
            match wanted.iter().position(|name| *name == field.name) {
                Some(place) => values[place] = line.number(field.scalar, &field.name)?,
                None => {
                    for _ in 0..field.count {
                        line.expect_word(&field.name)?;
                    }
                }
            }
        }
        line.end()?;
        push(&mut cloud, point, values, wanted.len() == FIELDS.len())?;
    }
    Ok(cloud)
}

/// `start` is where `body` begins in the file.
fn read_numbers(
    header: &Header,
    wanted: &[&str],
    body: &[u8],
    start: usize,
) -> Result<Cloud, Error> {
    let body_bytes = header.points * header.point_bytes();
    let data = match header.encoding {
        Encoding::BinaryCompressed => Cow::Owned(unpack(body, body_bytes, start)?),
        _ => Cow::Borrowed(body),
    };
    let cut_short = || Error::Byte {
        byte: start + data.len(),
        what: format!(
            "the file ends here, {} points of {} bytes begin at byte {start}",
            header.points,
            header.point_bytes()
        ),
    };
    if data.len() < body_bytes {
        return Err(cut_short());
    }
    let columns = columns(header, wanted);
    let mut cloud = Cloud::new(Vec::with_capacity(header.points));
    for point in 0..header.points {
        let mut values = [0.0; 6];
        for (place, column) in &columns {
            values[*place] = column.value(&data, point).ok_or_else(cut_short)?;
        }
        push(&mut cloud, point, values, wanted.len() == FIELDS.len())?;
    }
    Ok(cloud)
}

/// Packed data open with their packed and their unpacked length.
fn unpack(body: &[u8], body_bytes: usize, start: usize) -> Result<Vec<u8>, Error> {
    within("unpacked byte", body_bytes, MAX_UNPACKED_BYTES)?;
    let wrong = |what: String| Error::Byte { byte: start, what };
    let mut rest = body;
    let mut length = || Scalar::U32.take(&mut rest, Endian::Little);
    let (Some(packed), Some(unpacked)) = (length(), length()) else {
        return Err(wrong("the file ends before its packed data".to_owned()));
    };
    let (packed, unpacked) = (packed as usize, unpacked as usize);
    if unpacked != body_bytes {
        return Err(wrong(format!(
            "{unpacked} unpacked bytes are announced, the points take {body_bytes}"
        )));
    }
    let data = rest.get(..packed).ok_or_else(|| {
        wrong(format!(
            "{packed} packed bytes are announced, the file has {}",
            rest.len()
        ))
    })?;
    lzf::unpack(data, unpacked).map_err(|error| wrong(error.to_string()))
}

/// Where the numbers of one field stand in the binary data.
struct Column {
    scalar: Scalar,
    /// Offset of the first point's number.
    first: usize,
    /// Bytes from one point's number to the next one's.
    step: usize,
}

impl Column {
    fn value(&self, data: &[u8], point: usize) -> Option<f64> {
        let mut number = data.get(self.first + point * self.step..)?;
        self.scalar.take(&mut number, Endian::Little)
    }
}

/// The fields that are wanted, each with its place in the list of those.
fn columns(header: &Header, wanted: &[&str]) -> Vec<(usize, Column)> {
    let mut columns = Vec::with_capacity(wanted.len());
    let mut offset = 0;
    for field in &header.fields {
        if let Some(place) = wanted.iter().position(|name| *name == field.name) {
            let (first, step) = match header.encoding {
                Encoding::BinaryCompressed => (offset * header.points, field.bytes()),
                _ => (offset, header.point_bytes()),
            };
            let column = Column {
                scalar: field.scalar,
                first,
                step,
            };
            columns.push((place, column));
        }
        offset += field.bytes();
    }
    columns
}

fn push(cloud: &mut Cloud, point: usize, values: [f64; 6], has_normal: bool) -> Result<(), Error> {
    let [px, py, pz, normal @ ..] = values;
    let [x, y, z, normal_fields @ ..] = FIELDS;
    cloud
        .points
        .push(surface::point(point, [px, py, pz], [x, y, z])?);
    if has_normal {
        cloud
            .normals
            .push(surface::unit_normal(point, normal, normal_fields)?);
    }
    Ok(())
}
