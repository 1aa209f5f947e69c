//! Depth images to clouds: a camera's frames of one scene, from one viewpoint or several, become points with normals
//! and the uncertainty of both.
//!
//! The way of the data: frames are averaged ([`fusion::frames`]), what is selected of the mean is deprojected through
//! the lens ([`deproject`]), several viewpoints are brought together ([`fusion::views`]), then strays ([`outliers`])
//! and what the thing lies on ([`plane`]) are taken away.

pub mod deproject;
pub mod distortion;
pub mod fusion;
pub mod intrinsics;
pub mod lens;
pub mod noise;
pub mod options;
pub mod outliers;
pub mod plane;

use arthro_geometry::frame::{Camera, Frame as CellFrame};
use arthro_geometry::{Cloud, Point3, Rigid};

use self::deproject::{Dropped, SeenPoint, Selection};
use self::fusion::frames::{Frame, average, count_violation};
use self::fusion::views;
use self::intrinsics::{Intrinsics, MAX_PIXELS};
use self::options::Options;
use self::plane::RemovedPlane;
use crate::budget::Budget;
use crate::error::{Error, Violation};

/// What a camera that stood still took.
#[derive(Clone, Debug)]
pub struct Capture<'a> {
    /// Its frames.
    pub frames: Vec<Frame<'a>>,
    /// One byte a pixel, non-zero where it is looked at; `None` looks everywhere.
    pub mask: Option<&'a [u8]>,
}

/// A capture and where its camera stood.
#[derive(Clone, Debug)]
pub struct View<'a, F: CellFrame> {
    /// The camera's pose.
    pub f_from_camera: Rigid<F, Camera>,
    /// What it took.
    pub capture: Capture<'a>,
}

/// Points of one frame of the cell, as depth cameras saw them.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthCloud<F: CellFrame> {
    /// The points.
    pub points: Vec<SeenPoint>,
    /// Where each viewpoint is, mm; a point's `view` is an index into it.
    pub viewpoints: Vec<Point3>,
    /// What became of everything else.
    pub report: Report,
    frame: std::marker::PhantomData<F>,
}

/// What was left out on the way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Depths left out of the average as outlying, of each frame, viewpoint after viewpoint.
    pub clipped: Vec<usize>,
    /// Pixels looked at that gave no point.
    pub dropped: Dropped,
    /// The strays that were taken away.
    pub strays: Vec<SeenPoint>,
    /// The planes that were taken away, in this order.
    pub planes: Vec<RemovedPlane>,
}

/// Most viewpoints.
pub const MAX_VIEWS: usize = 64;
/// Most depth values of all frames of all viewpoints.
pub const MAX_DEPTHS: u64 = 32_000_000;

/// The cloud of one viewpoint, in its camera's frame: one point a pixel, row by row.
///
/// # Errors
/// [`Error::Invalid`] with every violation of options, frames and mask, or if a plane is asked for that is not there;
/// [`Error::Cancelled`] if `budget` is raised meanwhile.
pub fn from_view(
    capture: &Capture<'_>,
    options: &Options,
    budget: &Budget,
) -> Result<DepthCloud<Camera>, Error> {
    check([("mask".to_owned(), capture)], options)?;
    let mut report = Report::default();
    let points = look(capture, options, 0, &mut report)?;
    budget.check()?;
    finish(points, vec![Point3::origin()], report, options, budget)
}

