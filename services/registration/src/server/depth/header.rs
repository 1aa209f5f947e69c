//! What the header of `DeprojectDepth` announces: read, filled up with defaults, and checked as a whole.

use arthro_geometry::frame::{Base, Camera};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Rigid, Rotation, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::registration::v1 as api;
use tonic::Status;

use crate::depth::count_violations;
use crate::depth::distortion::{Coefficients, Distortion};
use crate::depth::fusion::frames::unit_violation;
use crate::depth::intrinsics::{Intrinsics, Roi};
use crate::depth::lens::Lens;
use crate::depth::noise::StereoNoise;
use crate::depth::options::{DEFAULT_STEEPEST_RAD, Options};
use crate::depth::outliers::OutlierFilter;
use crate::depth::plane::PlaneRemoval;
use crate::error::{Error, Violation};
use crate::input::MAX_COORDINATE_MM;

/// A header that passed its checks.
pub(super) struct Announced {
    pub(super) lens: Lens,
    pub(super) depth_unit_mm: f64,
    /// Frames of each viewpoint.
    pub(super) frames: usize,
    /// Poses of the viewpoints; `None` for one in its own frame.
    pub(super) base_from_camera: Option<Vec<Rigid<Base, Camera>>>,
    pub(super) has_mask: bool,
    pub(super) options: Options,
    pub(super) with_details: bool,
}

/// A quaternion's norm may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-3;

impl Announced {
    /// Every violation at once.
    pub(super) fn read(header: api::DepthHeader) -> Result<Self, Status> {
        let mut violations = Vec::new();
        let image = header.intrinsics.unwrap_or_default();
        let intrinsics = Intrinsics {
            width_px: image.width_px,
            height_px: image.height_px,
            fx_px: image.fx_px,
            fy_px: image.fy_px,
            cx_px: image.cx_px,
            cy_px: image.cy_px,
        };
        let lens = distortion(image.distortion)
            .map_err(|violation| vec![violation])
            .and_then(|distortion| Lens::new(intrinsics, distortion))
            .map_err(|found| violations.extend(found));
        violations.extend(unit_violation(header.depth_unit_mm));
        let frames = header.frame_count.max(1) as usize;
        let views = header.views.len().max(1);
        violations.extend(count_violations(&intrinsics, views, frames));
        let options = options(&header, &mut violations);
        violations.extend(options.violations(&intrinsics));
        let poses: Vec<Rigid<Base, Camera>> = header
            .views
            .iter()
            .enumerate()
            .filter_map(|(index, view)| {
                let field = format!("header.views[{index}].base_from_camera");
                pose(&field, view.base_from_camera, &mut violations)
            })
            .collect();
        let Some(lens) = lens.ok().filter(|_| violations.is_empty()) else {
            return Err(Error::Invalid(violations).into());
        };
        Ok(Self {
            lens,
            depth_unit_mm: header.depth_unit_mm,
            frames,
            base_from_camera: (!poses.is_empty()).then_some(poses),
            has_mask: header.has_mask,
            options,
            with_details: header.with_details,
        })
    }

    /// Pixels of one image.
    pub(super) fn pixels(&self) -> usize {
        self.lens.intrinsics().pixels() as usize
    }

    pub(super) fn depth_bytes(&self) -> usize {
        2 * self.views() * self.frames * self.pixels()
    }

    pub(super) fn mask_bytes(&self) -> usize {
        if self.has_mask {
            self.views() * self.pixels()
        } else {
            0
        }
    }

    fn views(&self) -> usize {
        self.base_from_camera.as_ref().map_or(1, Vec::len)
    }
}

fn distortion(announced: Option<api::Distortion>) -> Result<Distortion, Violation> {
    use api::DistortionModel as Model;
    let Some(announced) = announced else {
        return Ok(Distortion::None);
    };
    let coefficients = Coefficients {
        k1: announced.k1,
        k2: announced.k2,
        p1: announced.p1,
        p2: announced.p2,
        k3: announced.k3,
    };
    match Model::try_from(announced.model) {
        Ok(Model::Unspecified | Model::BrownConrady) => Ok(Distortion::BrownConrady(coefficients)),
        Ok(Model::InverseBrownConrady) => Ok(Distortion::InverseBrownConrady(coefficients)),
        Err(_) => Err(Violation::new(
            "header.intrinsics.distortion.model",
            format!("is {}, must be a known model", announced.model),
        )),
    }
}

