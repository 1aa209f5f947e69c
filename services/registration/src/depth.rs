//! Depth images to clouds: pinhole deprojection in the camera frame, normals towards the camera.

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Cloud, Point3, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Violation};

/// A distortion-free pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Focal length along x, pixels.
    pub fx_px: f64,
    /// Focal length along y, pixels.
    pub fy_px: f64,
    /// Column of the optical axis.
    pub cx_px: f64,
    /// Row of the optical axis.
    pub cy_px: f64,
}

/// Most pixels of an image.
pub const MAX_PIXELS: u64 = 4_000_000;
/// Largest depth unit, mm.
pub const MAX_DEPTH_UNIT_MM: f64 = 10.0;
/// Neighbouring pixels whose depths differ by more than this fraction lie on different surfaces.
const JUMP: f64 = 0.01;
/// Pixels to each side that a normal is fitted to.
const NORMAL_REACH_PX: i64 = 2;

/// What is wrong with a depth image's description.
pub fn violations(intrinsics: &Intrinsics, depth_unit_mm: f64) -> Vec<Violation> {
    let mut violations = Vec::new();
    let pixels = u64::from(intrinsics.width_px) * u64::from(intrinsics.height_px);
    if pixels == 0 || pixels > MAX_PIXELS {
        violations.push(Violation::new(
            "header.intrinsics",
            format!(
                "is {} x {} px, must have 1 to {MAX_PIXELS} pixels",
                intrinsics.width_px, intrinsics.height_px
            ),
        ));
    }
    for (field, value) in [("fx_px", intrinsics.fx_px), ("fy_px", intrinsics.fy_px)] {
        if !(value > 0.0 && value.is_finite()) {
            violations.push(Violation::new(
                format!("header.intrinsics.{field}"),
                format!("is {value}, must be finite and greater than 0"),
            ));
        }
    }
    for (field, value) in [("cx_px", intrinsics.cx_px), ("cy_px", intrinsics.cy_px)] {
        if !value.is_finite() {
            violations.push(Violation::new(
                format!("header.intrinsics.{field}"),
                format!("is {value}, must be finite"),
            ));
        }
    }
    if !(depth_unit_mm > 0.0 && depth_unit_mm <= MAX_DEPTH_UNIT_MM) {
        violations.push(Violation::new(
            "header.depth_unit_mm",
            format!("is {depth_unit_mm}, must be greater than 0 and at most {MAX_DEPTH_UNIT_MM}"),
        ));
    }
    violations
}

/// The points of every pixel that has depth (0 means none) and, if there is a mask, a non-zero mask byte.
///
/// # Errors
/// [`Error::Invalid`] if the description is bad or `depth` or `mask` does not have one value a pixel.
pub fn deproject(
    intrinsics: &Intrinsics,
    depth_unit_mm: f64,
    depth: &[u16],
    mask: Option<&[u8]>,
) -> Result<Cloud, Error> {
    let mut violations = violations(intrinsics, depth_unit_mm);
    let pixels = intrinsics.width_px as usize * intrinsics.height_px as usize;
    for (field, count) in [
        ("depth", Some(depth.len())),
        ("mask", mask.map(<[u8]>::len)),
    ] {
        if let Some(count) = count.filter(|count| *count != pixels) {
            violations.push(Violation::new(
                field,
                format!("has {count} pixels, must have {pixels}"),
            ));
        }
    }
    if !violations.is_empty() {
        return Err(Error::Invalid(violations));
    }
    let image = Image {
        intrinsics,
        depth_unit_mm,
        depth,
        mask,
    };
    let seen: Vec<(Point3, Vector3)> = (0..i64::from(intrinsics.height_px))
        .into_par_iter()
        .flat_map_iter(|row| {
            let image = &image;
            (0..i64::from(intrinsics.width_px)).filter_map(move |column| {
                let point = image.point(column, row)?;
                Some((point, image.normal(column, row, &point)))
            })
        })
        .collect();
    let (points, normals) = seen.into_iter().unzip();
    Ok(Cloud { points, normals })
}

struct Image<'a> {
    intrinsics: &'a Intrinsics,
    depth_unit_mm: f64,
    depth: &'a [u16],
    mask: Option<&'a [u8]>,
}

