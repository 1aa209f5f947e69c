//! A cell whose mountings are known: an arm, a camera, a board, and the noise of both.

use arthro_geometry::frame::{Base, Board, Camera, Flange, Frame};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use arthro_registration::calibration::board::{self, Corner, Lens};
use arthro_registration::calibration::hand_eye::Station;
use arthro_registration::calibration::noise::PoseNoise;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// The camera of the reference figures: f = 910 px, 1280 x 720.
pub const LENS: Lens = Lens {
    focal_px: [910.0, 910.0],
    center_px: [639.5, 359.5],
};

/// 54 corners, 15 mm apart.
pub fn corners_mm() -> impl Iterator<Item = [f64; 2]> {
    (0..54).map(|index| [f64::from(index % 9) * 15.0, f64::from(index / 9) * 15.0])
}

/// Middle of the board.
const MIDDLE_MM: [f64; 3] = [60.0, 37.5, 0.0];

/// Random numbers of one seed.
pub struct Dice(ChaCha8Rng);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..=high)
    }

    /// Deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (uniform, turn): (f64, f64) = (self.0.random(), self.0.random());
        (-2.0 * (1.0 - uniform).ln()).sqrt() * (std::f64::consts::TAU * turn).cos()
    }

    pub fn normals(&mut self, deviation: f64) -> Vector3 {
        Vector3::from_fn(|_, _| self.normal()) * deviation
    }

    pub fn direction(&mut self) -> Vector3 {
        self.normals(1.0).normalize()
    }

    /// Any pose, its origin within `reach_mm` of the other.
    pub fn pose<A: Frame, B: Frame>(&mut self, reach_mm: f64) -> Rigid<A, B> {
        let turn = self.direction() * self.within(0.0, std::f64::consts::PI);
        let shift = self.direction() * self.within(0.0, reach_mm);
        Rigid::new(Rotation::from_scaled_axis(turn), shift)
    }

    /// A measurement of a pose.
    pub fn measured<A: Frame, B: Frame>(
        &mut self,
        pose: &Rigid<A, B>,
        noise: PoseNoise,
    ) -> Rigid<A, B> {
        let turn = Rotation::from_scaled_axis(self.normals(noise.rotation_rad));
        let shift = self.normals(noise.translation_mm);
        Rigid::new(turn * pose.rotation(), pose.translation_mm() + shift)
    }
}

/// Noise in the units that people state it in.
pub fn noise(translation_mm: f64, rotation_deg: f64) -> PoseNoise {
    PoseNoise {
        rotation_rad: rotation_deg.to_radians(),
        translation_mm,
    }
}

/// A camera beside the arm, a board on its flange.
pub struct EyeOnBase {
    pub base_from_camera: Rigid<Base, Camera>,
    pub flange_from_board: Rigid<Flange, Board>,
}

impl EyeOnBase {
    pub fn drawn(dice: &mut Dice) -> Self {
        Self {
            base_from_camera: dice.pose(900.0),
            flange_from_board: dice.pose(120.0),
        }
    }

    /// The flange when the board is there.
    pub fn flange(&self, camera_from_board: &Rigid<Camera, Board>) -> Rigid<Base, Flange> {
        self.base_from_camera * *camera_from_board * self.flange_from_board.inverse()
    }

    pub fn exact(&self, camera_from_board: Rigid<Camera, Board>) -> Station {
        Station {
            base_from_flange: self.flange(&camera_from_board),
            camera_from_board,
            camera_covariance: None,
        }
    }

    /// With the arm's noise and corners off by `corner_px`.
    pub fn seen(
        &self,
        dice: &mut Dice,
        camera_from_board: &Rigid<Camera, Board>,
        arm: PoseNoise,
        corner_px: f64,
    ) -> Station {
        let corners: Vec<Corner> = seen_corners(dice, camera_from_board, corner_px);
        let found = board::solve(&corners, &LENS, Some(corner_px)).unwrap();
        Station {
            base_from_flange: dice.measured(&self.flange(camera_from_board), arm),
            camera_from_board: found.camera_from_board,
            camera_covariance: Some(found.covariance),
        }
    }
}

/// Where the corners of a board are seen.
pub fn seen_corners(
    dice: &mut Dice,
    camera_from_board: &Rigid<Camera, Board>,
    corner_px: f64,
) -> Vec<Corner> {
    corners_mm()
        .map(|on_board_mm| {
            let [x, y] = on_board_mm;
            let exact = LENS
                .seen_px(&(*camera_from_board * Point3::new(x, y, 0.0)))
                .unwrap();
            Corner {
                on_board_mm,
                seen_px: exact.map(|pixel| pixel + corner_px * dice.normal()),
            }
        })
        .collect()
}

/// A board in front of the camera, tilted up to `tilt_deg` about any axis.
pub fn board_in_view(dice: &mut Dice, tilt_deg: f64) -> Rigid<Camera, Board> {
    let tilt = dice.direction() * dice.within(0.0, tilt_deg.to_radians());
    let rotation = Rotation::from_scaled_axis(tilt);
    let middle = Vector3::new(
        dice.within(-80.0, 80.0),
        dice.within(-50.0, 50.0),
        dice.within(380.0, 560.0),
    );
    Rigid::new(rotation, middle - rotation * Vector3::from(MIDDLE_MM))
}

/// Root mean square and other figures of a sample.
pub fn quantile(sample: &[f64], share: f64) -> f64 {
    let mut sorted = sample.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}
