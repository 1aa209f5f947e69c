//! The meniscus that is planned on.

use std::path::Path;

use arthro_geometry::stated::Stated;
use arthro_geometry::{Mesh, phantom, surface_file};

use crate::arguments::StatedSpace;
use crate::commands::{read, stated, unreadable};
use crate::exit::Failure;

/// The word for the built-in meniscus.
const PHANTOM: &str = "phantom";

/// A meniscus and whether its place in the knee is known.
#[derive(Clone, Debug)]
pub struct Model {
    /// What people call it.
    pub name: String,
    /// Closed surface in ct, mm.
    pub mesh: Mesh,
    /// Which one it is.
    pub source: Source,
}

/// Which meniscus a model is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The built-in one.
    Phantom,
    /// One from a file.
    Surface,
}

impl Model {
    /// The built-in meniscus.
    pub fn phantom() -> Self {
        Self {
            name: PHANTOM.to_owned(),
            mesh: phantom::mesh(),
            source: Source::Phantom,
        }
    }

    /// Reads a surface, or takes the built-in one.
    pub fn read(path: &Path, given: StatedSpace) -> Result<Self, Failure> {
        if path == Path::new(PHANTOM) {
            return Ok(Self::phantom());
        }
        Self::of_file(path, stated(given))
    }

    /// Reads a surface.
    pub fn of_file(path: &Path, stated: Option<Stated>) -> Result<Self, Failure> {
        let mesh = surface_file::read_mesh(path, &read(path)?, stated)
            .map_err(|error| unreadable(path, &error))?;
        let stem = path.file_stem().unwrap_or(path.as_os_str());
        Ok(Self {
            name: stem.to_string_lossy().into_owned(),
            mesh,
            source: Source::Surface,
        })
    }
}
