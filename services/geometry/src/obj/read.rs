//! Reads an OBJ file line by line.

use super::{MAX_TRIANGLES, MAX_VERTICES};
use crate::stated::Statements;
use crate::surface::lines::{Line, Lines};
use crate::surface::scalar::Scalar;
use crate::surface::{self, Error, Kind, Surface, quoted, within};
use crate::{Cloud, Vector3};

/// Most normals a file may have.
pub const MAX_NORMALS: usize = MAX_TRIANGLES;

/// Reads a file as it stands; polygons become fans of triangles.
///
/// # Errors
/// When the file has no vertices, or holds what a [`Surface`] must not.
pub fn read(bytes: &[u8]) -> Result<Surface, Error> {
    let mut reader = Reader::default();
    for mut line in Lines::new(bytes) {
        if let Some(comment) = line.comment('#') {
            if reader.cloud.points.is_empty() {
                reader.statements.read(&comment)?;
            }
            continue;
        }
        match line.word() {
            Some("v") => reader.read_vertex(&mut line)?,
            Some("vn") => reader.read_normal(&mut line)?,
            Some("f") => reader.read_face(&mut line)?,
            _ => {}
        }
    }
    reader.into_surface()
}

/// What has been read so far.
#[derive(Default)]
struct Reader {
    statements: Statements,
    cloud: Cloud,
    normals: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    faces: usize,
    /// Which normal the faces give to each of the vertices that they name.
    normal_of: Vec<Given>,
}

/// Which normal a vertex has.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Given {
    Nothing,
    One(u32),
    /// On an edge where the faces do not agree.
    Several,
}

impl Given {
    fn one(self) -> Option<u32> {
        match self {
            Self::One(normal) => Some(normal),
            Self::Nothing | Self::Several => None,
        }
    }
}

impl Reader {
    fn read_vertex(&mut self, line: &mut Line<'_>) -> Result<(), Error> {
        let vertex = self.cloud.points.len();
        within("v", vertex + 1, MAX_VERTICES)?;
        let fields = ["x", "y", "z"];
        let coordinates = read_vector(line, fields)?;
        // A weight or a colour may follow.
        self.cloud
            .points
            .push(surface::point(vertex, coordinates, fields)?);
        Ok(())
    }

    fn read_normal(&mut self, line: &mut Line<'_>) -> Result<(), Error> {
        within("vn", self.normals.len() + 1, MAX_NORMALS)?;
        self.normals.push(read_vector(line, ["nx", "ny", "nz"])?);
        Ok(())
    }

    fn read_face(&mut self, line: &mut Line<'_>) -> Result<(), Error> {
        let mut corners = Vec::with_capacity(4);
        while let Some(word) = line.word() {
            let mut parts = word.split('/');
            let index = |part: &str| {
                part.parse::<i64>()
                    .map_err(|_| line.wrong(format!("corner {} is no index", quoted(word))))
            };
            let named = index(parts.next().unwrap_or_default())?;
            let vertices = self.cloud.points.len();
            let vertex = resolve(named, vertices).ok_or(Error::IndexOutOfRange {
                face: self.faces,
                index: named,
                vertices,
            })?;
            corners.push(vertex);
            // The texture coordinate in between is not read.
            if let Some(part) = parts.nth(1) {
                let named = index(part)?;
                let normal = resolve(named, self.normals.len()).ok_or_else(|| {
                    line.wrong(format!(
                        "corner {} names normal {named}, the file has {}",
                        quoted(word),
                        self.normals.len()
                    ))
                })?;
                self.give(vertex, normal);
            }
        }
        surface::push_polygon(&mut self.triangles, self.faces, &corners)?;
        self.faces += 1;
        Ok(())
    }

    fn give(&mut self, vertex: u32, normal: u32) {
        let vertex = vertex as usize;
        if vertex >= self.normal_of.len() {
            self.normal_of.resize(vertex + 1, Given::Nothing);
        }
        let given = &mut self.normal_of[vertex];
        *given = match *given {
            Given::Nothing => Given::One(normal),
            Given::One(known) if known == normal => Given::One(known),
            _ => Given::Several,
        };
    }

    fn into_surface(mut self) -> Result<Surface, Error> {
        if self.cloud.points.is_empty() {
            return Err(Error::Missing("vertices"));
        }
        self.cloud.normals = self.vertex_normals()?;
        Ok(Surface {
            kind: Kind::Obj,
            cloud: self.cloud,
            triangles: self.triangles,
            statements: self.statements,
            viewpoint: None,
        })
    }

    /// The normal of each vertex, or none if not each has exactly one.
    fn vertex_normals(&self) -> Result<Vec<Vector3>, Error> {
        let vertices = self.cloud.points.len();
        let one_each: Option<Vec<u32>> = if self.normal_of.is_empty() {
            (self.normals.len() == vertices).then(|| (0..vertices as u32).collect())
        } else if self.normal_of.len() == vertices {
            self.normal_of.iter().map(|given| given.one()).collect()
        } else {
            None
        };
        let one_each = one_each.unwrap_or_default();
        one_each
            .into_iter()
            .enumerate()
            .map(|(vertex, normal)| {
                let components = self.normals[normal as usize];
                surface::unit_normal(vertex, components, ["nx", "ny", "nz"])
            })
            .collect()
    }
}

fn read_vector(line: &mut Line<'_>, fields: [&'static str; 3]) -> Result<[f64; 3], Error> {
    let mut vector = [0.0; 3];
    for (value, field) in vector.iter_mut().zip(fields) {
        *value = line.number(Scalar::F64, field)?;
    }
    Ok(vector)
}

/// The element, counted from zero, that `named` means where `before` stand before it: 1 is the first, -1 the last of them.
fn resolve(named: i64, before: usize) -> Option<u32> {
    let index = match named {
        1.. => named - 1,
        0 => return None,
        _ => before as i64 + named,
    };
    u32::try_from(index)
        .ok()
        .filter(|index| (*index as usize) < before)
}
