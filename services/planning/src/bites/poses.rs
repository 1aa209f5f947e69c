//! The bites to choose from: jaw poses on a grid over the region, through every portal, and
//! on a finer one around those chosen.
//!
//! The shaft passes the portal, so that the place of the jaw fixes its long axis; the forceps turn
//! about the shaft until the jaw opens towards superior, and the jaw stands in the middle of the
//! height of the tissue that it cuts. A pose that cuts the rim that must be left or takes more than
//! [`MAX_OUTSIDE_MM3`] outside the region is not offered, nor is one that the shaft cannot reach.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use arthro_geometry::{Point3, Vector3};
use rayon::prelude::*;

use super::Access;
use crate::error::Error;
use crate::evaluation::Task;
use crate::jaw::{Bite, Cut};
use crate::tissue::{cut_voxels, throat_weights};

/// The planned place and the directions in which an executed bite may lie off.
pub(super) const DISPLACEMENTS: usize = 9;
/// Distance between two places on the fine grid, mm.
const FINE_MM: f64 = 0.1;
/// Places of the fine grid from one of the coarse grid to the next: all poses are looked at there first.
const COARSE: i32 = 2;
const COARSE_MM: f64 = COARSE as f64 * FINE_MM;
/// The most that one bite may take outside the region, mm3: half a millimetre along one of its edges.
const MAX_OUTSIDE_MM3: f64 = 3.0;
/// The least of the region that makes a bite worth considering, mm3.
const MIN_REGION_MM3: f64 = 0.8;
/// How far over the contour a bite may go where that leaves no more than the rim that must be left, mm.
const OVERCUT_MM: f64 = 0.1;
/// Rows of poses between two reports.
const REPORT_EVERY: usize = 8;

/// A jaw pose and what it would cut.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    pub(super) bite: Bite,
    /// Through which portal the forceps come.
    pub(super) portal: usize,
    /// Place on the fine grid.
    pub(super) cell: [i32; 2],
    /// Voxels that it cuts, ascending.
    pub(super) cut: Vec<u32>,
    /// Voxels in its throat and the share of it that each blocks.
    pub(super) throat: Vec<(u32, f64)>,
    /// Points of the ground's lesion, and a bit for each displacement under which the bite covers them.
    pub(super) lesion: Vec<(u32, u32)>,
}

/// A portal and a place on the fine grid.
pub(super) type Place = (usize, [i32; 2]);

/// All poses of the coarse grid.
pub(super) fn over(
    ground: &Ground<'_>,
    mut watch: impl FnMut(f64) -> Result<(), Error>,
) -> Result<Vec<Pose>, Error> {
    let [low, high] = ground.cells();
    let rows: Vec<i32> = (low[0]..=high[0]).collect();
    let mut poses = Vec::new();
    for (done, rows) in rows.chunks(REPORT_EVERY).enumerate() {
        watch((done * REPORT_EVERY) as f64 / f64::from(high[0] - low[0] + 1))?;
        let places = rows.iter().flat_map(|i| {
            let cells = (low[1]..=high[1]).map(move |j| [i * COARSE, j * COARSE]);
            cells
                .flat_map(|cell| (0..ground.access.portals.len()).map(move |portal| (portal, cell)))
        });
        poses.extend(at(ground, &places.collect::<Vec<_>>()));
    }
    Ok(poses)
}

/// The poses of the fine grid around some places, these included.
pub(super) fn around(ground: &Ground<'_>, places: &[Place]) -> Vec<Pose> {
    let steps = -COARSE..=COARSE;
    let mut near: Vec<Place> = places
        .iter()
        .flat_map(|&(portal, [i, j])| {
            let cells = steps
                .clone()
                .flat_map(move |di| (-COARSE..=COARSE).map(move |dj| [i + di, j + dj]));
            cells.map(move |cell| (portal, cell))
        })
        .collect();
    near.sort_unstable();
    near.dedup();
    at(ground, &near)
}

/// Those of some places that are poses, in their order, whichever thread is done first.
fn at(ground: &Ground<'_>, places: &[Place]) -> Vec<Pose> {
    places
        .par_iter()
        .filter_map(|place| ground.pose(*place))
        .collect()
}

/// What poses are measured on.
pub(super) struct Ground<'a> {
    pub(super) task: &'a Task<'a>,
    access: &'a Access<'a>,
    pub(super) region: &'a [bool],
    /// The line that no bite may cross, point by point: the rim begins there.
    rim: Vec<Point3>,
    /// What must be covered wherever the bites land; empty if nothing needs that care.
    lesion: Vec<Point3>,
}

impl<'a> Ground<'a> {
    pub(super) fn of(task: &'a Task<'a>, region: &'a [bool], access: &'a Access<'a>) -> Self {
        Self {
            task,
            access,
            region,
            rim: rim(task, access.rim_min_mm),
            lesion: match access.placement_error_mm {
                Some(_) => thinned(task),
                None => Vec::new(),
            },
        }
    }

    /// What must be covered wherever the bites land.
    pub(super) fn lesion(&self) -> &[Point3] {
        &self.lesion
    }

