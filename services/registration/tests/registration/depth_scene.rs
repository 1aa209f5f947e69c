//! Depth images of things whose shape is known, rendered with lens, noise and rounding by code of its own.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::nalgebra::Vector2;
use arthro_geometry::phantom::Phantom;
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::budget::Budget;
use arthro_registration::depth::distortion::{Coefficients, Distortion};
use arthro_registration::depth::fusion::frames::Frame;
use arthro_registration::depth::intrinsics::Intrinsics;
use arthro_registration::depth::lens::Lens;
use arthro_registration::depth::noise::StereoNoise;
use arthro_registration::depth::options::Options;
use arthro_registration::depth::outliers::OutlierFilter;
use arthro_registration::depth::{Capture, DepthCloud, from_view};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

pub const UNIT_MM: f64 = 0.1;
pub const FOCAL_PX: f64 = 420.0;

pub const INTRINSICS: Intrinsics = Intrinsics {
    width_px: 320,
    height_px: 240,
    fx_px: FOCAL_PX,
    fy_px: FOCAL_PX + 2.0,
    cx_px: 158.0,
    cy_px: 121.0,
};

/// A wide-angle lens's size of distortion.
pub const COEFFICIENTS: Coefficients = Coefficients {
    k1: -0.28,
    k2: 0.09,
    p1: 0.0015,
    p2: -0.002,
    k3: -0.01,
};

pub fn lens(distortion: Distortion) -> Lens {
    Lens::new(INTRINSICS, distortion).unwrap()
}

/// The ray of a pixel by OpenCV's fixed-point iteration, or by the polynomial itself.
pub fn ray(distortion: &Distortion, column: u32, row: u32) -> Vector3 {
    let seen = Vector2::new(
        (f64::from(column) - INTRINSICS.cx_px) / INTRINSICS.fx_px,
        (f64::from(row) - INTRINSICS.cy_px) / INTRINSICS.fy_px,
    );
    let polynomial = |c: &Coefficients, v: &Vector2<f64>| {
        let r2 = v.x * v.x + v.y * v.y;
        let radial = 1.0 + c.k1 * r2 + c.k2 * r2.powi(2) + c.k3 * r2.powi(3);
        let tangential = Vector2::new(
            2.0 * c.p1 * v.x * v.y + c.p2 * (r2 + 2.0 * v.x * v.x),
            2.0 * c.p2 * v.x * v.y + c.p1 * (r2 + 2.0 * v.y * v.y),
        );
        (radial, tangential)
    };
    let straight = match distortion {
        Distortion::None => seen,
        Distortion::InverseBrownConrady(c) => {
            let (radial, tangential) = polynomial(c, &seen);
            seen * radial + tangential
        }
        Distortion::BrownConrady(c) => (0..200).fold(seen, |straight, _| {
            let (radial, tangential) = polynomial(c, &straight);
            (seen - tangential) / radial
        }),
    };
    straight.push(1.0)
}

/// What a ray meets, as its depth in mm; `None` for nothing.
pub type Scene<'a> = &'a dyn Fn(&Vector3) -> Option<f64>;

/// A picture without noise, mm; 0 where nothing is met.
pub fn render(distortion: &Distortion, scene: Scene<'_>) -> Vec<f64> {
    (0..INTRINSICS.height_px)
        .flat_map(|row| (0..INTRINSICS.width_px).map(move |column| (column, row)))
        .map(|(column, row)| scene(&ray(distortion, column, row)).unwrap_or(0.0))
        .collect()
}

/// The picture in depth units with the disparity noise of a D435i.
pub fn noisy(depth_mm: &[f64], seed: u64) -> Vec<u16> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let StereoNoise {
        baseline_mm,
        subpixel_px,
    } = StereoNoise::default();
    depth_mm
        .iter()
        .map(|depth_mm| {
            let noise_px = subpixel_px * gauss(&mut rng);
            if *depth_mm == 0.0 {
                return 0;
            }
            let disparity_px = FOCAL_PX * baseline_mm / depth_mm + noise_px;
            (FOCAL_PX * baseline_mm / disparity_px / UNIT_MM).round() as u16
        })
        .collect()
}

/// The picture in depth units, rounded only.
pub fn rounded(depth_mm: &[f64]) -> Vec<u16> {
    depth_mm
        .iter()
        .map(|depth_mm| (depth_mm / UNIT_MM).round() as u16)
        .collect()
}