fn options(header: &api::DepthHeader, violations: &mut Vec<Violation>) -> Options {
    let known = Options::default();
    let noise = header.noise.unwrap_or_default();
    Options {
        roi: header.roi.map(|roi| Roi {
            column_px: roi.column_px,
            row_px: roi.row_px,
            width_px: roi.width_px,
            height_px: roi.height_px,
        }),
        min_depth_mm: header.min_depth_mm,
        max_depth_mm: or(header.max_depth_mm, known.max_depth_mm),
        steepest_rad: header
            .flying_pixels
            .map(|flying| or(flying.steepest_rad, DEFAULT_STEEPEST_RAD)),
        normal_reach_px: or_count(header.normal_reach_px, known.normal_reach_px),
        noise: StereoNoise {
            baseline_mm: or(noise.baseline_mm, known.noise.baseline_mm),
            subpixel_px: or(noise.subpixel_px, known.noise.subpixel_px),
        },
        voxel_mm: or(header.voxel_mm, known.voxel_mm),
        outliers: header
            .outliers
            .and_then(|filter| outliers(filter, violations)),
        plane: header.plane.map(|plane| PlaneRemoval {
            margin_mm: or(plane.margin_mm, 1.0),
            min_share: or(plane.min_share, 0.3),
            planes: or_count(plane.planes, 1),
            seed: plane.seed,
        }),
    }
}

fn outliers(filter: api::OutlierFilter, violations: &mut Vec<Violation>) -> Option<OutlierFilter> {
    use api::outlier_filter::Method;
    match filter.method {
        Some(Method::Statistical(filter)) => Some(OutlierFilter::Statistical {
            neighbours: or_count(filter.neighbours, 16),
            deviations: or(filter.deviations, 6.0),
        }),
        Some(Method::Radius(filter)) => Some(OutlierFilter::Radius {
            radius_mm: filter.radius_mm,
            neighbours: filter.neighbours,
        }),
        None => {
            violations.push(Violation::new(
                "header.outliers.method",
                "is not set, must be statistical or radius",
            ));
            None
        }
    }
}

fn pose(
    field: &str,
    pose: Option<common::Pose>,
    violations: &mut Vec<Violation>,
) -> Option<Rigid<Base, Camera>> {
    let Some(common::Pose {
        rotation: Some(rotation),
        translation: Some(translation),
    }) = pose
    else {
        violations.push(Violation::new(
            field,
            "must have a rotation and a translation",
        ));
        return None;
    };
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let translation_mm = Vector3::new(translation.x_mm, translation.y_mm, translation.z_mm);
    let norm = quaternion.norm();
    let is_unit = (norm - 1.0).abs() <= UNIT_TOLERANCE;
    if !is_unit {
        violations.push(Violation::new(
            format!("{field}.rotation"),
            format!("has norm {norm}, must be 1 within {UNIT_TOLERANCE}"),
        ));
    }
    let is_near = translation_mm.iter().all(|c| c.abs() <= MAX_COORDINATE_MM);
    if !is_near {
        violations.push(Violation::new(
            format!("{field}.translation"),
            format!(
                "is ({}, {}, {}), must be finite and within {MAX_COORDINATE_MM} mm",
                translation_mm.x, translation_mm.y, translation_mm.z
            ),
        ));
    }
    (is_unit && is_near).then(|| Rigid::new(Rotation::from_quaternion(quaternion), translation_mm))
}

/// 0 stands for what is usual.
fn or(value: f64, usual: f64) -> f64 {
    if value == 0.0 { usual } else { value }
}

fn or_count(value: u32, usual: u32) -> u32 {
    if value == 0 { usual } else { value }
}
