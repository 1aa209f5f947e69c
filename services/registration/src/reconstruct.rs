//! Surfaces out of scans: one label of a label map, or what lies above a threshold, as a watertight mesh in `ct`.
//!
//! `surface_nets` lays a net between the voxels inside and those outside, `pieces` drops specks, `smooth` takes
//! the steps of the voxels off without moving the net out of its cells or changing its volume, and `decimate` leaves
//! no more triangles than the shape needs. Only the box around the label is visited. Every step keeps the mesh closed
//! and manifold; [`Reconstruction::mesh`] always is.

use arthro_geometry::mesh::NearestOnMesh;
use arthro_geometry::scan::Scan;
use arthro_geometry::{Mesh, Point3};
use rayon::prelude::*;

use self::body::Body;
use self::surface_nets::Net;
use crate::budget::Budget;
use crate::error::{Error, Violation};

mod body;
mod decimate;
mod pieces;
mod sample;
mod smooth;
mod surface_nets;
mod volume;

pub use decimate::Decimation;
pub use sample::sample;
pub use surface_nets::MAX_QUADS;

/// What of a scan is inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inside {
    /// The voxels with this label; not 0, the background.
    Label(i64),
    /// The voxels with at least this value; the surface runs where the value is interpolated to be just that.
    Threshold(f64),
}

/// How a surface is reconstructed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// What is inside.
    pub inside: Inside,
    /// Pieces and cavities smaller than this share of the largest piece are dropped, 0 to 1: 0 keeps all, 1 the
    /// outside of the largest.
    pub min_piece_share: f64,
    /// Passes of smoothing; `None` is [`LABEL_PASSES`] for a label and none for a threshold, whose surface is
    /// smooth already.
    pub smoothing_passes: Option<u32>,
    /// How far the mesh is simplified.
    pub decimation: Decimation,
}

/// What is smaller is a speck.
pub const MIN_PIECE_SHARE: f64 = 0.01;
/// Passes of smoothing that take the steps of a label's voxels off.
pub const LABEL_PASSES: u32 = 40;
/// Most passes of smoothing.
pub const MAX_PASSES: u32 = 1000;

/// Distances measured between two looks at the cancellation.
const POINTS_BETWEEN_CHECKS: usize = 4096;

/// A surface and what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// Watertight, facing outwards, `ct`, mm.
    pub mesh: Mesh,
    /// Volume that the voxels say it must have, mm3: of the label's voxels in the pieces kept, or inside the
    /// interpolated surface.
    pub voxel_volume_mm3: f64,
    /// Farthest that a vertex of the mesh before simplification is from the mesh, mm.
    pub max_deviation_mm: f64,
    /// How many pieces were dropped as too small.
    pub dropped_pieces: usize,
    /// Whether what is inside reaches the border of the scan; the surface is closed there, along the border.
    pub touches_border: bool,
}

impl Options {
    /// The defaults.
    pub fn new(inside: Inside) -> Self {
        Self {
            inside,
            min_piece_share: MIN_PIECE_SHARE,
            smoothing_passes: None,
            decimation: Decimation::default(),
        }
    }

    /// What is wrong with the options whatever the scan.
    pub fn violations(&self) -> Vec<Violation> {
        let mut violations = Vec::new();
        match self.inside {
            Inside::Label(0) => violations.push(Violation::new(
                "label",
                "is 0, the background; must be another label",
            )),
            Inside::Threshold(value) if !value.is_finite() => violations.push(Violation::new(
                "threshold",
                format!("is {value}, must be finite"),
            )),
            _ => {}
        }
        if let Some(passes) = self.smoothing_passes.filter(|passes| *passes > MAX_PASSES) {
            violations.push(Violation::new(
                "smoothing_passes",
                format!("is {passes}, must be at most {MAX_PASSES}"),
            ));
        }
        if !(0.0..=1.0).contains(&self.min_piece_share) {
            violations.push(Violation::new(
                "min_piece_share",
                format!("is {}, must be 0 to 1", self.min_piece_share),
            ));
        }
        violations.extend(self.decimation.violation());
        violations
    }

    fn passes(&self) -> u32 {
        self.smoothing_passes.unwrap_or(match self.inside {
            Inside::Label(_) => LABEL_PASSES,
            Inside::Threshold(_) => 0,
        })
    }
}

/// Reconstructs the surface of what is inside.
///
/// # Errors
/// [`Error::Invalid`] with everything that is wrong with the options, or with what the scan lacks: no voxel with the
/// label (those there are stand in the message), a threshold outside the values, more surface than [`MAX_QUADS`].
/// [`Error::Cancelled`] if asked to stop.
pub fn reconstruct(
    scan: &Scan,
    options: &Options,
    budget: &Budget,
) -> Result<Reconstruction, Error> {
    let violations = options.violations();
    if !violations.is_empty() {
        return Err(Error::Invalid(violations));
    }
    let (mut net, body) = enclose(scan, options.inside, budget)?;
    let dropped_pieces = pieces::drop_small(&mut net, options.min_piece_share);
    let lattice = scan.lattice();
    let voxel_volume_mm3 = net.volume_mm3(lattice, options.inside);
    let passes = options.passes();
    smooth::relax(&mut net, passes, budget)?;
    let mut full = net.mesh(lattice);
    if passes > 0 {
        volume::restore_within_cells(&mut full, voxel_volume_mm3, &net, lattice);
    }
    let mut mesh = decimate::decimate(&full, options.decimation, lattice, budget)?;
    if mesh.triangles.len() < full.triangles.len() {
        volume::restore(&mut mesh, full.volume_mm3(), lattice);
    }
    Ok(Reconstruction {
        max_deviation_mm: deviation_mm(&full.vertices, &mesh, budget)?,
        mesh,
        voxel_volume_mm3,
        dropped_pieces,
        touches_border: body.touches_border,
    })
}

/// The net around what is inside, or why there is none.
fn enclose(scan: &Scan, inside: Inside, budget: &Budget) -> Result<(Net, Body), Error> {
    if let Inside::Threshold(threshold) = inside {
        body::check_threshold(scan, threshold)?;
    }
    surface_nets::net(scan, inside, budget)?
        .ok_or_else(|| Error::Invalid(vec![body::nothing_inside(scan, inside)]))
}

/// Farthest of `points` from the surface of `mesh`, mm.
fn deviation_mm(points: &[Point3], mesh: &Mesh, budget: &Budget) -> Result<f64, Error> {
    let surface = NearestOnMesh::new(mesh);
    points
        .par_chunks(POINTS_BETWEEN_CHECKS)
        .map(|points| {
            budget.check()?;
            let distances = points.iter().map(|point| surface.distance_mm(point));
            Ok(distances.fold(0.0, f64::max))
        })
        .try_reduce(|| 0.0, |one, other| Ok(one.max(other)))
}
