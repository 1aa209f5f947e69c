//! The pose of a flat calibration board from where its corners are seen.
//!
//! Start: the homography from board to picture (Zhang, "A Flexible New Technique for Camera Calibration", 2000).
//! Refinement: reprojection. A flat board has a second pose that looks nearly the same, its normal mirrored about the
//! line of sight; both are refined and the better one is taken.

use arthro_geometry::frame::{Board, Camera};
use arthro_geometry::nalgebra::{
    Isometry3, Matrix2, Matrix2x3, Matrix3, SMatrix, SVector, SymmetricEigen, Translation3, Vector2,
};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};

use super::closed_form::nearest_rotation;
use super::gate::undetermined;
use super::input::Checked;
use super::least_squares::{Normal, minimise};
use super::noise::{PoseCovariance, moved};
use crate::error::Error;

/// Fewest corners.
pub const MIN_CORNERS: usize = 6;
/// Most corners.
pub const MAX_CORNERS: usize = 10_000;

/// A pinhole camera without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Column and row of the optical axis, pixels.
    pub center_px: [f64; 2],
}

/// One corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// On the board, mm.
    pub on_board_mm: [f64; 2],
    /// Column and row where it is seen, pixels.
    pub seen_px: [f64; 2],
}

/// Where a board is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardPose {
    /// The pose.
    pub camera_from_board: Rigid<Camera, Board>,
    /// Its covariance, axes of the camera.
    pub covariance: PoseCovariance,
    /// Root mean square distance between seen and expected corners, each axis, pixels.
    pub residual_px: f64,
    /// The same for the mirrored pose: little more than `residual_px` when the view cannot tell them apart.
    pub mirrored_residual_px: f64,
}

/// The board's pose. `corner_noise_px` is the standard deviation of a corner along each axis; estimated from the
/// residuals when not stated.
///
/// # Errors
/// Names every violation of the input; refuses corners on one line.
pub fn solve(
    corners: &[Corner],
    lens: &Lens,
    corner_noise_px: Option<f64>,
) -> Result<BoardPose, Error> {
    check(corners, lens, corner_noise_px)?;
    let free = || undetermined(corners.len());
    let start = from_homography(corners, lens).ok_or_else(free)?;
    let (one, one_normal) = refined(start, corners, lens).ok_or_else(free)?;
    let (other, other_normal) =
        refined(mirrored(&one, corners), corners, lens).unwrap_or((one, one_normal.clone()));
    let ((best, normal), second) = if one_normal.cost <= other_normal.cost {
        ((one, one_normal), other_normal)
    } else {
        ((other, other_normal), one_normal)
    };
    let freedom = (2 * corners.len() - 6) as f64;
    let noise_px = corner_noise_px.unwrap_or_else(|| (normal.cost / freedom).sqrt());
    let residual_px = |cost: f64| (cost / (2 * corners.len()) as f64).sqrt();
    Ok(BoardPose {
        camera_from_board: Rigid::from_isometry(best),
        covariance: normal.covariance().ok_or_else(free)? * noise_px.max(f64::EPSILON).powi(2),
        residual_px: residual_px(normal.cost),
        mirrored_residual_px: residual_px(second.cost),
    })
}

fn check(corners: &[Corner], lens: &Lens, corner_noise_px: Option<f64>) -> Result<(), Error> {
    let mut checked = Checked::default();
    if !(MIN_CORNERS..=MAX_CORNERS).contains(&corners.len()) {
        checked.wrong(
            "corners",
            format!(
                "has {} corners, must have {MIN_CORNERS} to {MAX_CORNERS}",
                corners.len()
            ),
        );
    }
    for (index, corner) in corners.iter().enumerate() {
        let [x, y] = corner.on_board_mm;
        let [column, row] = corner.seen_px;
        checked.point(
            &format!("corners[{index}].on_board_mm"),
            &Point3::new(x, y, 0.0),
        );
        checked.point(
            &format!("corners[{index}].seen_px"),
            &Point3::new(column, row, 0.0),
        );
    }
    for focal_px in lens.focal_px {
        checked.within("lens.focal_px", focal_px, &(1.0..=100_000.0));
    }
    for center_px in lens.center_px {
        checked.within("lens.center_px", center_px, &(-100_000.0..=100_000.0));
    }
    if let Some(noise_px) = corner_noise_px {
        checked.within("corner_noise_px", noise_px, &(1e-6..=100.0));
    }
    checked.passed()
}

impl Lens {
    /// Where a point of the camera's frame is seen; `None` behind the camera.
    pub fn seen_px(&self, point: &Point3) -> Option<[f64; 2]> {
        let axis =
            |index: usize| self.center_px[index] + self.focal_px[index] * point[index] / point.z;
        (point.z > 0.0).then(|| [axis(0), axis(1)])
    }

    fn ray(&self, seen_px: &[f64; 2]) -> Vector2<f64> {
        let axis = |index: usize| (seen_px[index] - self.center_px[index]) / self.focal_px[index];
        Vector2::new(axis(0), axis(1))
    }

