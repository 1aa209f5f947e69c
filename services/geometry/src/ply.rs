//! PLY surface files (ascii, binary little and big endian) to and from [`Mesh`] and [`Cloud`].
//!
//! Inside the house coordinates are LPS and mm. PLY itself says neither, so a file states them in header
//! comments (`comment space RAS`, `comment unit m`; Slicer's `SPACE=RAS` counts too) or the caller states them
//! for the file. Nobody stating them is an error: a mix-up of LPS and RAS is a half turn that passes every shape check.
//!
//! Read are the vertex properties `x y z` and `nx ny nz` and the face property `vertex_indices` (or `vertex_index`), of
//! whatever number type. Other properties and elements are skipped.

use crate::{Cloud, Mesh};

mod header;
mod read;
mod write;

#[cfg(test)]
mod tests;

pub use crate::stated::{Space, Stated, Unit};
pub use crate::surface::{Error, MAX_TRIANGLES, MAX_VERTICES};
pub use header::Encoding;
pub use read::read;
pub use write::{write_cloud, write_cloud_as, write_mesh, write_mesh_as};

const VERTEX_FIELDS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Whether a file begins as a PLY file does.
pub fn is_ply(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")
}

/// Reads a surface into LPS and mm; polygons become fans of triangles.
pub fn read_mesh(bytes: &[u8], stated: Option<Stated>) -> Result<Mesh, Error> {
    read(bytes)?.into_lps_mm(stated)?.into_mesh()
}

/// Reads the vertices of a file into LPS and mm, with unit normals if they have `nx ny nz`; faces are checked and left out.
pub fn read_cloud(bytes: &[u8], stated: Option<Stated>) -> Result<Cloud, Error> {
    Ok(read(bytes)?.into_lps_mm(stated)?.cloud)
}
