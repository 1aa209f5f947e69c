//! Cubic B-splines through ordered points: least-squares fit, derivatives, curvature, arc length.
//!
//! The fit is chord-length parametrised and meets the first and the last point exactly (Piegl and
//! Tiller, The NURBS Book, 9.4.1). Curvature is the true one, 1/mm, of Eq. 10 of the paper:
//! `|c' x c''| / |c'|^3`.

use arthro_geometry::{Point3, Vector3};

use crate::banded::Banded;

const DEGREE: usize = 3;
/// Fewest control points of a cubic.
pub const MIN_CONTROL_POINTS: usize = DEGREE + 1;
/// Parts of a piece, each searched for a foot point: where the curve turns back sharply a piece has
/// several.
const FEET: usize = 4;
/// Pieces of a knot span between which the arc length is tabulated.
const PIECES: usize = 8;
/// Steps to a foot point; halving alone would take so many.
const MAX_STEPS: usize = 50;

/// A clamped cubic B-spline, mm, with a parameter that runs from 0 to 1.
#[derive(Clone, Debug)]
pub struct Spline {
    knots: Vec<f64>,
    control: Vec<Vector3>,
    /// Ascending (arc length, parameter).
    lengths: Vec<(f64, f64)>,
}

/// Why points have no spline.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Too few distinct points for a cubic.
    #[error("{distinct} distinct points are given, a cubic needs {MIN_CONTROL_POINTS}")]
    TooFewPoints {
        /// How many differ from their predecessor.
        distinct: usize,
    },
    /// More control points than the points determine, or fewer than a cubic has.
    #[error(
        "{control_points} control points are asked for, {distinct} distinct points allow {MIN_CONTROL_POINTS}..{distinct}"
    )]
    ControlPoints {
        /// How many are asked for.
        control_points: usize,
        /// How many points differ from their predecessor.
        distinct: usize,
    },
    /// The points do not determine the control points.
    #[error("the points do not determine {control_points} control points")]
    Undetermined {
        /// How many were asked for.
        control_points: usize,
    },
}

impl Spline {
    /// The spline with `control_points` control points that is closest to `points` by least squares.
    pub fn fit(points: &[Point3], control_points: usize) -> Result<Self, Error> {
        let mut points = points.to_vec();
        points.dedup();
        let distinct = points.len();
        if distinct < MIN_CONTROL_POINTS {
            return Err(Error::TooFewPoints { distinct });
        }
        if !(MIN_CONTROL_POINTS..=distinct).contains(&control_points) {
            return Err(Error::ControlPoints {
                control_points,
                distinct,
            });
        }
        let parameters = chord_lengths(&points);
        let knots = knots(&parameters, control_points);
        let control = least_squares(&points, &parameters, &knots, control_points)
            .ok_or(Error::Undetermined { control_points })?;
        Ok(Self::new(knots, control))
    }

    fn new(knots: Vec<f64>, control: Vec<Vector3>) -> Self {
        let mut spline = Self {
            knots,
            control,
            lengths: vec![(0.0, 0.0)],
        };
        let mut length_mm = 0.0;
        for span in DEGREE..spline.control.len() {
            let (from, to) = (spline.knots[span], spline.knots[span + 1]);
            for piece in 0..PIECES {
                let step = (to - from) / PIECES as f64;
                let start = from + step * piece as f64;
                length_mm += spline.integrate_speed(start, start + step);
                spline.lengths.push((length_mm, start + step));
            }
        }
        spline
    }

    /// Length from the first to the last point, mm.
    pub fn length_mm(&self) -> f64 {
        self.lengths.last().map_or(0.0, |&(length_mm, _)| length_mm)
    }

    /// The point at `parameter`.
    pub fn point(&self, parameter: f64) -> Point3 {
        let (span, at) = self.locate(parameter);
        let points = [0, 1, 2, 3].map(|slot| self.control[span - DEGREE + slot]);
        Point3::from(self.de_boor(points, span, at))
    }

