//! A camera's lens: which ray a pixel looks along, and which pixel a point falls on. A lens that cannot say it for
//! every pixel of its image is refused.

use arthro_geometry::nalgebra::Vector2;
use arthro_geometry::{Point3, Vector3};

use super::distortion::Distortion;
use super::intrinsics::Intrinsics;
use crate::error::Violation;

/// Intrinsics and distortion that fit together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// Radius, normalized, on whose disc the distortion's polynomial is one-to-one.
    limit: f64,
}

/// Steepest ray, x / z: 87 degrees off the axis.
const MAX_SLOPE: f64 = 20.0;
/// How much wider than the image the disc of the polynomial is looked for, so that no pixel lies on its edge.
const HEADROOM: f64 = 1.1;

impl Lens {
    /// Checks that every pixel of the image has one ray.
    ///
    /// # Errors
    /// Every violation, by field of the API; a distortion that folds within the image names the pixel.
    pub fn new(intrinsics: Intrinsics, distortion: Distortion) -> Result<Self, Vec<Violation>> {
        let mut violations = intrinsics.violations();
        if let Distortion::BrownConrady(coefficients)
        | Distortion::InverseBrownConrady(coefficients) = distortion
        {
            let bad = coefficients
                .named()
                .into_iter()
                .filter(|(_, value)| !value.is_finite());
            violations.extend(bad.map(|(name, value)| {
                Violation::new(
                    format!("header.intrinsics.distortion.{name}"),
                    format!("is {value}, must be finite"),
                )
            }));
        }
        if !violations.is_empty() {
            return Err(violations);
        }
        let (corner, radius) = farthest_corner(&intrinsics);
        // What is no number is in no range.
        if !(..=MAX_SLOPE).contains(&radius) {
            let [column, row] = corner;
            return Err(vec![Violation::new(
                "header.intrinsics",
                format!(
                    "puts pixel ({column}, {row}) at {radius} focal lengths from the axis, must be at most {MAX_SLOPE}"
                ),
            )]);
        }
        // An image of one pixel on the axis needs a disc all the same.
        let asked = radius.max(1e-6);
        let (reached, limit) = match distortion {
            Distortion::None => (f64::INFINITY, f64::INFINITY),
            Distortion::BrownConrady(coefficients) => {
                let extent = coefficients.extent(asked, |e| e.covered >= HEADROOM * asked);
                (extent.covered, extent.radius)
            }
            Distortion::InverseBrownConrady(coefficients) => {
                let extent = coefficients.extent(asked, |e| e.radius >= HEADROOM * asked);
                (extent.radius, extent.radius)
            }
        };
        if reached < asked {
            let [column, row] = corner;
            return Err(vec![Violation::new(
                "header.intrinsics.distortion",
                format!(
                    "does not converge at pixel ({column}, {row}), {radius:.4} focal lengths from the axis: \
                     it is one-to-one only up to {reached:.4}"
                ),
            )]);
        }
        Ok(Self {
            intrinsics,
            distortion,
            limit,
        })
    }

    /// Focal lengths, principal point and size.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// What the lens does beside.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// The ray that the pixel (column, row) looks along, camera frame, 1 along z. Columns and rows may be fractions.
    /// Every pixel of the image has one; `None` only beyond it, where the distortion has no inverse.
    pub fn ray(&self, pixel: [f64; 2]) -> Option<Vector3> {
        let seen = self.intrinsics.normalized(pixel);
        let straight = match &self.distortion {
            Distortion::None => seen,
            Distortion::BrownConrady(coefficients) => coefficients.inverse(&seen, self.limit)?,
            Distortion::InverseBrownConrady(coefficients) => {
                self.within(seen).map(|seen| coefficients.map(&seen))?
            }
        };
        Some(straight.push(1.0))
    }

    /// The pixel (column, row) that a point of the camera frame falls on, which may lie beyond the image. `None` behind
    /// the camera and where the lens has no image.
    pub fn project(&self, point: &Point3) -> Option<[f64; 2]> {
        if point.z <= 0.0 || point.z.is_nan() {
            return None;
        }
        let straight = point.xy().coords / point.z;
        let seen = match &self.distortion {
            Distortion::None => straight,
            Distortion::BrownConrady(coefficients) => self
                .within(straight)
                .map(|straight| coefficients.map(&straight))?,
            Distortion::InverseBrownConrady(coefficients) => {
                coefficients.inverse(&straight, self.limit)?
            }
        };
        Some(self.intrinsics.pixel(&seen))
    }

    fn within(&self, normalized: Vector2<f64>) -> Option<Vector2<f64>> {
        (normalized.norm() <= self.limit).then_some(normalized)
    }
}

/// The pixel farthest from the axis, and its normalized distance.
fn farthest_corner(intrinsics: &Intrinsics) -> ([u32; 2], f64) {
    let (right, bottom) = (intrinsics.width_px - 1, intrinsics.height_px - 1);
    let corners = [[0, 0], [right, 0], [0, bottom], [right, bottom]];
    corners
        .map(|corner| (corner, intrinsics.normalized(corner.map(f64::from)).norm()))
        .into_iter()
        .fold(([0, 0], 0.0), |far, corner| {
            // Not less, so that what is no number is told.
            if corner.1 <= far.1 { far } else { corner }
        })
}

