//! Where a meniscus lies in its own model: its superior axis, the side it opens to, and its free edge
//! and rim seen from the middle of the hole.

use std::f64::consts::{PI, TAU};

use arthro_geometry::frame::Ct;
use arthro_geometry::{Mesh, Point3, Rigid, Rotation, Vector3, phantom};
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3 as Column};

use super::KneeFrame;
use crate::voxels::Voxels;

/// A meniscus in polar coordinates about the middle of its hole.
#[derive(Clone, Debug)]
pub struct Crescent {
    /// Origin in the middle of the hole at the height of the inferior surface; x posterior (the
    /// anterior side faces -x), y towards the middle of the body (the crescent opens to -y),
    /// z superior.
    pub ct_from_knee: Rigid<Ct, KneeFrame>,
    /// Height of the superior surface above the inferior one, mm.
    pub height_mm: f64,
    /// The most anterior tissue, mm along the knee's x.
    pub anterior_rim_mm: f64,
    sectors: Vec<Option<Sector>>,
}

/// The tissue along one ray from the middle of the hole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sector {
    /// Angle from the middle of the body, positive towards the anterior side.
    pub phi_rad: f64,
    /// Distance of the free edge from the middle of the hole, mm.
    pub free_edge_mm: f64,
    /// Distance of the rim, mm.
    pub rim_mm: f64,
}

impl Sector {
    /// Radial width of the tissue, mm.
    pub fn width_mm(&self) -> f64 {
        self.rim_mm - self.free_edge_mm
    }
}

/// Why a surface is not taken for a meniscus.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum NotACrescent {
    /// The surface is none, or not of a knee's size.
    #[error("the surface is {size_mm:.1} mm long, a meniscus 10 to 100")]
    Size {
        /// Longest edge of its bounding box.
        size_mm: f64,
    },
    /// The surface encloses next to nothing.
    #[error("the surface encloses {volume_mm3:.1} mm3, a meniscus has 300 to 10000")]
    Volume {
        /// What it encloses.
        volume_mm3: f64,
    },
    /// There is no side it opens to.
    #[error(
        "the widest gap around the hole is {gap_deg:.0} degrees, a crescent opens by 20 to 240"
    )]
    Gap {
        /// Widest gap.
        gap_deg: f64,
    },
}

/// Refuses a surface that is not of a meniscus' size, before any memory is taken for its tissue.
///
/// # Errors
/// Names the size.
pub(super) fn check_size(mesh: &Mesh) -> Result<(), NotACrescent> {
    let size_mm = mesh.bounds().map_or(0.0, |(low, high)| (high - low).amax());
    if (10.0..=100.0).contains(&size_mm) {
        return Ok(());
    }
    Err(NotACrescent::Size { size_mm })
}

/// Rays round the crescent: one every 2 degrees.
const SECTORS: usize = 180;

impl Crescent {
    /// The parametric phantom, whose axes are known.
    pub fn of_phantom(voxels: &Voxels) -> Self {
        let posterior = -phantom::ANTERIOR;
        let axes = [
            posterior,
            phantom::SUPERIOR.cross(&posterior),
            phantom::SUPERIOR,
        ];
        Self::in_axes(voxels, pose(&axes, phantom::Phantom::default().center))
    }

    /// Any meniscus. Superior is the axis along which the tissue is thinnest, its flatter face
    /// below. A surface says nothing about its knee, so the joint around it is a generic one: the
    /// crescent is laid so that it opens to -y, whatever side it was taken from.
    ///
    /// # Errors
    /// When the surface does not look like a crescent.
    pub fn of_mesh(mesh: &Mesh, voxels: &Voxels) -> Result<Self, NotACrescent> {
        let tissue: Vec<Point3> = voxels
            .solid_cells()
            .map(|cell| voxels.center(cell))
            .collect();
        let volume_mm3 = tissue.len() as f64 * voxels.cell_mm3();
        if !(300.0..=10_000.0).contains(&volume_mm3) {
            return Err(NotACrescent::Volume { volume_mm3 });
        }
        let (middle, axis) = thinnest_axis(&tissue);
        let superior = axis * flatter_below(mesh, &middle, &axis);

        // Any direction in the plane serves until the opening is known.
        let across = superior
            .cross(&Vector3::x())
            .try_normalize(0.1)
            .unwrap_or_else(|| superior.cross(&Vector3::y()).normalize());
        let flat = pose(&[across, superior.cross(&across), superior], middle);
        let knee_from_ct = flat.inverse();
        let flat_tissue: Vec<Point3> = tissue.iter().map(|p| knee_from_ct * *p).collect();
        let hole = circle_center(&flat_tissue);
        let body_angle = middle_of_body(&flat_tissue, hole)?;

        let body = flat.direction(&Vector3::new(body_angle.cos(), body_angle.sin(), 0.0));
        let inferior_mm = low_percentile(flat_tissue.iter().map(|p| p.z));
        let origin = flat * Point3::new(hole[0], hole[1], inferior_mm);
        Ok(Self::in_axes(
            voxels,
            pose(&[body.cross(&superior), body, superior], origin),
        ))
    }