    /// First and second derivative by the parameter.
    pub fn derivatives(&self, parameter: f64) -> (Vector3, Vector3) {
        let (span, at) = self.locate(parameter);
        let points = [0, 1, 2, 3].map(|slot| self.control[span - DEGREE + slot]);
        let knot = |offset: usize| self.knots[span + offset - 2];
        let first = [0, 1, 2].map(|slot| {
            let width = knot(slot + 3) - knot(slot);
            (points[slot + 1] - points[slot]) * (3.0 / width.max(1e-300))
        });
        let second = [0, 1].map(|slot| {
            let width = knot(slot + 3) - knot(slot + 1);
            (first[slot + 1] - first[slot]) * (2.0 / width.max(1e-300))
        });
        (
            self.de_boor(first, span, at),
            self.de_boor(second, span, at),
        )
    }

    /// The knot span and the parameter within the curve.
    fn locate(&self, parameter: f64) -> (usize, f64) {
        let parameter = parameter.clamp(0.0, 1.0);
        (span(&self.knots, self.control.len(), parameter), parameter)
    }

    /// De Boor's algorithm on the control points of one span, of the curve or of a derivative.
    fn de_boor<const N: usize>(&self, mut points: [Vector3; N], span: usize, at: f64) -> Vector3 {
        let degree = N - 1;
        for level in 1..=degree {
            for slot in (level..=degree).rev() {
                let low = self.knots[span + slot - degree];
                let high = self.knots[span + 1 + slot - level];
                let share = (at - low) / (high - low).max(1e-300);
                points[slot] = points[slot - 1] * (1.0 - share) + points[slot] * share;
            }
        }
        points[degree]
    }

    /// Unit tangent; zero where the curve stands still.
    pub fn tangent(&self, parameter: f64) -> Vector3 {
        let (first, _) = self.derivatives(parameter);
        first.try_normalize(1e-12).unwrap_or_else(Vector3::zeros)
    }

    /// Curvature, 1/mm (Eq. 10 of the paper).
    pub fn curvature_per_mm(&self, parameter: f64) -> f64 {
        let (first, second) = self.derivatives(parameter);
        let speed = first.norm();
        if speed < 1e-12 {
            return 0.0;
        }
        first.cross(&second).norm() / speed.powi(3)
    }

    /// Curvature of the curve seen along a unit normal, 1/mm: positive where it turns anticlockwise for
    /// one who looks against the normal. 0 where it runs along the normal.
    pub fn signed_curvature_per_mm(&self, parameter: f64, normal: &Vector3) -> f64 {
        let (first, second) = self.derivatives(parameter);
        let speed = (first - normal * first.dot(normal)).norm();
        if speed < 1e-12 {
            return 0.0;
        }
        first.cross(&second).dot(normal) / speed.powi(3)
    }

    /// The parameter `length_mm` after the start, clamped to the curve.
    pub fn parameter_at(&self, length_mm: f64) -> f64 {
        let after = self
            .lengths
            .partition_point(|&(length, _)| length < length_mm)
            .clamp(1, self.lengths.len() - 1);
        let (length_before, before) = self.lengths[after - 1];
        let (length_after, end) = self.lengths[after];
        let share = (length_mm - length_before) / (length_after - length_before).max(1e-12);
        let guess = before + share.clamp(0.0, 1.0) * (end - before);
        // One Newton step: the speed hardly varies within a piece.
        let error_mm = length_before + self.integrate_speed(before, guess) - length_mm;
        let speed = self.derivatives(guess).0.norm().max(1e-12);
        (guess - error_mm / speed).clamp(before, end)
    }

