//! Reads the body of a PLY file by its header.

use super::VERTEX_FIELDS;
use super::header::{Element, Encoding, Header, Property, Value};
use crate::Cloud;
use crate::surface::lines::{Line, Lines};
use crate::surface::scalar::{Endian, Scalar};
use crate::surface::{self, Error, Kind, Surface, quoted};

/// Reads a file as it stands; polygons become fans of triangles.
///
/// # Errors
/// When the file is not a PLY file, is cut short, or holds what a [`Surface`] must not.
pub fn read(bytes: &[u8]) -> Result<Surface, Error> {
    let mut lines = Lines::new(bytes);
    let header = Header::read(&mut lines)?;
    header.check_counts(bytes.len())?;
    let vertices = header
        .elements
        .iter()
        .find(|element| element.name == "vertex")
        .map_or(0, |element| element.count);

    let mut body = match header.encoding {
        Encoding::Ascii => Body::Ascii {
            lines,
            line: Line::empty(),
        },
        Encoding::BinaryLittleEndian => Body::binary(bytes, lines.rest(), Endian::Little),
        Encoding::BinaryBigEndian => Body::binary(bytes, lines.rest(), Endian::Big),
    };
    let (mut cloud, mut triangles) = (Cloud::default(), Vec::new());
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => cloud = read_vertices(&mut body, element)?,
            "face" => triangles = read_faces(&mut body, element, vertices)?,
            _ => skip(&mut body, element)?,
        }
    }
    if cloud.points.is_empty() {
        return Err(Error::Missing("vertices"));
    }
    Ok(Surface {
        kind: Kind::Ply,
        cloud,
        triangles,
        statements: header.statements,
        viewpoint: None,
    })
}

fn read_vertices(body: &mut Body<'_>, element: &Element) -> Result<Cloud, Error> {
    let places: Vec<Option<usize>> = element
        .properties
        .iter()
        .map(|property| VERTEX_FIELDS.iter().position(|name| *name == property.name))
        .collect();
    let is_there = |place: usize| {
        let of_scalars = element.properties.iter().zip(&places);
        of_scalars
            .filter(|(property, _)| matches!(property.value, Value::One(_)))
            .any(|(_, known)| *known == Some(place))
    };
    if !(0..3).all(is_there) {
        return Err(Error::Missing("vertex properties x, y and z"));
    }
    let has_normals = (3..6).all(is_there);
    let [x, y, z, nx, ny, nz] = VERTEX_FIELDS;

    let mut cloud = Cloud::new(Vec::with_capacity(element.count));
    for vertex in 0..element.count {
        body.begin(element)?;
        let mut values = [0.0; 6];
        for (property, place) in element.properties.iter().zip(&places) {
            match (property.value, place) {
                (Value::One(scalar), Some(place)) => {
                    values[*place] = body.number(scalar, property)?;
                }
                _ => body.skip(property)?,
            }
        }
        body.end()?;
        let [px, py, pz, normal @ ..] = values;
        cloud
            .points
            .push(surface::point(vertex, [px, py, pz], [x, y, z])?);
        if has_normals {
            cloud
                .normals
                .push(surface::unit_normal(vertex, normal, [nx, ny, nz])?);
        }
    }
    Ok(cloud)
}

fn read_faces(
    body: &mut Body<'_>,
    element: &Element,
    vertices: usize,
) -> Result<Vec<[u32; 3]>, Error> {
    let is_corners = |property: &Property| {
        matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
            && matches!(property.value, Value::List { item, .. } if item.is_integer())
    };
    let indices = element.properties.iter().position(is_corners);
    if indices.is_none() && element.count > 0 {
        return Err(Error::Missing("face property vertex_indices"));
    }
    let mut triangles = Vec::with_capacity(element.count);
    let mut corners = Vec::new();
    for face in 0..element.count {
        body.begin(element)?;
        corners.clear();
        for (index, property) in element.properties.iter().enumerate() {
            match property.value {
                Value::List { count, item } if Some(index) == indices => {
                    for _ in 0..body.length(count, property)? {
                        let corner = body.number(item, property)?;
                        corners.push(vertex_index(face, corner, vertices)?);
                    }
                }
                _ => body.skip(property)?,
            }
        }
        body.end()?;
        surface::push_polygon(&mut triangles, face, &corners)?;
    }
    Ok(triangles)
}

/// `corner` is a whole number of at most 32 bits.
fn vertex_index(face: usize, corner: f64, vertices: usize) -> Result<u32, Error> {
    if corner < 0.0 || corner >= vertices as f64 {
        return Err(Error::IndexOutOfRange {
            face,
            index: corner as i64,
            vertices,
        });
    }
    Ok(corner as u32)
}

/// An element nobody asked for.
fn skip(body: &mut Body<'_>, element: &Element) -> Result<(), Error> {
    for _ in 0..element.count {
        body.begin(element)?;
        for property in &element.properties {
            body.skip(property)?;
        }
        body.end()?;
    }
    Ok(())
}

/// What follows the header, read number by number.
enum Body<'a> {
    Ascii {
        lines: Lines<'a>,
        /// The line of the element being read.
        line: Line<'a>,
    },
    Binary {
        rest: &'a [u8],
        file_bytes: usize,
        endian: Endian,
    },
}

impl<'a> Body<'a> {
    fn binary(file: &[u8], rest: &'a [u8], endian: Endian) -> Self {
        Self::Binary {
            rest,
            file_bytes: file.len(),
            endian,
        }
    }

    /// Begins the next of these elements: in a text each has a line of its own.
    fn begin(&mut self, element: &Element) -> Result<(), Error> {
        if let Self::Ascii { lines, line } = self
            && !element.properties.is_empty()
        {
            *line = lines.expect("its last element")?;
        }
        Ok(())
    }

    /// Ends an element.
    fn end(&mut self) -> Result<(), Error> {
        match self {
            Self::Ascii { line, .. } => line.end(),
            Self::Binary { .. } => Ok(()),
        }
    }

    fn number(&mut self, scalar: Scalar, property: &Property) -> Result<f64, Error> {
        match self {
            Self::Ascii { line, .. } => line.number(scalar, &property.name),
            Self::Binary {
                rest,
                file_bytes,
                endian,
            } => scalar.take(rest, *endian).ok_or_else(|| Error::Byte {
                byte: *file_bytes,
                what: format!("the file ends here, within {}", quoted(&property.name)),
            }),
        }
    }

    fn length(&mut self, count: Scalar, property: &Property) -> Result<usize, Error> {
        let length = self.number(count, property)?;
        if length < 0.0 {
            return Err(self.wrong(format!("{} has {length} items", quoted(&property.name))));
        }
        Ok(length as usize)
    }

    fn skip(&mut self, property: &Property) -> Result<(), Error> {
        match property.value {
            Value::One(scalar) => {
                self.number(scalar, property)?;
            }
            Value::List { count, item } => {
                for _ in 0..self.length(count, property)? {
                    self.number(item, property)?;
                }
            }
        }
        Ok(())
    }

    /// What is wrong where the body is being read.
    fn wrong(&self, what: String) -> Error {
        match self {
            Self::Ascii { line, .. } => line.wrong(what),
            Self::Binary {
                rest, file_bytes, ..
            } => Error::Byte {
                byte: file_bytes - rest.len(),
                what,
            },
        }
    }
}