/// The plane normal · p = offset.
pub fn plane(normal: Vector3, offset_mm: f64) -> impl Fn(&Vector3) -> Option<f64> {
    move |ray| Some(offset_mm / normal.dot(ray)).filter(|depth| *depth > 0.0)
}

pub fn sphere(middle: Point3, radius_mm: f64) -> impl Fn(&Vector3) -> Option<f64> {
    move |ray| {
        let along = ray.dot(&middle.coords) / ray.norm_squared();
        let aside2 = (ray * along - middle.coords).norm_squared();
        let half = ((radius_mm * radius_mm - aside2) / ray.norm_squared()).sqrt();
        (!half.is_nan()).then_some(along - half)
    }
}

/// The phantom on its plateau (45 mm of radius), 60 mm above a drape, in ct.
pub struct Knee {
    phantom: Phantom,
    pub camera_from_ct: Rigid<Camera, Ct>,
}

pub const PLATEAU_MM: f64 = 45.0;
const DRAPE_MM: f64 = 60.0;

impl Knee {
    /// Seen from 350 mm above, tilted by `tilt_rad` about an axis that `turn_rad` chooses.
    pub fn new(tilt_rad: f64, turn_rad: f64) -> Self {
        let phantom = Phantom::default();
        let looking_down = Rotation::rotation_between(&-Vector3::x(), &Vector3::z()).unwrap();
        let axis = Vector3::new(turn_rad.cos(), turn_rad.sin(), 0.0);
        let rotation = Rotation::new(axis * tilt_rad) * looking_down;
        let translation = Vector3::new(0.0, 0.0, 350.0) - rotation * phantom.center.coords;
        Self {
            phantom,
            camera_from_ct: Rigid::new(rotation, translation),
        }
    }

    /// How far above the plateau a point of the camera's frame is, mm.
    pub fn height_mm(&self, point: &Point3) -> f64 {
        (self.camera_from_ct.inverse() * *point).x - self.phantom.center.x
    }

    /// How far a point is from the axis of the plateau, mm.
    pub fn aside_mm(&self, point: &Point3) -> f64 {
        let from = self.camera_from_ct.inverse() * *point - self.phantom.center;
        from.y.hypot(from.z)
    }

    /// Depth by marching in 120 steps through the layer that the phantom lies in.
    pub fn depth_mm(&self, ray: &Vector3) -> Option<f64> {
        let ct_from_camera = self.camera_from_ct.inverse();
        let (eye, along) = (ct_from_camera.origin(), ct_from_camera.direction(ray));
        let depth_at = |height_mm: f64| (self.phantom.center.x + height_mm - eye.x) / along.x;
        let (top, plateau) = (depth_at(self.phantom.rim_mm + 0.1), depth_at(0.0));
        let aside_mm = |depth: f64| {
            let from = eye + along * depth - self.phantom.center;
            from.y.hypot(from.z)
        };
        let steps = if aside_mm(plateau).min(aside_mm(top)) < 25.0 {
            120
        } else {
            0
        };
        let hit = (0..steps)
            .map(|step| top + (plateau - top) * f64::from(step) / f64::from(steps))
            .find(|depth| self.phantom.contains(&(eye + along * *depth)));
        hit.or(Some(if aside_mm(plateau) <= PLATEAU_MM {
            plateau
        } else {
            depth_at(-DRAPE_MM)
        }))
    }
}

pub const STATISTICAL: OutlierFilter = OutlierFilter::Statistical {
    neighbours: 16,
    deviations: 6.0,
};

/// Frames without a mask.
pub fn capture<'a>(lens: &'a Lens, frames: &'a [Vec<u16>]) -> Capture<'a> {
    Capture {
        frames: frames
            .iter()
            .map(|depth| Frame {
                lens,
                depth_unit_mm: UNIT_MM,
                depth,
            })
            .collect(),
        mask: None,
    }
}

/// The cloud of undistorted frames.
pub fn cloud(frames: &[Vec<u16>], options: &Options) -> DepthCloud<Camera> {
    let lens = lens(Distortion::None);
    from_view(&capture(&lens, frames), options, &Budget::default()).unwrap()
}

/// A standard normal deviate (Box and Muller).
pub fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let (uniform, turn): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - uniform).ln()).sqrt() * (std::f64::consts::TAU * turn).cos()
}