    /// Parameters at equal arc length, about `spacing_mm` apart, the first and the last point included.
    pub fn parameters_every(&self, spacing_mm: f64) -> Vec<f64> {
        let length_mm = self.length_mm();
        let steps = (length_mm / spacing_mm).round().max(1.0) as usize;
        (0..=steps)
            .map(|step| self.parameter_at(length_mm * step as f64 / steps as f64))
            .collect()
    }

    /// Points at equal arc length, about `spacing_mm` apart, the first and the last point included.
    pub fn points_every(&self, spacing_mm: f64) -> Vec<Point3> {
        let parameters = self.parameters_every(spacing_mm);
        parameters.iter().map(|&at| self.point(at)).collect()
    }

    /// The parameter of the point of the curve that is nearest to `point`.
    pub fn nearest(&self, point: &Point3) -> f64 {
        let squared = |at: f64| (self.point(at) - point).norm_squared();
        let ends: Vec<(f64, f64)> = self
            .lengths
            .iter()
            .map(|&(_, at)| (at, squared(at)))
            .collect();
        let closest = ends.iter().map(|end| end.1).fold(f64::INFINITY, f64::min);
        let longest_mm = self.lengths.windows(2).map(|pair| pair[1].0 - pair[0].0);
        let slack_mm = longest_mm.fold(0.0, f64::max);
        // The curve leaves the ends of a piece by less than the piece's length.
        let limit = (closest.sqrt() + slack_mm).powi(2);
        let pieces = ends
            .windows(2)
            .filter(|pair| pair[0].1.min(pair[1].1) <= limit);
        let feet = pieces.flat_map(|pair| {
            let (from, to) = (pair[0].0, pair[1].0);
            let width = (to - from) / FEET as f64;
            (0..FEET).map(move |part| {
                let from = from + width * part as f64;
                let at = self.foot(point, from, from + width);
                (at, squared(at))
            })
        });
        let nearest = feet
            .chain(ends.iter().copied())
            .min_by(|a, b| a.1.total_cmp(&b.1));
        nearest.map_or(0.0, |(at, _)| at)
    }

    /// The foot point between two parameters: Newton's method on the derivative of the squared distance,
    /// halving the interval where a step would leave it.
    fn foot(&self, point: &Point3, from: f64, to: f64) -> f64 {
        let (mut low, mut high) = (from, to);
        let mut at = 0.5 * (low + high);
        for _ in 0..MAX_STEPS {
            let offset = self.point(at) - point;
            let (first, second) = self.derivatives(at);
            let slope = offset.dot(&first);
            if slope > 0.0 {
                high = at;
            } else {
                low = at;
            }
            let next = at - slope / (first.norm_squared() + offset.dot(&second));
            let inside = low < next && next < high;
            let next = if inside { next } else { 0.5 * (low + high) };
            if (next - at).abs() < 1e-12 {
                return next;
            }
            at = next;
        }
        at
    }

    /// Root mean square distance of `points` to the curve, mm; they lie along it in order.
    pub fn rms_mm(&self, points: &[Point3]) -> f64 {
        let mut distinct = points.to_vec();
        distinct.dedup();
        let parameters = chord_lengths(&distinct);
        let sum: f64 = distinct
            .iter()
            .zip(parameters)
            .map(|(point, guess)| self.squared_distance_near(point, guess))
            .sum();
        (sum / distinct.len().max(1) as f64).sqrt()
    }

    /// Squared distance to the foot point that Gauss-Newton steps from `guess` find.
    fn squared_distance_near(&self, point: &Point3, guess: f64) -> f64 {
        let mut at = guess;
        let mut best = (self.point(at) - point).norm_squared();
        for _ in 0..8 {
            let (first, _) = self.derivatives(at);
            let step = (point - self.point(at)).dot(&first) / first.norm_squared().max(1e-12);
            at = (at + step).clamp(0.0, 1.0);
            best = best.min((self.point(at) - point).norm_squared());
        }
        best
    }

