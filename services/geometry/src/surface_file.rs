//! Surface files of any known kind: PLY, PCD, STL and OBJ.
//!
//! A file is taken for what its content begins as; only where the content does not say (OBJ has no mark) the ending of its
//! name decides. [`read_cloud`] and [`read_mesh`] give LPS and mm and refuse a file whose space and unit nobody states;
//! [`read_as_it_stands`] leaves the coordinates alone and tells what the file states of them.

use std::path::Path;

use crate::stated::Stated;
use crate::surface::{self, Kind, Surface};
use crate::{Cloud, Mesh, obj, pcd, ply, stl};

/// Why a surface file was not read or written.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Neither content nor name tell what the file is.
    #[error("{name:?} is no known kind of file, known are .ply, .pcd, .stl and .obj")]
    UnknownKind {
        /// Name of the file.
        name: String,
    },
    /// The file is not acceptable as what it is.
    #[error("not an acceptable {kind} file")]
    Refused {
        /// What the file was taken for.
        kind: Kind,
        /// What is wrong with it.
        #[source]
        source: surface::Error,
    },
    /// The kind of file does not hold this kind of surface.
    #[error("{kind} files cannot hold a {what}")]
    CannotHold {
        /// The kind of file.
        kind: Kind,
        /// `mesh` or `cloud`.
        what: &'static str,
    },
}

/// Reads the vertices of a file into LPS and mm, with unit normals if it has one for each.
///
/// # Errors
/// When the kind of the file is not known, the file is refused, or nobody states its space and unit.
pub fn read_cloud(
    name: impl AsRef<Path>,
    bytes: &[u8],
    stated: Option<Stated>,
) -> Result<Cloud, Error> {
    let surface = read_as_it_stands(name, bytes)?;
    let kind = surface.kind;
    let surface = surface.into_lps_mm(stated).map_err(refused(kind))?;
    Ok(surface.cloud)
}

/// Reads a mesh into LPS and mm.
///
/// # Errors
/// When the kind of the file is not known, the file is refused, or nobody states its space and unit.
pub fn read_mesh(
    name: impl AsRef<Path>,
    bytes: &[u8],
    stated: Option<Stated>,
) -> Result<Mesh, Error> {
    let surface = read_as_it_stands(name, bytes)?;
    let kind = surface.kind;
    surface
        .into_lps_mm(stated)
        .and_then(Surface::into_mesh)
        .map_err(refused(kind))
}

/// Reads a file in its own coordinates, whether or not it states their space and unit; what it states comes with them.
/// [`Surface::into_lps_mm`] carries them over later, when it is known what they are.
///
/// # Errors
/// When the kind of the file is not known, or the file is refused.
pub fn read_as_it_stands(name: impl AsRef<Path>, bytes: &[u8]) -> Result<Surface, Error> {
    let name = name.as_ref();
    let kind = kind_of_content(bytes)
        .or_else(|| kind_of_name(name))
        .ok_or_else(|| Error::UnknownKind {
            name: name.display().to_string(),
        })?;
    match kind {
        Kind::Ply => ply::read(bytes),
        Kind::Pcd => pcd::read(bytes),
        Kind::Stl => stl::read(bytes),
        Kind::Obj => obj::read(bytes),
    }
    .map_err(refused(kind))
}

/// A file of the kind that its name ends in, tagged LPS and mm; binary where the kind knows binary.
///
/// # Errors
/// When the ending is not known, or such a file holds no mesh.
pub fn write_mesh(name: impl AsRef<Path>, mesh: &Mesh) -> Result<Vec<u8>, Error> {
    match kind_to_write(name.as_ref())? {
        Kind::Ply => Ok(ply::write_mesh(mesh)),
        Kind::Stl => Ok(stl::write_mesh(mesh)),
        Kind::Obj => Ok(obj::write_mesh(mesh)),
        kind @ Kind::Pcd => Err(Error::CannotHold { kind, what: "mesh" }),
    }
}

/// A file of the kind that its name ends in, tagged LPS and mm; binary where the kind knows binary.
///
/// # Errors
/// When the ending is not known, or such a file holds no cloud.
pub fn write_cloud(name: impl AsRef<Path>, cloud: &Cloud) -> Result<Vec<u8>, Error> {
    match kind_to_write(name.as_ref())? {
        Kind::Ply => Ok(ply::write_cloud(cloud)),
        Kind::Pcd => Ok(pcd::write_cloud(cloud, None)),
        Kind::Obj => Ok(obj::write_cloud(cloud)),
        kind @ Kind::Stl => Err(Error::CannotHold {
            kind,
            what: "cloud",
        }),
    }
}

fn kind_of_content(bytes: &[u8]) -> Option<Kind> {
    if ply::is_ply(bytes) {
        Some(Kind::Ply)
    } else if pcd::is_pcd(bytes) {
        Some(Kind::Pcd)
    } else if stl::is_stl(bytes) {
        Some(Kind::Stl)
    } else {
        None
    }
}

fn kind_of_name(name: &Path) -> Option<Kind> {
    let ending = name.extension()?;
    Kind::ALL
        .into_iter()
        .find(|kind| ending.eq_ignore_ascii_case(kind.extension()))
}

fn kind_to_write(name: &Path) -> Result<Kind, Error> {
    kind_of_name(name).ok_or_else(|| Error::UnknownKind {
        name: name.display().to_string(),
    })
}

fn refused(kind: Kind) -> impl FnOnce(surface::Error) -> Error {
    move |source| Error::Refused { kind, source }
}
