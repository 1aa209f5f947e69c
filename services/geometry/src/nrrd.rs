//! NRRD volume files (raw, gzip and text encoding) to [`Scan`].
//!
//! Inside the house coordinates are LPS and mm. A file that names its anatomical space (LPS, RAS or LAS) is in mm
//! unless its `space units` say otherwise, as those spaces are defined by DICOM and NIfTI. A file that names none,
//! with `spacings` alone, needs the caller's word: a mix-up of LPS and RAS is a half turn that passes every shape check.
//! Such a file runs along the axes of the stated space and has the centre of its first voxel at their origin.
//! Format: <https://teem.sourceforge.net/nrrd/format.html>.

use crate::Scan;
use crate::ply::Stated;
use crate::scan;

mod header;
mod placement;
mod values;

#[cfg(test)]
mod tests;

/// Longest header, bytes.
pub const MAX_HEADER_BYTES: usize = 1 << 20;

/// Why an NRRD file was refused.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The first line is not `NRRD0001` to `NRRD0005`.
    #[error("not an NRRD file of version 1 to 5")]
    Magic,
    /// No empty line ends the header.
    #[error("the header does not end within {MAX_HEADER_BYTES} bytes")]
    Endless,
    /// A line is neither a comment, nor a field, nor a key with its value.
    #[error("line {line} of the header is {text:?}, must be `field: description`")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A field stands twice.
    #[error("the header has two fields {0:?}")]
    Twice(&'static str),
    /// A field that the reader needs is absent.
    #[error("the header has no field {0:?}")]
    Missing(&'static str),
    /// A field does not say what it must.
    #[error("{field:?} is {value:?}, must be {limit}")]
    Field {
        /// The field.
        field: &'static str,
        /// What it says.
        value: String,
        /// What it may say.
        limit: &'static str,
    },
    /// Neither the file nor the caller says it.
    #[error("the file does not state its {0}: name it in its header or state it with the file")]
    Unstated(&'static str),
    /// File and caller contradict each other.
    #[error("{field} is {file} in the file and {caller} by the caller")]
    Contradiction {
        /// `space` or `unit`.
        field: &'static str,
        /// What the file says.
        file: String,
        /// What the caller says.
        caller: String,
    },
    /// The voxels are in another file.
    #[error("the voxels are in another file, {0:?}: give that file with the header")]
    Detached(String),
    /// The voxels follow the header, and the caller gave others.
    #[error("the voxels follow the header, there must be no other file")]
    Attached,
    /// More values than are accepted.
    #[error("the file announces {bytes} bytes of voxels, the limit is {limit}")]
    TooMany {
        /// Announced.
        bytes: u128,
        /// Limit.
        limit: usize,
    },
    /// Fewer values than announced.
    #[error("the voxels end before the announced {announced} values")]
    Short {
        /// Announced.
        announced: usize,
    },
    /// More values than announced.
    #[error("the voxels do not end after the announced {announced} values")]
    Long {
        /// Announced.
        announced: usize,
    },
    /// The compressed voxels are damaged.
    #[error("the voxels cannot be read")]
    Damaged(#[source] std::io::Error),
    /// A word of a text file is not a number of the voxels' type.
    #[error("voxel {index} is {text:?}, must be a number of the file's type")]
    Number {
        /// Index of the voxel.
        index: usize,
        /// What stands there.
        text: String,
    },
    /// Lattice or values are not usable.
    #[error(transparent)]
    Scan(#[from] scan::Error),
}

/// Reads a file that holds its voxels.
pub fn read(file: &[u8], stated: Option<Stated>) -> Result<Scan, Error> {
    let (header, voxels) = header::split(file)?;
    match header.get("data file") {
        Some(name) => Err(Error::Detached(name.to_owned())),
        None => scan(&header, voxels, stated),
    }
}

/// Reads a header (`.nhdr`) whose voxels are in another file.
pub fn read_detached(header: &[u8], voxels: &[u8], stated: Option<Stated>) -> Result<Scan, Error> {
    let (header, rest) = header::split(header)?;
    if header.get("data file").is_none() || !rest.is_empty() {
        return Err(Error::Attached);
    }
    scan(&header, voxels, stated)
}

fn scan(header: &header::Header, voxels: &[u8], stated: Option<Stated>) -> Result<Scan, Error> {
    let lattice = placement::lattice(header, stated)?;
    let voxels = values::read(header, lattice.len(), voxels)?;
    Ok(Scan::new(lattice, voxels)?)
}