#[cfg(test)]
mod tests {
    use super::super::distortion::Coefficients;
    use super::*;
    use proptest::prelude::*;

    const CAMERA: Intrinsics = Intrinsics {
        width_px: 848,
        height_px: 480,
        fx_px: 424.0,
        fy_px: 423.0,
        cx_px: 421.0,
        cy_px: 243.0,
    };

    fn said(intrinsics: Intrinsics, distortion: Distortion) -> Vec<String> {
        let violations = Lens::new(intrinsics, distortion).err().unwrap_or_default();
        violations
            .into_iter()
            .map(|v| format!("{}: {}", v.field, v.description))
            .collect()
    }

    #[test]
    fn a_distortion_that_folds_within_the_image_is_refused_by_its_pixel() {
        let folding = Coefficients {
            k1: -0.5,
            ..Coefficients::default()
        };
        for distortion in [
            Distortion::BrownConrady(folding),
            Distortion::InverseBrownConrady(folding),
        ] {
            let said = said(CAMERA, distortion);
            assert_eq!(said.len(), 1);
            assert!(
                said[0].starts_with(
                    "header.intrinsics.distortion: does not converge at pixel (847, 0), 1.15"
                ),
                "{said:?}"
            );
        }
        // The same lens before a smaller image is no trouble.
        let narrow = Intrinsics {
            fx_px: 1400.0,
            fy_px: 1400.0,
            ..CAMERA
        };
        assert!(said(narrow, Distortion::BrownConrady(folding)).is_empty());
    }

    #[test]
    fn coefficients_that_are_no_numbers_are_named_beside_everything_else() {
        let broken = Coefficients {
            k2: f64::NAN,
            p1: f64::NEG_INFINITY,
            ..Coefficients::default()
        };
        let camera = Intrinsics {
            fx_px: -1.0,
            ..CAMERA
        };
        assert_eq!(
            said(camera, Distortion::BrownConrady(broken)),
            [
                "header.intrinsics.fx_px: is -1, must be finite and greater than 0",
                "header.intrinsics.distortion.k2: is NaN, must be finite",
                "header.intrinsics.distortion.p1: is -inf, must be finite"
            ]
        );
    }

    #[test]
    fn coefficients_of_any_size_are_told_and_not_tried() {
        let huge = Coefficients {
            k1: f64::MAX,
            k2: -f64::MAX,
            p1: f64::MAX,
            p2: f64::MIN,
            k3: f64::MAX,
        };
        assert!(said(CAMERA, Distortion::BrownConrady(huge))[0].contains("does not converge"));
        let wide = Intrinsics {
            fx_px: 1e-300,
            ..CAMERA
        };
        assert!(said(wide, Distortion::None)[0].contains("focal lengths from the axis"));
    }

    fn distortion() -> impl Strategy<Value = Distortion> {
        (
            -0.8..0.8f64,
            -0.8..0.8f64,
            -0.03..0.03f64,
            -0.03..0.03f64,
            -0.8..0.8f64,
            any::<bool>(),
        )
            .prop_map(|(k1, k2, p1, p2, k3, inverse)| {
                let coefficients = Coefficients { k1, k2, p1, p2, k3 };
                if inverse {
                    Distortion::InverseBrownConrady(coefficients)
                } else {
                    Distortion::BrownConrady(coefficients)
                }
            })
    }

    proptest! {
        #![proptest_config(ProptestConfig { max_global_rejects: 100_000, ..ProptestConfig::with_cases(2000) })]
        #[test]
        fn a_pixel_deprojected_and_projected_is_the_same_pixel(
            distortion in distortion(),
            focal in 300.0..900.0f64,
            column in 0.0..=847.0f64,
            row in 0.0..=479.0f64,
            depth_mm in 50.0..5000.0f64,
        ) {
            let camera = Intrinsics { fx_px: focal, fy_px: focal * 1.01, ..CAMERA };
            let lens = Lens::new(camera, distortion);
            prop_assume!(lens.is_ok());
            let lens = lens.unwrap();
            let ray = lens.ray([column, row]);
            prop_assert!(ray.is_some(), "no ray");
            let back = lens.project(&Point3::from(ray.unwrap() * depth_mm));
            prop_assert!(back.is_some(), "no pixel");
            let [u, v] = back.unwrap();
            prop_assert!((u - column).abs() < 1e-6 && (v - row).abs() < 1e-6, "({u}, {v})");
        }

        #[test]
        fn the_corners_of_an_accepted_image_have_rays(distortion in distortion(), focal in 200.0..900.0f64) {
            let camera = Intrinsics { fx_px: focal, fy_px: focal, ..CAMERA };
            let lens = Lens::new(camera, distortion);
            prop_assume!(lens.is_ok());
            for corner in [[0.0, 0.0], [847.0, 0.0], [0.0, 479.0], [847.0, 479.0]] {
                prop_assert!(lens.as_ref().unwrap().ray(corner).is_some(), "{corner:?}");
            }
        }
    }
}
