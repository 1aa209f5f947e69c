//! The calibration board on the drive unit of the forceps arm, as a corner detector finds it in the camera's picture.

use arthro_geometry::frame::{Board, Camera, Flange, ForcepsBase};
use arthro_geometry::{Point3, Rigid, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::camera::normal_pair;
use crate::scenario::{Intrinsics, Scenario};

/// Corners along x and y.
const COLUMNS: u32 = 9;
const ROWS: u32 = 6;
/// Between neighbouring corners, mm.
const PITCH_MM: f64 = 12.0;
/// A board is found when it is seen at least this far from edge-on: cosine between its normal and the line of sight.
const FACING_MIN: f64 = 0.4;
/// The detector needs this much picture around a corner, pixels.
const MARGIN_PX: f64 = 8.0;

/// A corner and where it is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenCorner {
    /// On the board, mm.
    pub on_board_mm: [f64; 2],
    /// Column and row, pixels.
    pub seen_px: [f64; 2],
}

/// Why the detector finds no board.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotInView {
    /// A corner is behind the camera or too near to the edge of the picture.
    #[error("a corner at column {:.0}, row {:.0} is outside the picture of {width_px} x {height_px}", seen_px[0], seen_px[1])]
    Outside {
        /// Where it would be seen.
        seen_px: [f64; 2],
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
    },
    /// The board is seen from behind or nearly edge-on.
    #[error("the board faces the camera with a cosine of {facing:.2}, must be at least {limit}")]
    TurnedAway {
        /// Cosine between the board's normal and the line of sight.
        facing: f64,
        /// Least one.
        limit: f64,
    },
}

/// Middle of the board in its frame, mm.
pub fn middle() -> Vector3 {
    let half = |corners: u32| 0.5 * f64::from(corners - 1) * PITCH_MM;
    Vector3::new(half(COLUMNS), half(ROWS), 0.0)
}

impl Scenario {
    /// The corners of the board in the camera's picture while the flange of the forceps arm is here.
    ///
    /// # Errors
    /// When not all corners are in view.
    pub fn board_corners(
        &self,
        base_from_flange: &Rigid<ForcepsBase, Flange>,
        seed: u64,
    ) -> Result<Vec<SeenCorner>, NotInView> {
        let mounted = &self.truth.mounted;
        let camera_from_board = mounted.forceps_base_from_camera.inverse()
            * *base_from_flange
            * mounted.flange_from_board;
        find(&camera_from_board, &self.spec.camera, self.spec.seed, seed)
    }
}

/// The corners in a picture. The same case and seed give the same noise.
///
/// # Errors
/// When not all corners are in view.
pub fn find(
    camera_from_board: &Rigid<Camera, Board>,
    lens: &Intrinsics,
    case_seed: u64,
    seed: u64,
) -> Result<Vec<SeenCorner>, NotInView> {
    let at = *camera_from_board * Point3::from(middle());
    let facing = camera_from_board
        .direction(&Vector3::z())
        .dot(&at.coords.normalize());
    if facing.is_nan() || facing < FACING_MIN {
        return Err(NotInView::TurnedAway {
            facing,
            limit: FACING_MIN,
        });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(case_seed);
    rng.set_stream(seed);
    (0..ROWS * COLUMNS)
        .map(|index| [index % COLUMNS, index / COLUMNS].map(|step| f64::from(step) * PITCH_MM))
        .map(|on_board_mm| {
            let [x, y] = on_board_mm;
            let exact_px = seen(&(*camera_from_board * Point3::new(x, y, 0.0)), lens)?;
            let noise = normal_pair(&mut rng);
            Ok(SeenCorner {
                on_board_mm,
                seen_px: [0, 1].map(|axis: usize| exact_px[axis] + lens.corner_px * noise[axis]),
            })
        })
        .collect()
}

fn seen(point: &Point3, lens: &Intrinsics) -> Result<[f64; 2], NotInView> {
    let center_px = lens.principal_point_px();
    let seen_px = [0, 1].map(|axis: usize| center_px[axis] + lens.focal_px * point[axis] / point.z);
    let size_px = [lens.width_px, lens.height_px].map(f64::from);
    let is_inside = |axis: usize| (MARGIN_PX..=size_px[axis] - MARGIN_PX).contains(&seen_px[axis]);
    if point.z > 0.0 && is_inside(0) && is_inside(1) {
        return Ok(seen_px);
    }
    Err(NotInView::Outside {
        seen_px,
        width_px: lens.width_px,
        height_px: lens.height_px,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::Rotation;

    fn facing(tilt_rad: f64, aside_mm: f64) -> Rigid<Camera, Board> {
        let rotation = Rotation::from_scaled_axis(Vector3::y() * tilt_rad);
        let there = Vector3::new(aside_mm, 0.0, 350.0);
        Rigid::new(rotation, there - rotation * middle())
    }

    #[test]
    fn corners_lie_where_a_pinhole_puts_them_give_or_take_the_noise() {
        let lens = Intrinsics::default();
        let found = find(&facing(0.0, 0.0), &lens, 1, 1).unwrap();
        assert_eq!(found.len(), 54);
        let (mut sum, center_px) = (0.0, lens.principal_point_px());
        for corner in &found {
            for axis in [0, 1] {
                let offset_mm = corner.on_board_mm[axis] - middle()[axis];
                sum += (corner.seen_px[axis] - center_px[axis] - 2.0 * offset_mm).powi(2);
            }
        }
        let deviation_px = (sum / 108.0_f64).sqrt();
        assert!((0.2..0.4).contains(&deviation_px), "{deviation_px}");
        assert_eq!(found, find(&facing(0.0, 0.0), &lens, 1, 1).unwrap());
        assert_ne!(found, find(&facing(0.0, 0.0), &lens, 1, 2).unwrap());
    }

    #[test]
    fn a_board_turned_away_or_outside_the_picture_is_not_found() {
        let lens = Intrinsics::default();
        for pose in [facing(1.3, 0.0), facing(std::f64::consts::PI, 0.0)] {
            let refused = find(&pose, &lens, 1, 1);
            assert!(
                matches!(refused, Err(NotInView::TurnedAway { .. })),
                "{refused:?}"
            );
        }
        let refused = find(&facing(0.0, 300.0), &lens, 1, 1);
        assert!(
            matches!(refused, Err(NotInView::Outside { .. })),
            "{refused:?}"
        );
    }
}
