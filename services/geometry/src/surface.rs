//! A surface as its file holds it: what every format is read into before its coordinates have a space and a unit.
//!
//! Here stands what all formats have in common: the limits, the checks of vertices, normals and faces, and the way into
//! LPS and mm.

use crate::stated::{Stated, Statements};
use crate::{Cloud, Mesh, Point3, Vector3};

mod error;
mod kind;
pub(crate) mod lines;
#[cfg(test)]
pub(crate) mod samples;
pub(crate) mod scalar;

pub use error::Error;
pub(crate) use error::quoted;
pub use kind::Kind;

/// Most vertices a file may have.
pub const MAX_VERTICES: usize = 2_000_000;
/// Most triangles a file may have, polygons counted as the triangles they fall into.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// What a file holds, in the coordinates of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The format it was read from.
    pub kind: Kind,
    /// The vertices, at least one, all finite; with unit normals if the file has one for each.
    pub cloud: Cloud,
    /// Indices of vertices that are there; empty if the file holds a cloud.
    pub triangles: Vec<[u32; 3]>,
    /// What the file says of its coordinates.
    pub statements: Statements,
    /// Where the points were seen from, in the coordinates of the points (PCD alone holds it). The origin is also what
    /// PCL writes when it does not know.
    pub viewpoint: Option<Point3>,
}

impl Surface {
    /// Carries the coordinates to LPS and mm, by what the file and the caller state.
    ///
    /// # Errors
    /// When space or unit is stated by nobody, the caller contradicts the file, or a coordinate is too large for mm.
    pub fn into_lps_mm(mut self, stated: Option<Stated>) -> Result<Self, Error> {
        let known = self.statements.and(stated)?;
        let unstated =
            |field, example| Error::Unstated(field, self.kind.header_comment(field, example));
        let stated = Stated {
            space: known.space.ok_or_else(|| unstated("space", "LPS"))?,
            unit: known.unit.ok_or_else(|| unstated("unit", "mm"))?,
        };
        let to_lps_mm = stated.to_lps_mm();
        let axes = to_lps_mm.map(f64::signum);
        for (vertex, position) in self.cloud.points.iter_mut().enumerate() {
            let carried = position.coords.component_mul(&to_lps_mm);
            *position = point(vertex, carried.into(), ["x", "y", "z"])?;
        }
        if let Some(viewpoint) = &mut self.viewpoint {
            viewpoint.coords.component_mul_assign(&to_lps_mm);
        }
        for normal in &mut self.cloud.normals {
            normal.component_mul_assign(&axes);
        }
        self.statements = Statements {
            space: Some(Stated::LPS_MM.space),
            unit: Some(Stated::LPS_MM.unit),
        };
        Ok(self)
    }

    /// The triangles with their vertices.
    ///
    /// # Errors
    /// When the file holds a cloud.
    pub fn into_mesh(self) -> Result<Mesh, Error> {
        if self.triangles.is_empty() {
            return Err(Error::Missing("faces"));
        }
        Ok(Mesh {
            vertices: self.cloud.points,
            triangles: self.triangles,
        })
    }
}

// === what is checked of every vertex and face ===

/// The position of a vertex; `fields` is what the format calls the three coordinates.
pub(crate) fn point(
    vertex: usize,
    coordinates: [f64; 3],
    fields: [&'static str; 3],
) -> Result<Point3, Error> {
    for (value, field) in coordinates.into_iter().zip(fields) {
        if !value.is_finite() {
            return Err(Error::NotFinite {
                vertex,
                field,
                value,
            });
        }
    }
    Ok(Point3::from(coordinates))
}

/// The normal of a vertex, made unit; `fields` is what the format calls its three components.
pub(crate) fn unit_normal(
    vertex: usize,
    components: [f64; 3],
    fields: [&'static str; 3],
) -> Result<Vector3, Error> {
    let normal = point(vertex, components, fields)?.coords;
    let length = normal.norm();
    if length.is_finite() && length > 1e-6 {
        Ok(normal / length)
    } else {
        Err(Error::NoDirection { vertex, length })
    }
}

/// Cuts a polygon into a fan of triangles about its first corner.
pub(crate) fn push_polygon(
    triangles: &mut Vec<[u32; 3]>,
    face: usize,
    corners: &[u32],
) -> Result<(), Error> {
    let [first, rest @ ..] = corners else {
        return Err(Error::TooFewCorners { face, corners: 0 });
    };
    if rest.len() < 2 {
        return Err(Error::TooFewCorners {
            face,
            corners: corners.len(),
        });
    }
    within("triangle", triangles.len() + rest.len() - 1, MAX_TRIANGLES)?;
    triangles.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
    Ok(())
}

/// Refuses more than `limit` of an element.
pub(crate) fn within(element: &str, count: usize, limit: usize) -> Result<(), Error> {
    if count > limit {
        return Err(Error::TooMany {
            element: quoted(element),
            count,
            limit,
        });
    }
    Ok(())
}