    pub(super) fn portals(&self) -> &'a [Point3] {
        self.access.portals
    }

    /// Lowest and highest cell of the coarse grid from which a jaw meets the region.
    fn cells(&self) -> [[i32; 2]; 2] {
        let task = self.task;
        let reach_mm = 0.5 * task.jaw.length_mm.hypot(task.jaw.width_mm);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let inside = task.voxels.centers().iter().zip(self.region);
        for (center, _) in inside.filter(|(_, inside)| **inside) {
            for axis in 0..2 {
                low[axis] = low[axis].min(center[axis] - reach_mm);
                high[axis] = high[axis].max(center[axis] + reach_mm);
            }
        }
        [
            low.map(|value| (value / COARSE_MM).ceil() as i32),
            high.map(|value| (value / COARSE_MM).floor() as i32),
        ]
    }

    fn pose(&self, (portal, cell): Place) -> Option<Pose> {
        let Task { voxels, jaw, .. } = self.task;
        let [x, y] = cell.map(|count| f64::from(count) * FINE_MM);
        let (_, sought) = self.bite(portal, Point3::new(x, y, 0.0))?;
        let height_mm = self.middle_mm(&sought)?;
        let (bite, cut) = self.bite(portal, Point3::new(x, y, height_mm))?;
        let mm3 = |count: usize| count as f64 * voxels.voxel_mm3();
        let inside = cut.iter().filter(|voxel| self.region[**voxel as usize]);
        let inside = inside.count();
        if mm3(inside) < MIN_REGION_MM3
            || mm3(cut.len() - inside) > MAX_OUTSIDE_MM3
            || self.cuts_rim(&bite)
            || !(self.access.allowed)(portal, &bite)
        {
            return None;
        }
        Some(Pose {
            portal,
            cell,
            throat: throat_weights(&bite.throat(jaw), voxels),
            lesion: self.lesion_cut(&bite),
            cut,
            bite,
        })
    }

    fn bite(&self, portal: usize, center: Point3) -> Option<(Bite, Vec<u32>)> {
        let portal = &self.access.portals[portal];
        let bite = Bite::through(portal, center, &Vector3::z(), center)?;
        let cut = cut_voxels(&bite.cut(&self.task.jaw), self.task.voxels);
        Some((bite, cut))
    }

    /// Mean height of voxels; `None` if there are none in the region.
    fn middle_mm(&self, cut: &[u32]) -> Option<f64> {
        cut.iter().find(|voxel| self.region[**voxel as usize])?;
        let heights = cut
            .iter()
            .map(|voxel| self.task.voxels.centers()[*voxel as usize].z);
        Some(heights.sum::<f64>() / cut.len() as f64)
    }

    fn cuts_rim(&self, bite: &Bite) -> bool {
        let cut = bite.cut(&self.task.jaw);
        self.rim.iter().any(|point| cut.contains(point))
    }

    fn lesion_cut(&self, bite: &Bite) -> Vec<(u32, u32)> {
        let error_mm = self.access.placement_error_mm.unwrap_or_default();
        let ways: [Cut; DISPLACEMENTS] = std::array::from_fn(|way| {
            let angle = TAU * way as f64 / (DISPLACEMENTS - 1) as f64;
            let length_mm = if way == 0 { 0.0 } else { error_mm };
            let by = Vector3::new(angle.cos(), angle.sin(), 0.0) * length_mm;
            bite.displaced(&by).cut(&self.task.jaw)
        });
        let hits = (0u32..).zip(&self.lesion).map(|(index, point)| {
            let covering = |(way, cut): (usize, &Cut)| u32::from(cut.contains(point)) << way;
            (index, ways.iter().enumerate().map(covering).sum())
        });
        hits.filter(|(_, ways)| *ways != 0).collect()
    }
}

/// The points of a lesion, of several in one cell of half a voxel the first: so fine a grid tells as
/// much as a finer one.
fn thinned(task: &Task<'_>) -> Vec<Point3> {
    let cell_mm = 0.5 * task.voxels.voxel_mm();
    let mut seen = BTreeSet::new();
    let points = task.lesion.points.iter();
    let new = points.filter(|point| {
        let cell = point.coords.map(|value| (value / cell_mm).floor() as i64);
        seen.insert([cell.x, cell.y, cell.z])
    });
    new.copied().collect()
}

/// Where the rim begins that must be left, on every ray: as wide as asked for, or, where the contour
/// itself leaves no more, hardly outboard of the contour.
fn rim(task: &Task<'_>, rim_min_mm: f64) -> Vec<Point3> {
    let Task {
        crescent, voxels, ..
    } = task;
    let points = crescent.rays().filter_map(|angle_rad| {
        let inner_mm = crescent.rim_mm(angle_rad)? - rim_min_mm;
        let contour_mm = task.band.and_then(|band| band.radius_mm(angle_rad));
        let radius_mm = contour_mm.map_or(inner_mm, |contour| inner_mm.max(contour + OVERCUT_MM));
        let (x, y) = (radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin());
        Some(Point3::new(
            x,
            y,
            voxels.middle_mm(x, y, voxels.voxel_mm())?,
        ))
    });
    points.collect()
}
