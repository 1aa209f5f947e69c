//! The bites to choose from: rows along the path, from an edge of the jaw on the contour inwards.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use arthro_geometry::{Point3, Vector3};

use super::Access;
use crate::contour::Spline;
use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::{Bite, Cut};

/// The planned place and the directions in which an executed bite may lie off.
pub(super) const DISPLACEMENTS: usize = 17;
/// Distance between candidates along the path, mm.
const ALONG_MM: f64 = 0.5;
/// Distance between the rows, mm.
const ROW_MM: f64 = 0.5;
/// How far the outermost row may reach over the contour, mm: only a corner of the jaw meets a contour
/// that runs aslant, and a little over it clears the wedge between two corners.
const OVERCUT_MM: f64 = 1.0;
/// How far over the contour a bite may go where the rim is thin already, mm.
const THIN_RIM_OVERCUT_MM: f64 = 0.6;
/// Candidates between two reports.
const REPORT_EVERY: usize = 64;

/// A bite and what it would cut.
pub(super) struct Candidate {
    pub(super) bite: Bite,
    /// Row from the free edge outwards.
    pub(super) row: i64,
    /// Way along the path, mm.
    pub(super) way_mm: f64,
    /// Voxels of the planned region.
    pub(super) region: Vec<u32>,
    /// Other voxels of tissue.
    pub(super) outside: Vec<u32>,
    /// Voxels of the lesion, and a bit for each displacement under which the bite covers them.
    pub(super) lesion: Vec<(u32, u32)>,
}

/// All candidates along `path` that cut some of the region.
pub(super) fn along(
    task: &Task<'_>,
    path: &Spline,
    access: &Access<'_>,
    region: &[bool],
    mut watch: impl FnMut(f64) -> ControlFlow<()>,
) -> Result<Vec<Candidate>, Error> {
    let untouchable = untouchable(task, access);
    let parameters = path.parameters_every(ALONG_MM);
    let mut candidates = Vec::new();
    for (index, &parameter) in parameters.iter().enumerate() {
        let share = index as f64 / parameters.len() as f64;
        if index % REPORT_EVERY == 0 && watch(share).is_break() {
            return Err(Error::Cancelled);
        }
        let on_contour = path.point(parameter);
        let inward = inward(&path.tangent(parameter), &on_contour);
        let angle_rad = task.crescent.angle_rad(&on_contour);
        let edge_mm = task.crescent.edge_mm(angle_rad).unwrap_or(0.0);
        let depth_mm = on_contour.xy().coords.norm() - edge_mm;
        let rows = ((depth_mm.max(0.0) + OVERCUT_MM) / ROW_MM).floor() as usize;
        for row in 0..=rows {
            let shift_mm = row as f64 * ROW_MM - OVERCUT_MM;
            let Some(bite) = bite(task, access, on_contour, &inward, shift_mm) else {
                continue;
            };
            let (region, outside) = cut_voxels(task, &bite, region);
            let touches = |voxel: &u32| untouchable[*voxel as usize];
            if region.is_empty() || region.iter().chain(&outside).any(touches) {
                continue;
            }
            candidates.push(Candidate {
                row: ((depth_mm - shift_mm) / ROW_MM).round() as i64,
                way_mm: share * path.length_mm(),
                lesion: cut_lesion(task, &bite, access.placement_error_mm),
                bite,
                region,
                outside,
            });
        }
    }
    Ok(candidates)
}

/// At right angles to the path in the plane, towards the centre of the crescent.
fn inward(tangent: &Vector3, point: &Point3) -> Vector3 {
    let across = Vector3::new(-tangent.y, tangent.x, 0.0);
    let sign = -across.dot(&point.coords).signum();
    across
        .try_normalize(1e-9)
        .map_or_else(Vector3::zeros, |across| across * sign)
}

/// The bite whose edge lies `shift_mm` inboard of a point of the contour, in the middle of the tissue
/// that it cuts.
fn bite(
    task: &Task<'_>,
    access: &Access<'_>,
    on_contour: Point3,
    inward: &Vector3,
    shift_mm: f64,
) -> Option<Bite> {
    let at = |center: Point3| Bite::through(&access.portal, center, &Vector3::z(), on_contour);
    let support_mm = at(on_contour)?.cut(&task.jaw).support_mm(inward);
    let mut center = on_contour + inward * (support_mm + shift_mm);
    let cut = at(center)?.cut(&task.jaw);
    let (mut sum_mm, mut count) = (0.0, 0usize);
    for voxel in near(task, &center, &cut) {
        let tissue = &task.voxels.centers()[voxel];
        if cut.contains(tissue) {
            sum_mm += tissue.z;
            count += 1;
        }
    }
    if count == 0 {
        return None;
    }
    center.z = sum_mm / count as f64;
    (access.allowed)(&center).then(|| at(center))?
}

/// Voxels that a cut at `center` may reach.
fn near<'a>(task: &'a Task<'_>, center: &Point3, cut: &Cut) -> impl Iterator<Item = usize> + 'a {
    let reach_mm = cut.reach_mm(task.voxels.reach_mm() + center.z.abs());
    task.voxels.near(center.x, center.y, reach_mm)
}

fn cut_voxels(task: &Task<'_>, bite: &Bite, in_region: &[bool]) -> (Vec<u32>, Vec<u32>) {
    let cut = bite.cut(&task.jaw);
    near(task, &bite.center, &cut)
        .filter(|&voxel| cut.contains(&task.voxels.centers()[voxel]))
        .map(|voxel| voxel as u32)
        .partition(|&voxel| in_region[voxel as usize])
}

fn cut_lesion(task: &Task<'_>, bite: &Bite, error_mm: f64) -> Vec<(u32, u32)> {
    let ways: [Cut; DISPLACEMENTS] = std::array::from_fn(|way| {
        let angle = TAU * way as f64 / (DISPLACEMENTS - 1) as f64;
        let length_mm = if way == 0 { 0.0 } else { error_mm };
        let by = Vector3::new(angle.cos(), angle.sin(), 0.0) * length_mm;
        bite.displaced(&by).cut(&task.jaw)
    });
    let reach_mm = ways[0].reach_mm(task.voxels.reach_mm() + bite.center.z.abs());
    let mut hits = Vec::new();
    let near = task
        .voxels
        .near(bite.center.x, bite.center.y, reach_mm + error_mm);
    for voxel in near.filter(|&voxel| task.lesion.marks[voxel]) {
        let center = &task.voxels.centers()[voxel];
        let covering = |(way, cut): (usize, &Cut)| u32::from(cut.contains(center)) << way;
        let bits = ways.iter().enumerate().map(covering).sum();
        if bits != 0 {
            hits.push((voxel as u32, bits));
        }
    }
    hits
}

/// Voxels of the rim that must be left.
fn untouchable(task: &Task<'_>, access: &Access<'_>) -> Vec<bool> {
    let is_rim = |center: &Point3| {
        let angle_rad = task.crescent.angle_rad(center);
        let radius_mm = center.xy().coords.norm();
        let contour_mm = task.band.and_then(|band| band.radius_mm(angle_rad));
        let left_mm = task
            .crescent
            .rim_mm(angle_rad)
            .map(|rim_mm| rim_mm - radius_mm);
        left_mm.is_none_or(|left_mm| left_mm < access.rim_min_mm)
            && contour_mm.is_none_or(|contour_mm| radius_mm > contour_mm + THIN_RIM_OVERCUT_MM)
    };
    task.voxels.centers().iter().map(is_rim).collect()
}