    /// Arc length between two parameters of one knot span: three-point Gauss-Legendre.
    fn integrate_speed(&self, from: f64, to: f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let node = 0.6f64.sqrt() * half;
        let speed = |at: f64| self.derivatives(at).0.norm();
        half / 9.0 * (5.0 * speed(middle - node) + 8.0 * speed(middle) + 5.0 * speed(middle + node))
    }
}

/// Length of the polygon up to each point, as a share of the whole.
fn chord_lengths(points: &[Point3]) -> Vec<f64> {
    let mut sums = vec![0.0];
    let mut sum = 0.0;
    for pair in points.windows(2) {
        sum += (pair[1] - pair[0]).norm();
        sums.push(sum);
    }
    sums.iter().map(|length| length / sum.max(1e-300)).collect()
}

/// Clamped knots that leave a point in every span (The NURBS Book, Eq. 9.8 and 9.69).
fn knots(parameters: &[f64], control_points: usize) -> Vec<f64> {
    let points = parameters.len();
    let mut knots = vec![0.0; DEGREE + 1];
    for j in 1..control_points - DEGREE {
        knots.push(if control_points == points {
            parameters[j..j + DEGREE].iter().sum::<f64>() / DEGREE as f64
        } else {
            let position = (j * points) as f64 / (control_points - DEGREE) as f64;
            let (index, share) = (position.floor(), position.fract());
            let index = index as usize;
            (1.0 - share) * parameters[index - 1] + share * parameters[index]
        });
    }
    knots.extend([1.0; DEGREE + 1]);
    knots
}

/// Control points whose first and last are the first and last point and whose others minimise the
/// squared distances at the parameters; `None` if these do not determine them.
fn least_squares(
    points: &[Point3],
    parameters: &[f64],
    knots: &[f64],
    control_points: usize,
) -> Option<Vec<Vector3>> {
    let (first, last) = (points.first()?.coords, points.last()?.coords);
    let unknown = control_points - 2;
    let mut normal = Banded::zeros(unknown, DEGREE);
    let mut right = vec![Vector3::zeros(); unknown];
    for (point, &parameter) in points.iter().zip(parameters) {
        let span = span(knots, control_points, parameter);
        let basis = basis(knots, span, parameter);
        let index_of = |slot: usize| span - DEGREE + slot;
        let mut rest = point.coords;
        for (slot, weight) in basis.iter().enumerate() {
            match index_of(slot) {
                0 => rest -= first * *weight,
                index if index == control_points - 1 => rest -= last * *weight,
                _ => {}
            }
        }
        let inner = |slot: usize| index_of(slot).checked_sub(1).filter(|&row| row < unknown);
        for slot in 0..=DEGREE {
            let Some(row) = inner(slot) else { continue };
            right[row] += rest * basis[slot];
            for other in 0..=slot {
                if let Some(column) = inner(other) {
                    normal.add(row, column, basis[slot] * basis[other]);
                }
            }
        }
    }
    let mut control = vec![first];
    control.extend(normal.solve(right)?);
    control.push(last);
    Some(control)
}

/// The knot span that holds `parameter`; the last one for the end of the curve.
fn span(knots: &[f64], control_points: usize, parameter: f64) -> usize {
    let after = knots.partition_point(|&knot| knot <= parameter);
    after.clamp(DEGREE + 1, control_points) - 1
}

/// The four basis functions that differ from zero on `span`.
fn basis(knots: &[f64], span: usize, parameter: f64) -> [f64; DEGREE + 1] {
    let mut values = [1.0, 0.0, 0.0, 0.0];
    for degree in 1..=DEGREE {
        let mut carried = 0.0;
        for slot in 0..degree {
            let (right, left) = (knots[span + slot + 1], knots[span + 1 + slot - degree]);
            let share = values[slot] / (right - left);
            values[slot] = carried + (right - parameter) * share;
            carried = (parameter - left) * share;
        }
        values[degree] = carried;
    }
    values
}

#[cfg(test)]
mod tests;