    /// Derivative of the pixel by the point.
    fn derivative(&self, point: &Vector3) -> Matrix2x3<f64> {
        let [fx, fy] = self.focal_px.map(|focal_px| focal_px / point.z);
        Matrix2x3::new(
            fx,
            0.0,
            -fx * point.x / point.z,
            0.0,
            fy,
            -fy * point.y / point.z,
        )
    }
}

/// Direct linear transform in coordinates of size one, then the two columns of the rotation.
fn from_homography(corners: &[Corner], lens: &Lens) -> Option<Isometry3<f64>> {
    let on_board: Vec<Vector2<f64>> = corners
        .iter()
        .map(|corner| corner.on_board_mm.into())
        .collect();
    let rays: Vec<Vector2<f64>> = corners
        .iter()
        .map(|corner| lens.ray(&corner.seen_px))
        .collect();
    let (board_scaling, ray_scaling) = (scaling(&on_board)?, scaling(&rays)?);
    let mut information = SMatrix::<f64, 9, 9>::zeros();
    for (board, ray) in on_board.iter().zip(&rays) {
        let from = board_scaling * Vector3::new(board.x, board.y, 1.0);
        let to = ray_scaling * Vector3::new(ray.x, ray.y, 1.0);
        for (row, seen) in [(0, to.x), (1, to.y)] {
            let mut equation = SVector::<f64, 9>::zeros();
            equation.fixed_rows_mut::<3>(3 * row).copy_from(&from);
            equation.fixed_rows_mut::<3>(6).copy_from(&(-from * seen));
            information += equation * equation.transpose();
        }
    }
    let eigen = SymmetricEigen::new(information);
    let least: SVector<f64, 9> = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imin())
        .into_owned();
    let scaled = Matrix3::from_row_slice(least.as_slice());
    let homography = ray_scaling.try_inverse()? * scaled * board_scaling;
    let [first, second, third] =
        [0, 1, 2].map(|column| -> Vector3 { homography.column(column).into_owned() });
    // The board is in front of the camera.
    let scale = 2.0 / (first.norm() + second.norm()) * third.z.signum();
    if !scale.is_finite() {
        return None;
    }
    let (first, second) = (first * scale, second * scale);
    let axes = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    Some(Isometry3::from_parts(
        Translation3::from(third * scale),
        nearest_rotation(&axes)?,
    ))
}

/// Moves points to their middle and brings them to size one; `None` when they are one point.
fn scaling(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let count = points.len() as f64;
    let middle = points.iter().sum::<Vector2<f64>>() / count;
    let spread = points
        .iter()
        .map(|point| (point - middle).norm())
        .sum::<f64>()
        / count;
    (spread > 0.0).then(|| {
        let scale = spread.recip();
        Matrix3::new(
            scale,
            0.0,
            -scale * middle.x,
            0.0,
            scale,
            -scale * middle.y,
            0.0,
            0.0,
            1.0,
        )
    })
}

/// The pose whose normal is mirrored about the line of sight to the middle of the board.
fn mirrored(pose: &Isometry3<f64>, corners: &[Corner]) -> Isometry3<f64> {
    let half_turn = |axis: Vector3| Rotation::from_scaled_axis(axis * std::f64::consts::PI);
    let middle = corners.iter().map(on_board).sum::<Vector3>() / corners.len() as f64;
    let seen = pose.rotation * middle + pose.translation.vector;
    let rotation = half_turn(seen.normalize()) * pose.rotation * half_turn(Vector3::z());
    Isometry3::from_parts(Translation3::from(seen - rotation * middle), rotation)
}

fn refined(
    start: Isometry3<f64>,
    corners: &[Corner],
    lens: &Lens,
) -> Option<(Isometry3<f64>, Normal<6>)> {
    minimise(
        start,
        |pose| reprojection(pose, corners, lens),
        |pose, step: &SVector<f64, 6>| {
            let part = |first: usize| -> Vector3 { step.fixed_rows::<3>(first).into_owned() };
            moved(pose, part(0), part(3))
        },
    )
}

fn reprojection(pose: &Isometry3<f64>, corners: &[Corner], lens: &Lens) -> Normal<6> {
    let mut normal = Normal::empty();
    for corner in corners {
        let turned = pose.rotation * on_board(corner);
        let point = turned + pose.translation.vector;
        let Some(expected) = lens.seen_px(&point.into()) else {
            normal.cost = f64::INFINITY;
            return normal;
        };
        let residual = Vector2::from(expected) - Vector2::from(corner.seen_px);
        let by_point = lens.derivative(&point);
        let mut jacobian = SMatrix::<f64, 2, 6>::zeros();
        jacobian
            .fixed_view_mut::<2, 3>(0, 0)
            .copy_from(&(-by_point * turned.cross_matrix()));
        jacobian.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_point);
        normal.add(&residual, &jacobian, &Matrix2::identity());
    }
    normal
}

fn on_board(corner: &Corner) -> Vector3 {
    let [x, y] = corner.on_board_mm;
    Vector3::new(x, y, 0.0)
}
