//! PCD point cloud files of PCL (ascii, binary, binary_compressed) to and from [`Cloud`].
//!
//! As in [`ply`](crate::ply) the coordinates become LPS and mm, by what comments of the header state (`# space RAS`,
//! `# unit m`) or the caller does, and a file of which nobody states it is refused.
//!
//! Read are the fields `x y z` and `normal_x normal_y normal_z`, of whatever number type, and the position of
//! `VIEWPOINT`; other fields are skipped. An organised cloud is read as the list of its points, and a point that is
//! NaN (PCL's "nothing was seen here") is refused like any other that is not finite.
//!
//! Source: "The PCD (Point Cloud Data) file format", version 0.7, of the documentation of PCL.

use crate::Cloud;
use crate::stated::Stated;

mod header;
mod lzf;
mod read;
mod write;

#[cfg(test)]
mod tests;

pub use crate::surface::{Error, MAX_VERTICES};
pub use header::Encoding;
pub use read::{MAX_UNPACKED_BYTES, read};
pub use write::{write_cloud, write_cloud_as};

const FIELDS: [&str; 6] = ["x", "y", "z", "normal_x", "normal_y", "normal_z"];

/// Whether a file begins as a PCD file does: with the comment PCL writes, or with the first entry of the header.
pub fn is_pcd(bytes: &[u8]) -> bool {
    header::begins(bytes)
}

/// Reads a file into LPS and mm, with unit normals if it has them.
///
/// # Errors
/// When the file is refused, or nobody states its space and unit.
pub fn read_cloud(bytes: &[u8], stated: Option<Stated>) -> Result<Cloud, Error> {
    Ok(read(bytes)?.into_lps_mm(stated)?.cloud)
}
