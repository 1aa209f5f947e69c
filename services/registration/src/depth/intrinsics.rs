//! The pinhole part of a camera, and the part of its image that is looked at.
//!
//! Pixel (column, row) = (0, 0) is the middle of the upper left pixel, as in OpenCV and librealsense. A normalized
//! coordinate is a pixel taken back through focal length and principal point: without distortion it is (x / z, y / z)
//! of what the pixel sees.

use arthro_geometry::nalgebra::Vector2;

use crate::error::Violation;

/// Most pixels of an image.
pub const MAX_PIXELS: u64 = 4_000_000;

/// Focal lengths, principal point and size of an image.
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

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Roi {
    /// First column.
    pub column_px: u32,
    /// First row.
    pub row_px: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

impl Intrinsics {
    /// Pixels of an image.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width_px) * u64::from(self.height_px)
    }

    /// The normalized coordinate of a pixel.
    pub fn normalized(&self, [column, row]: [f64; 2]) -> Vector2<f64> {
        Vector2::new(
            (column - self.cx_px) / self.fx_px,
            (row - self.cy_px) / self.fy_px,
        )
    }

    /// The pixel, column and row, of a normalized coordinate.
    pub fn pixel(&self, normalized: &Vector2<f64>) -> [f64; 2] {
        [
            normalized.x * self.fx_px + self.cx_px,
            normalized.y * self.fy_px + self.cy_px,
        ]
    }

    /// The rectangle of the whole image.
    pub fn image(&self) -> Roi {
        Roi {
            column_px: 0,
            row_px: 0,
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }

    /// What is wrong with the intrinsics.
    pub fn violations(&self) -> Vec<Violation> {
        let mut violations = Vec::new();
        if self.pixels() == 0 || self.pixels() > MAX_PIXELS {
            violations.push(Violation::new(
                "header.intrinsics",
                format!(
                    "is {} x {} px, must have 1 to {MAX_PIXELS} pixels",
                    self.width_px, self.height_px
                ),
            ));
        }
        for (field, value) in [("fx_px", self.fx_px), ("fy_px", self.fy_px)] {
            if !(value > 0.0 && value.is_finite()) {
                violations.push(Violation::new(
                    format!("header.intrinsics.{field}"),
                    format!("is {value}, must be finite and greater than 0"),
                ));
            }
        }
        for (field, value) in [("cx_px", self.cx_px), ("cy_px", self.cy_px)] {
            if !value.is_finite() {
                violations.push(Violation::new(
                    format!("header.intrinsics.{field}"),
                    format!("is {value}, must be finite"),
                ));
            }
        }
        violations
    }
}

impl Roi {
    /// What is wrong with the rectangle in an image of `intrinsics`.
    pub fn violations(&self, intrinsics: &Intrinsics) -> Vec<Violation> {
        let sides = [
            ("column", self.column_px, self.width_px, intrinsics.width_px),
            ("row", self.row_px, self.height_px, intrinsics.height_px),
        ];
        let mut violations = Vec::new();
        for (side, first, count, image) in sides {
            let end = u64::from(first) + u64::from(count);
            if count == 0 {
                violations.push(Violation::new(
                    "header.roi",
                    format!("has no {side}, must have at least 1"),
                ));
            } else if end > u64::from(image) {
                violations.push(Violation::new(
                    "header.roi",
                    format!(
                        "reaches {side} {}, the last of the image is {}",
                        end - 1,
                        i64::from(image) - 1
                    ),
                ));
            }
        }
        violations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics {
        width_px: 640,
        height_px: 480,
        fx_px: 600.0,
        fy_px: 610.0,
        cx_px: 319.5,
        cy_px: 239.5,
    };

    #[test]
    fn a_rectangle_within_the_image_passes_and_one_beyond_it_is_named() {
        let inside = Roi {
            column_px: 600,
            row_px: 0,
            width_px: 40,
            height_px: 480,
        };
        assert!(inside.violations(&CAMERA).is_empty());
        assert!(CAMERA.image().violations(&CAMERA).is_empty());
        let outside = Roi {
            column_px: 601,
            row_px: u32::MAX,
            width_px: 40,
            height_px: u32::MAX,
        };
        let said: Vec<String> = outside
            .violations(&CAMERA)
            .into_iter()
            .map(|violation| violation.description)
            .collect();
        assert_eq!(
            said,
            [
                "reaches column 640, the last of the image is 639",
                "reaches row 8589934589, the last of the image is 479"
            ]
        );
        let empty = Roi {
            width_px: 0,
            ..inside
        };
        assert_eq!(
            empty.violations(&CAMERA)[0].description,
            "has no column, must have at least 1"
        );
    }

    #[test]
    fn bad_intrinsics_are_all_named() {
        let camera = Intrinsics {
            width_px: 70_000,
            height_px: 70_000,
            fx_px: 0.0,
            fy_px: f64::INFINITY,
            cx_px: 1.0,
            cy_px: f64::NAN,
        };
        let fields: Vec<String> = camera
            .violations()
            .into_iter()
            .map(|violation| violation.field)
            .collect();
        assert_eq!(
            fields,
            [
                "header.intrinsics",
                "header.intrinsics.fx_px",
                "header.intrinsics.fy_px",
                "header.intrinsics.cy_px"
            ]
        );
    }
}