impl Image<'_> {
    /// The point seen at a pixel, mm; `None` outside the image, without depth, or masked out.
    fn point(&self, column: i64, row: i64) -> Option<Point3> {
        let (width, height) = (
            i64::from(self.intrinsics.width_px),
            i64::from(self.intrinsics.height_px),
        );
        if !(0..width).contains(&column) || !(0..height).contains(&row) {
            return None;
        }
        let pixel = (row * width + column) as usize;
        let depth = self.depth[pixel];
        if depth == 0 || self.mask.is_some_and(|mask| mask[pixel] == 0) {
            return None;
        }
        let z = f64::from(depth) * self.depth_unit_mm;
        Some(Point3::new(
            (column as f64 - self.intrinsics.cx_px) * z / self.intrinsics.fx_px,
            (row as f64 - self.intrinsics.cy_px) * z / self.intrinsics.fy_px,
            z,
        ))
    }

    /// Normal of the plane through the pixels around, towards the camera; the line of sight where they are too few.
    fn normal(&self, column: i64, row: i64, point: &Point3) -> Vector3 {
        let around = -NORMAL_REACH_PX..=NORMAL_REACH_PX;
        let near: Vec<Vector3> = around
            .clone()
            .flat_map(|dy| around.clone().map(move |dx| (column + dx, row + dy)))
            .filter_map(|(column, row)| self.point(column, row))
            .filter(|other| (other.z - point.z).abs() < JUMP * point.z)
            .map(|other| other.coords)
            .collect();
        let towards_camera = -point.coords.normalize();
        if near.len() < 5 {
            return towards_camera;
        }
        let mean = near.iter().sum::<Vector3>() / near.len() as f64;
        let covariance: Matrix3<f64> = near
            .iter()
            .map(|p| p - mean)
            .map(|d| d * d.transpose())
            .sum();
        let eigen = SymmetricEigen::new(covariance);
        let normal: Vector3 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        if normal.dot(&towards_camera) < 0.0 {
            -normal
        } else {
            normal
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics {
        width_px: 40,
        height_px: 30,
        fx_px: 50.0,
        fy_px: 60.0,
        cx_px: 19.5,
        cy_px: 14.5,
    };

    /// Depth in tenths of a millimetre of the plane n . p = 1.
    fn plane_depth(over_distance: Vector3) -> Vec<u16> {
        (0..30)
            .flat_map(|row| (0..40).map(move |column| (f64::from(column), f64::from(row))))
            .map(|(column, row)| {
                let ray = Vector3::new((column - 19.5) / 50.0, (row - 14.5) / 60.0, 1.0);
                (10.0 / over_distance.dot(&ray)).round() as u16
            })
            .collect()
    }

    #[test]
    fn a_tilted_plane_comes_back_with_normals_towards_the_camera() {
        let over_distance = Vector3::new(0.001, -0.0005, 1.0 / 300.0);
        let cloud = deproject(&CAMERA, 0.1, &plane_depth(over_distance), None).unwrap();
        assert_eq!(cloud.points.len(), 1200);
        let expected = -over_distance.normalize();
        for (point, normal) in cloud.points.iter().zip(&cloud.normals) {
            assert!((over_distance.dot(&point.coords) - 1.0).abs() < 1e-3);
            assert!(normal.dot(&expected) > 0.999, "{normal}");
        }
    }

    #[test]
    fn pixels_without_depth_or_masked_out_give_no_points() {
        let mut depth = vec![1000; 1200];
        depth[..100].fill(0);
        let mut mask = vec![255; 1200];
        mask[100..300].fill(0);
        let cloud = deproject(&CAMERA, 0.1, &depth, Some(&mask)).unwrap();
        assert_eq!(cloud.points.len(), 900);
    }

    #[test]
    fn a_bad_image_is_refused_with_every_violation() {
        let camera = Intrinsics {
            fx_px: 0.0,
            cy_px: f64::NAN,
            ..CAMERA
        };
        let error = deproject(&camera, -1.0, &[1; 7], Some(&[1; 1200])).unwrap_err();
        let Error::Invalid(violations) = error else {
            panic!("{error}");
        };
        let fields: Vec<&str> = violations.iter().map(|v| v.field.as_str()).collect();
        assert_eq!(
            fields,
            [
                "header.intrinsics.fx_px",
                "header.intrinsics.cy_px",
                "header.depth_unit_mm",
                "depth"
            ]
        );
    }
}
