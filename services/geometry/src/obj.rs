//! Wavefront OBJ surface files to and from [`Mesh`] and [`Cloud`].
//!
//! As in [`ply`](crate::ply) the coordinates become LPS and mm, by what comments before the first vertex state
//! (`# space RAS`, `# unit m`, Slicer's `SPACE=RAS`) or the caller does, and a file of which nobody states it is refused.
//!
//! Read are `v`, `vn` and `f`; polygons become fans of triangles, indices may be negative (counted from the last element
//! before the line), a face names only what stands before it, everything else
//! is skipped. A cloud has normals if the file gives each vertex exactly one: by the
//! faces, or by as many `vn` as `v` of which no face speaks.

use crate::stated::Stated;
use crate::{Cloud, Mesh};

mod read;
mod write;

#[cfg(test)]
mod tests;

pub use crate::surface::{Error, MAX_TRIANGLES, MAX_VERTICES};
pub use read::{MAX_NORMALS, read};
pub use write::{write_cloud, write_mesh};

/// Reads a surface into LPS and mm.
///
/// # Errors
/// When the file is refused, or nobody states its space and unit.
pub fn read_mesh(bytes: &[u8], stated: Option<Stated>) -> Result<Mesh, Error> {
    read(bytes)?.into_lps_mm(stated)?.into_mesh()
}

/// Reads the vertices of a file into LPS and mm, with unit normals if each has one.
///
/// # Errors
/// When the file is refused, or nobody states its space and unit.
pub fn read_cloud(bytes: &[u8], stated: Option<Stated>) -> Result<Cloud, Error> {
    Ok(read(bytes)?.into_lps_mm(stated)?.cloud)
}
