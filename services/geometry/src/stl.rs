//! STL surface files (ascii and binary) to and from [`Mesh`].
//!
//! As in [`ply`](crate::ply) the coordinates become LPS and mm, by what the file states or the caller does, and a file of
//! which nobody states it is refused. A binary file states it in its 80-byte header, an ascii file in the name of its
//! solid: `SPACE=RAS UNIT=m` among other words (3D Slicer writes `SPACE=LPS` there).
//!
//! STL repeats every corner. Corners of equal coordinates become one vertex, numbered in the order of the file. The normal
//! of a facet is not read: it follows from the order of the corners.

use crate::stated::Stated;
use crate::{Cloud, Mesh};

mod read;
mod write;

#[cfg(test)]
mod tests;

pub use crate::surface::{Error, MAX_TRIANGLES, MAX_VERTICES};
pub use read::{is_stl, read};
pub use write::{write_mesh, write_mesh_as};

/// Bytes of a binary file before its facets: 80 to say anything in, and how many facets there are.
const HEADER_BYTES: usize = 84;
/// Bytes of a facet: its normal, three corners, and two bytes that mean nothing.
const FACET_BYTES: usize = 50;
/// What a written file states.
const STATEMENT: &str = "SPACE=LPS UNIT=mm";

/// How the numbers of a file are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As words.
    Ascii,
    /// As little-endian float32.
    Binary,
}

/// Reads a surface into LPS and mm.
///
/// # Errors
/// When the file is refused, or nobody states its space and unit.
pub fn read_mesh(bytes: &[u8], stated: Option<Stated>) -> Result<Mesh, Error> {
    read(bytes)?.into_lps_mm(stated)?.into_mesh()
}

/// Reads the vertices of a surface into LPS and mm, each once.
///
/// # Errors
/// When the file is refused, or nobody states its space and unit.
pub fn read_cloud(bytes: &[u8], stated: Option<Stated>) -> Result<Cloud, Error> {
    Ok(read(bytes)?.into_lps_mm(stated)?.cloud)
}