    fn in_axes(voxels: &Voxels, ct_from_knee: Rigid<Ct, KneeFrame>) -> Self {
        let knee_from_ct = ct_from_knee.inverse();
        let mut crescent = Self {
            ct_from_knee,
            height_mm: 0.0,
            anterior_rim_mm: 0.0,
            sectors: vec![None; SECTORS],
        };
        for cell in voxels.solid_cells() {
            let at = knee_from_ct * voxels.center(cell);
            crescent.height_mm = crescent.height_mm.max(at.z);
            crescent.anterior_rim_mm = crescent.anterior_rim_mm.min(at.x);
            let (phi_rad, radius_mm) = polar(&at);
            let index = sector_index(phi_rad);
            let sector = crescent.sectors[index].get_or_insert(Sector {
                phi_rad: sector_phi(index),
                free_edge_mm: radius_mm,
                rim_mm: radius_mm,
            });
            sector.free_edge_mm = sector.free_edge_mm.min(radius_mm);
            sector.rim_mm = sector.rim_mm.max(radius_mm);
        }
        crescent
    }

    /// The tissue along the ray at `phi_rad`; `None` where the crescent is open.
    pub fn sector(&self, phi_rad: f64) -> Option<Sector> {
        self.sectors[sector_index(phi_rad)]
    }

    /// All rays that meet tissue.
    pub fn sectors(&self) -> impl Iterator<Item = Sector> + '_ {
        self.sectors.iter().flatten().copied()
    }

    /// The point in ct at an angle, a distance from the middle of the hole, and a height.
    pub fn point(&self, phi_rad: f64, radius_mm: f64, height_mm: f64) -> Point3 {
        self.ct_from_knee
            * Point3::new(
                -radius_mm * phi_rad.sin(),
                radius_mm * phi_rad.cos(),
                height_mm,
            )
    }
}

/// Angle from the body (positive towards anterior, -x) and distance from the axis of the hole, of a
/// point in the knee's frame.
pub fn polar(at: &Point3) -> (f64, f64) {
    ((-at.x).atan2(at.y), at.x.hypot(at.y))
}

fn sector_index(phi_rad: f64) -> usize {
    (((phi_rad + PI) / TAU * SECTORS as f64) as usize).min(SECTORS - 1)
}

fn sector_phi(index: usize) -> f64 {
    (index as f64 + 0.5) / SECTORS as f64 * TAU - PI
}

fn pose(axes: &[Vector3; 3], origin: Point3) -> Rigid<Ct, KneeFrame> {
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(axes));
    Rigid::new(Rotation::from_rotation_matrix(&rotation), origin.coords)
}

fn thinnest_axis(tissue: &[Point3]) -> (Point3, Vector3) {
    let middle = tissue.iter().map(|p| p.coords).sum::<Vector3>() / tissue.len() as f64;
    let spread = tissue
        .iter()
        .map(|p| (p.coords - middle) * (p.coords - middle).transpose())
        .sum::<Matrix3<f64>>();
    let eigen = SymmetricEigen::new(spread);
    let axis = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .normalize();
    (middle.into(), axis)
}

/// +1 when the face that looks along -`axis` is the flatter one, else -1. Flat: its area-weighted
/// normals agree with the axis.
fn flatter_below(mesh: &Mesh, middle: &Point3, axis: &Vector3) -> f64 {
    let outward = mesh.volume_mm3().signum();
    // For each face: area, first and second moment of the height, so that the face that scatters
    // less in height about its own mean is the flatter one.
    let mut faces = [Column::zeros(); 2];
    for index in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(index);
        let area_vector = (b - a).cross(&(c - a)) * (0.5 * outward);
        let area = area_vector.dot(axis);
        let height = ((a.coords + b.coords + c.coords) / 3.0 - middle.coords).dot(axis);
        faces[usize::from(area > 0.0)] += Column::new(1.0, height, height * height) * area.abs();
    }
    let scatter = faces.map(|sums| sums.z / sums.x - (sums.y / sums.x).powi(2));
    if scatter[0] <= scatter[1] { 1.0 } else { -1.0 }
}

/// Centre of the circle through the tissue seen from above, least squares in x2 + y2 = 2ax + 2by + c.
fn circle_center(tissue: &[Point3]) -> [f64; 2] {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for p in tissue {
        let row = Vector3::new(2.0 * p.x, 2.0 * p.y, 1.0);
        normal += row * row.transpose();
        right += row * (p.x * p.x + p.y * p.y);
    }
    // The tissue of a closed surface is never all on one line, so the normal matrix has an inverse.
    let solved = normal.try_inverse().unwrap_or_else(Matrix3::zeros) * right;
    [solved.x, solved.y]
}

/// The angle opposite to the middle of the widest gap in the tissue around `hole`.
fn middle_of_body(tissue: &[Point3], hole: [f64; 2]) -> Result<f64, NotACrescent> {
    let mut angles: Vec<f64> = tissue
        .iter()
        .map(|p| (p.y - hole[1]).atan2(p.x - hole[0]))
        .collect();
    angles.sort_by(f64::total_cmp);
    let wrapped = angles.first().map(|first| first + TAU);
    let (gap, start) = angles
        .iter()
        .zip(angles.iter().skip(1).copied().chain(wrapped))
        .map(|(from, to)| (to - from, *from))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, 0.0));
    if !(20f64.to_radians()..=240f64.to_radians()).contains(&gap) {
        return Err(NotACrescent::Gap {
            gap_deg: gap.to_degrees(),
        });
    }
    Ok(start + 0.5 * gap + PI)
}

/// Height that one cell in a hundred is below: the surface the crescent lies on.
fn low_percentile(heights: impl Iterator<Item = f64>) -> f64 {
    let mut heights: Vec<f64> = heights.collect();
    heights.sort_by(f64::total_cmp);
    heights
        .get(heights.len() / 100)
        .copied()
        .unwrap_or_default()
}