/// The cloud of several viewpoints in the frame that their poses lead to, one point for all that lie in one cell on one
/// side of a surface.
///
/// # Errors
/// As [`from_view`], and without any view.
pub fn from_views<F: CellFrame>(
    views: &[View<'_, F>],
    options: &Options,
    budget: &Budget,
) -> Result<DepthCloud<F>, Error> {
    let captures = views
        .iter()
        .enumerate()
        .map(|(index, view)| (format!("mask[{index}]"), &view.capture));
    check(captures, options)?;
    let mut report = Report::default();
    let mut points = Vec::new();
    for (index, view) in views.iter().enumerate() {
        budget.check()?;
        let seen = look(&view.capture, options, index as u32, &mut report)?;
        points.extend(views::moved(&view.f_from_camera, &seen));
    }
    budget.check()?;
    let merged = views::merged(&points, options.voxel_mm);
    drop(points);
    let viewpoints = views.iter().map(|view| view.f_from_camera.origin());
    finish(merged, viewpoints.collect(), report, options, budget)
}

/// The points of one viewpoint in its camera's frame.
fn look(
    capture: &Capture<'_>,
    options: &Options,
    view: u32,
    report: &mut Report,
) -> Result<Vec<SeenPoint>, Error> {
    let averaged = average(&capture.frames, &options.noise)?;
    report.clipped.extend(&averaged.clipped);
    let first = &capture.frames[0];
    let intrinsics = first.lens.intrinsics();
    let noise = options
        .noise
        .of_camera(intrinsics.fx_px, first.depth_unit_mm);
    let selection = Selection {
        roi: options.roi.unwrap_or_else(|| intrinsics.image()),
        mask: capture.mask,
        range_mm: [options.min_depth_mm, options.max_depth_mm],
        steepest_rad: options.steepest_rad,
        normal_reach_px: options.normal_reach_px,
    };
    let seen = deproject::deproject(first.lens, &averaged, &noise, &selection, view)?;
    report.dropped += seen.dropped;
    Ok(seen.points)
}

/// Takes away strays and planes.
fn finish<F: CellFrame>(
    mut points: Vec<SeenPoint>,
    viewpoints: Vec<Point3>,
    mut report: Report,
    options: &Options,
    budget: &Budget,
) -> Result<DepthCloud<F>, Error> {
    if let Some(filter) = &options.outliers {
        let positions: Vec<Point3> = points.iter().map(|point| point.position).collect();
        let strays = filter.strays(&positions, budget)?;
        report.strays = take(&mut points, &strays.indices);
    }
    if let Some(removal) = &options.plane {
        for number in 0..removal.planes {
            budget.check()?;
            match removal.largest(&points, &viewpoints) {
                Ok((plane, indices)) => {
                    take(&mut points, &indices);
                    report.planes.push(plane);
                }
                Err(refusal) if number == 0 => return Err(refusal),
                Err(_) => break,
            }
        }
    }
    Ok(DepthCloud {
        points,
        viewpoints,
        report,
        frame: std::marker::PhantomData,
    })
}

/// Moves the points of the ascending `indices` out of `points`.
fn take(points: &mut Vec<SeenPoint>, indices: &[usize]) -> Vec<SeenPoint> {
    let taken = indices.iter().map(|index| points[*index]).collect();
    let (mut index, mut next) = (0, indices.iter().peekable());
    points.retain(|_| {
        let goes = next.next_if_eq(&&index).is_some();
        index += 1;
        !goes
    });
    taken
}

impl<F: CellFrame> DepthCloud<F> {
    /// Positions and normals alone.
    pub fn cloud(&self) -> Cloud {
        Cloud {
            points: self.points.iter().map(|point| point.position).collect(),
            normals: self.points.iter().map(|point| point.normal).collect(),
        }
    }
}

/// What is wrong with the number of viewpoints and frames of an image.
pub fn count_violations(intrinsics: &Intrinsics, views: usize, frames: usize) -> Vec<Violation> {
    let mut violations: Vec<Violation> = count_violation(frames).into_iter().collect();
    if views == 0 || views > MAX_VIEWS {
        violations.push(Violation::new(
            "header.views",
            format!("has {views}, must have 1 to {MAX_VIEWS}"),
        ));
    }
    let pixels = intrinsics.pixels().saturating_mul(views as u64);
    if views > 1 && pixels > MAX_PIXELS {
        violations.push(Violation::new(
            "header.views",
            format!("have {pixels} pixels together, must have at most {MAX_PIXELS}"),
        ));
    }
    let depths = pixels.saturating_mul(frames as u64);
    if depths > MAX_DEPTHS {
        violations.push(Violation::new(
            "header.frame_count",
            format!("makes {depths} depth values, must make at most {MAX_DEPTHS}"),
        ));
    }
    violations
}

/// Everything that can be told before any work.
fn check<'a>(
    captures: impl IntoIterator<Item = (String, &'a Capture<'a>)>,
    options: &Options,
) -> Result<(), Error> {
    let mut violations = Vec::new();
    let mut views = 0;
    for (mask_field, capture) in captures {
        views += 1;
        violations.extend(fusion::frames::violations(&capture.frames));
        let Some(first) = capture.frames.first() else {
            continue;
        };
        let intrinsics = first.lens.intrinsics();
        if let Some(mask) = capture
            .mask
            .filter(|m| m.len() as u64 != intrinsics.pixels())
        {
            violations.push(Violation::new(
                mask_field,
                format!(
                    "has {} pixels, must have {}",
                    mask.len(),
                    intrinsics.pixels()
                ),
            ));
        }
        violations.extend(options.violations(intrinsics));
    }
    if views == 0 {
        violations.push(Violation::new(
            "header.views",
            "has 0, must have at least 1",
        ));
    }
    violations.dedup();
    if violations.is_empty() {
        Ok(())
    } else {
        Err(Error::Invalid(violations))
    }
}
