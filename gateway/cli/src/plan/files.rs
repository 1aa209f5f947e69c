//! The files a plan is made from.

use std::path::Path;

use arthro_geometry::stated::Stated;
use arthro_geometry::{Mesh, Point3, phantom, surface_file};

use crate::arguments::StatedSpace;
use crate::bites_file::{MAX_CONTOUR, MAX_LESION};
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

/// Reads the points of damaged tissue.
pub fn read_lesion(path: &Path, given: StatedSpace) -> Result<Vec<Point3>, Failure> {
    points(path, given, MAX_LESION)
}

/// Reads the points of a contour in their order.
pub fn read_contour(path: &Path, given: StatedSpace) -> Result<Vec<Point3>, Failure> {
    points(path, given, MAX_CONTOUR)
}

fn points(path: &Path, given: StatedSpace, limit: usize) -> Result<Vec<Point3>, Failure> {
    let cloud = surface_file::read_cloud(path, &read(path)?, stated(given))
        .map_err(|error| unreadable(path, &error))?;
    let count = cloud.points.len();
    if count > limit {
        let problem = format!(
            "{}: has {count} points; must be at most {limit}",
            path.display()
        );
        return Err(Failure::refused("FILE_INVALID", problem));
    }
    Ok(cloud.points)
}
