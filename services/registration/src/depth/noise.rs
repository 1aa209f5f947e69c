//! How far a depth may be off: the noise law of a stereo depth camera.
//!
//! Such a camera measures disparity, d = f B / z, with a noise that is the same everywhere, `subpixel` pixels. Hence
//! sigma_z = z² subpixel / (f B): four times the noise at twice the distance. Beside it a depth is rounded to its unit.
//! The law is that of Intel's D400 cameras (root mean square of a plane fit), where 0.08 px is usual and 0.03 px
//! reached on texture; bias from calibration or from wet, translucent tissue comes on top and no average removes it.

use crate::error::Violation;

/// What the noise of a stereo camera depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StereoNoise {
    /// Distance of the two imagers, mm.
    pub baseline_mm: f64,
    /// Standard deviation of the disparity, pixels of the depth image.
    pub subpixel_px: f64,
}

/// The law for one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation of 1 / z, 1/mm: the same at any depth.
    inverse_sigma: f64,
    /// What a depth is rounded to, mm.
    depth_unit_mm: f64,
}

/// Largest baseline, mm.
pub const MAX_BASELINE_MM: f64 = 10_000.0;
/// Largest disparity noise, pixels.
pub const MAX_SUBPIXEL_PX: f64 = 10.0;

impl Default for StereoNoise {
    /// Intel RealSense D435i.
    fn default() -> Self {
        Self {
            baseline_mm: 50.0,
            subpixel_px: 0.08,
        }
    }
}

impl StereoNoise {
    /// The law for a camera with this focal length along the baseline and depth unit, both greater than 0.
    pub fn of_camera(&self, focal_px: f64, depth_unit_mm: f64) -> DepthNoise {
        DepthNoise {
            inverse_sigma: self.subpixel_px / (focal_px * self.baseline_mm),
            depth_unit_mm,
        }
    }

    /// What is wrong with the parameters.
    pub fn violations(&self) -> Vec<Violation> {
        let limits = [
            ("baseline_mm", self.baseline_mm, MAX_BASELINE_MM),
            ("subpixel_px", self.subpixel_px, MAX_SUBPIXEL_PX),
        ];
        limits
            .into_iter()
            .filter(|(_, value, most)| !(*value > 0.0 && value <= most))
            .map(|(field, value, most)| {
                Violation::new(
                    format!("header.noise.{field}"),
                    format!("is {value}, must be greater than 0 and at most {most}"),
                )
            })
            .collect()
    }
}

impl DepthNoise {
    /// Standard deviation of the mean of `frames` depths around `depth_mm`, mm.
    ///
    /// Noise averages out with the root of the number. Rounding does too where noise of at least half a unit spreads it
    /// over neighbouring values; with less noise every frame is rounded the same way.
    pub fn sigma_mm(&self, depth_mm: f64, frames: u32) -> f64 {
        let law_mm = depth_mm * depth_mm * self.inverse_sigma;
        let rounding_mm = self.depth_unit_mm / 12f64.sqrt();
        let frames = f64::from(frames);
        let rounding_frames = if law_mm >= 0.5 * self.depth_unit_mm {
            frames
        } else {
            1.0
        };
        (law_mm.powi(2) / frames + rounding_mm.powi(2) / rounding_frames).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_defaults_give_the_figures_published_for_the_d435i() {
        let depth = |focal_px: f64, depth_mm: f64| {
            StereoNoise::default()
                .of_camera(focal_px, 1e-6)
                .sigma_mm(depth_mm, 1)
        };
        // 848 x 480 at 90 degrees: 424 px; 1280 x 720: 640 px.
        for (focal_px, depth_mm, sigma_mm) in [
            (424.0, 300.0, 0.34),
            (424.0, 500.0, 0.94),
            (640.0, 400.0, 0.40),
        ] {
            assert!((depth(focal_px, depth_mm) - sigma_mm).abs() < 0.005);
        }
    }

    #[test]
    fn the_law_is_what_a_noisy_and_rounded_disparity_gives() {
        let camera = StereoNoise::default();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // The last two have less noise than half a unit.
        for (depth_mm, unit_mm, frames) in [
            (350.0, 0.1, 1),
            (350.0, 0.1, 10),
            (600.0, 1.0, 4),
            (50.0, 1.0, 1),
            (50.0, 1.0, 16),
        ] {
            let runs = 20_000;
            let mut squares = 0.0;
            for _ in 0..runs {
                let true_mm = depth_mm + unit_mm * rng.random_range(-0.5..0.5);
                let mut sum_mm = 0.0;
                for _ in 0..frames {
                    let noise_px = camera.subpixel_px * gauss(&mut rng);
                    let disparity_px = 700.0 * camera.baseline_mm / true_mm + noise_px;
                    let measured_mm = 700.0 * camera.baseline_mm / disparity_px;
                    sum_mm += (measured_mm / unit_mm).round() * unit_mm;
                }
                squares += (sum_mm / f64::from(frames) - true_mm).powi(2);
            }
            let found_mm = (squares / f64::from(runs)).sqrt();
            let law_mm = camera.of_camera(700.0, unit_mm).sigma_mm(depth_mm, frames);
            assert!(
                (found_mm / law_mm - 1.0).abs() < 0.03,
                "{depth_mm} mm in {unit_mm} mm, {frames} frames: {found_mm} mm, by the law {law_mm} mm"
            );
        }
    }

    /// A standard normal deviate (Box and Muller).
    fn gauss(rng: &mut ChaCha8Rng) -> f64 {
        let (uniform, turn): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - uniform).ln()).sqrt() * (std::f64::consts::TAU * turn).cos()
    }

    #[test]
    fn bad_parameters_are_all_named() {
        let noise = StereoNoise {
            baseline_mm: f64::NAN,
            subpixel_px: 0.0,
        };
        let fields: Vec<String> = noise.violations().into_iter().map(|v| v.field).collect();
        assert_eq!(
            fields,
            ["header.noise.baseline_mm", "header.noise.subpixel_px"]
        );
    }
}
