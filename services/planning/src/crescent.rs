//! The crescent of a meniscus: its plane, its centre, its free edge and its rim.
//!
//! The plane's normal is the axis of least inertia spread of the solid, the centre is that of the
//! circle which fits the surface best seen along the normal, and the body lies where the centroid
//! lies from there. All three move with the mesh, so that a plan does not depend on how the model
//! happens to lie in the CT. Rays from the centre meet the free edge first and the rim last.

use std::f64::consts::{PI, TAU};

use arthro_geometry::frame::{Ct, Frame};
use arthro_geometry::{Mesh, Point3, Rigid, Rotation, Vector3};
use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector2};

use crate::error::Error;

/// Rays around the centre.
pub const RAYS: usize = 720;
const RAY_RAD: f64 = TAU / RAYS as f64;
/// The free edge and the rim are averaged over so many rays to each side: 2 deg.
const SMOOTHING: usize = 4;
/// Least volume of a meniscus, mm3.
const MIN_VOLUME_MM3: f64 = 50.0;
/// Least angle of the opening between the horns.
const MIN_OPENING_RAD: f64 = 10.0 * PI / 180.0;

/// Axes of a crescent: x from the centre to the middle of the body, z superior, origin at the centre
/// in the height of the centroid.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct Meniscal;

impl Frame for Meniscal {
    const NAME: &'static str = "meniscal";
}

/// Free edge and rim of a meniscus in polar coordinates about its centre.
#[derive(Clone, Debug)]
pub struct Crescent {
    /// Where the crescent lies.
    pub ct_from_meniscal: Rigid<Ct, Meniscal>,
    /// The middle of the opening between the horns, 0..2 pi.
    opening_rad: f64,
    /// Distance of the free edge from the centre on each ray, mm; NaN in the opening.
    edge_mm: Vec<f64>,
    /// Distance of the rim, likewise.
    rim_mm: Vec<f64>,
}

impl Crescent {
    /// Finds the crescent of a closed surface. `above` is a point on its superior side.
    pub fn of(mesh: &Mesh, above: &Point3) -> Result<Self, Error> {
        let (centroid, covariance) = moments(mesh)?;
        let normal = normal(&covariance, &(above - centroid));
        let center = circle_center(mesh, &centroid, &normal)?;
        let body = (centroid - center)
            .try_normalize(0.5)
            .ok_or_else(|| Error::NotACrescent {
                problem: "its centroid is its centre: there is no opening".into(),
            })?;
        let axes = Matrix3::from_columns(&[body, normal.cross(&body), normal]);
        let rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let mut crescent = Self {
            ct_from_meniscal: Rigid::new(rotation, center.coords),
            opening_rad: PI,
            edge_mm: Vec::new(),
            rim_mm: Vec::new(),
        };
        let (edge_mm, rim_mm) = silhouette(&crescent.localize(mesh))?;
        crescent.opening_rad = opening(&edge_mm)?;
        crescent.edge_mm = smooth(&edge_mm);
        crescent.rim_mm = smooth(&rim_mm);
        Ok(crescent)
    }

    /// Angle of a point about the centre, 0 in the middle of the body, without a jump on the tissue.
    pub fn angle_rad(&self, point: &Point3) -> f64 {
        let angle = point.y.atan2(point.x).rem_euclid(TAU);
        if angle > self.opening_rad {
            angle - TAU
        } else {
            angle
        }
    }

    /// Distance of the free edge from the centre, mm; `None` in the opening.
    pub fn edge_mm(&self, angle_rad: f64) -> Option<f64> {
        interpolate(&self.edge_mm, angle_rad)
    }

    /// Distance of the rim from the centre, mm; `None` in the opening.
    pub fn rim_mm(&self, angle_rad: f64) -> Option<f64> {
        interpolate(&self.rim_mm, angle_rad)
    }

    /// A mesh of the CT in the axes of the crescent.
    pub fn localize(&self, mesh: &Mesh) -> Mesh {
        let meniscal_from_ct = self.ct_from_meniscal.inverse();
        Mesh {
            vertices: mesh
                .vertices
                .iter()
                .map(|v| meniscal_from_ct * *v)
                .collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    /// The first and the last angle with tissue, from horn to horn.
    pub fn span_rad(&self) -> (f64, f64) {
        let mut rays = self.rays();
        let first = rays.next().unwrap_or_default();
        (first, rays.last().unwrap_or(first))
    }

    /// The angles of all rays that meet tissue, ascending.
    pub fn rays(&self) -> impl Iterator<Item = f64> + '_ {
        let start = (self.opening_rad / RAY_RAD).ceil() as usize;
        (0..RAYS).filter_map(move |step| {
            let ray = start + step;
            let angle_rad = ray as f64 * RAY_RAD - TAU;
            (!self.edge_mm[ray % RAYS].is_nan()).then_some(angle_rad)
        })
    }
}

/// Centroid and covariance (up to scale) of the solid, exact for a closed surface.
fn moments(mesh: &Mesh) -> Result<(Point3, Matrix3<f64>), Error> {
    // About a vertex, so that a small hole hardly matters.
    let about = mesh.vertices[0];
    let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for index in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(index).map(|corner| corner - about);
        let part = a.dot(&b.cross(&c)) / 6.0;
        let sum = a + b + c;
        volume += part;
        first += sum * (part / 4.0);
        let squares = a * a.transpose() + b * b.transpose() + c * c.transpose();
        second += (sum * sum.transpose() + squares) * (part / 20.0);
    }
    if volume.abs() < MIN_VOLUME_MM3 {
        return Err(Error::NotACrescent {
            problem: format!("it encloses {volume:.3} mm3, the least is {MIN_VOLUME_MM3} mm3"),
        });
    }
    // Inward-facing triangles negate all three sums and cancel here.
    let mean = first / volume;
    let covariance = second / volume - mean * mean.transpose();
    Ok((about + mean, covariance))
}

fn normal(covariance: &Matrix3<f64>, above: &Vector3) -> Vector3 {
    let eigen = SymmetricEigen::new(*covariance);
    let thinnest = eigen.eigenvalues.imin();
    let normal: Vector3 = eigen.eigenvectors.column(thinnest).into();
    if normal.dot(above) < 0.0 {
        -normal
    } else {
        normal
    }
}

/// Centre of the circle that fits the surface best seen along `normal`, in the centroid's plane:
/// Kasa's linear least squares, weighted by area.
fn circle_center(mesh: &Mesh, centroid: &Point3, normal: &Vector3) -> Result<Point3, Error> {
    let flat = |point: &Point3| {
        let offset = point - centroid;
        offset - normal * offset.dot(normal)
    };
    // |p|^2 = 2 c.p + k with p across the normal; the normal's own row makes the matrix regular.
    let (mut matrix, mut right) = (normal * normal.transpose(), Vector3::zeros());
    let (mut area, mut mean, mut mean_square) = (0.0, Vector3::zeros(), 0.0);
    let weighted: Vec<(f64, Vector3)> = (0..mesh.triangles.len())
        .map(|index| {
            let [a, b, c] = mesh.corners(index);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            (0.5 * (b - a).cross(&(c - a)).norm(), flat(&middle))
        })
        .collect();
    for (weight, point) in &weighted {
        area += weight;
        mean += point * *weight;
        mean_square += weight * point.norm_squared();
    }
    mean /= area;
    mean_square /= area;
    for (weight, point) in &weighted {
        let offset = point - mean;
        matrix += offset * offset.transpose() * (2.0 * weight / area);
        right += offset * ((point.norm_squared() - mean_square) * weight / area);
    }
    let center = matrix
        .lu()
        .solve(&right)
        .ok_or_else(|| Error::NotACrescent {
            problem: "its points lie on a line".into(),
        })?;
    Ok(centroid + center)
}

/// First and last crossing of each ray with the projected surface, mm; NaN where there is none.
fn silhouette(mesh: &Mesh) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let mut edge_mm = vec![f64::NAN; RAYS];
    let mut rim_mm = vec![f64::NAN; RAYS];
    for index in 0..mesh.triangles.len() {
        let corners = mesh.corners(index).map(|corner| corner.xy().coords);
        let mut turn = 0.0;
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            turn += cast(&corners[from], &corners[to], &mut edge_mm, &mut rim_mm);
        }
        if turn.abs() > PI {
            return Err(Error::NotACrescent {
                problem: "its centre lies in the tissue: there is no hollow".into(),
            });
        }
    }
    Ok((edge_mm, rim_mm))
}

/// Lets the rays meet the segment from `a` to `b`; returns the angle it spans about the centre.
fn cast(a: &Vector2<f64>, b: &Vector2<f64>, edge_mm: &mut [f64], rim_mm: &mut [f64]) -> f64 {
    let cross = a.perp(b);
    let turn = cross.atan2(a.dot(b));
    let begin = if turn < 0.0 { b } else { a };
    let from = begin.y.atan2(begin.x).rem_euclid(TAU) / RAY_RAD;
    let last = (from + turn.abs() / RAY_RAD).floor() as usize;
    for ray in from.ceil() as usize..=last {
        let angle = ray as f64 * RAY_RAD;
        let direction = Vector2::new(angle.cos(), angle.sin());
        let across = direction.perp(&(b - a));
        let radius_mm = if across.abs() > 1e-12 {
            cross / across
        } else {
            a.norm()
        };
        let ray = ray % RAYS;
        edge_mm[ray] = edge_mm[ray].min(radius_mm);
        rim_mm[ray] = rim_mm[ray].max(radius_mm);
    }
    turn
}

/// The middle of the widest gap between rays that meet tissue.
fn opening(edge_mm: &[f64]) -> Result<f64, Error> {
    let (mut widest, mut middle, mut length) = (0, 0.0, 0);
    for ray in 0..2 * RAYS {
        length = if edge_mm[ray % RAYS].is_nan() {
            length + 1
        } else {
            0
        };
        if length > widest {
            widest = length;
            middle = ray as f64 - 0.5 * length as f64 + 0.5;
        }
    }
    let angle_rad = widest as f64 * RAY_RAD;
    if !(MIN_OPENING_RAD..TAU).contains(&angle_rad) {
        return Err(Error::NotACrescent {
            problem: format!(
                "the opening between its horns spans {:.1} deg, the least is {:.0} deg",
                angle_rad.to_degrees(),
                MIN_OPENING_RAD.to_degrees()
            ),
        });
    }
    Ok((middle * RAY_RAD).rem_euclid(TAU))
}

/// Averages each ray with its neighbours on tissue.
fn smooth(radii_mm: &[f64]) -> Vec<f64> {
    (0..RAYS)
        .map(|ray| {
            if radii_mm[ray].is_nan() {
                return f64::NAN;
            }
            let window =
                (0..=2 * SMOOTHING).map(|step| radii_mm[(ray + RAYS + step - SMOOTHING) % RAYS]);
            let (sum, count) = window
                .filter(|radius| !radius.is_nan())
                .fold((0.0, 0.0), |(sum, count), radius| {
                    (sum + radius, count + 1.0)
                });
            sum / count
        })
        .collect()
}

fn interpolate(radii_mm: &[f64], angle_rad: f64) -> Option<f64> {
    let position = angle_rad.rem_euclid(TAU) / RAY_RAD;
    let (ray, share) = (position.floor() as usize % RAYS, position.fract());
    let (before, after) = (radii_mm[ray], radii_mm[(ray + 1) % RAYS]);
    match (before.is_nan(), after.is_nan()) {
        (false, false) => Some(before + share * (after - before)),
        (false, true) => Some(before),
        (true, false) => Some(after),
        (true, true) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::phantom::{self, Phantom};

    fn phantom_crescent() -> Crescent {
        Crescent::of(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL).unwrap()
    }

    #[test]
    fn free_edge_and_rim_of_the_phantom_are_those_of_its_formula() {
        let shape = Phantom::default();
        let crescent = phantom_crescent();
        for angle_rad in crescent.rays() {
            let (edge, rim) = (crescent.edge_mm(angle_rad), crescent.rim_mm(angle_rad));
            for (radius, expected) in [(edge.unwrap(), 0.0), (rim.unwrap(), 1.0)] {
                let point = Point3::new(radius * angle_rad.cos(), radius * angle_rad.sin(), 0.0);
                let at = shape.coordinates(&(crescent.ct_from_meniscal * point));
                if at.phi_rad.abs() > 1.6 {
                    continue; // rays near the horns' ends see their caps
                }
                assert!((at.width_fraction - expected).abs() < 0.06, "{at:?}");
            }
        }
    }

    #[test]
    fn superior_is_where_the_portal_is() {
        let crescent = phantom_crescent();
        let superior = crescent.ct_from_meniscal.direction(&Vector3::z());
        assert!(superior.dot(&phantom::SUPERIOR) > 0.99);
    }

    #[test]
    fn the_body_is_at_zero_and_no_tissue_is_beyond_the_opening() {
        let crescent = phantom_crescent();
        let middle = crescent.ct_from_meniscal.inverse() * Point3::new(54.0, 64.0, 50.0);
        assert!(crescent.angle_rad(&middle).abs() < 0.2);
        let angles: Vec<f64> = crescent.rays().collect();
        assert!(angles.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(angles[0] > -2.4 && angles[angles.len() - 1] < 2.4);
    }

    #[test]
    fn a_ball_is_no_crescent() {
        let mut mesh = phantom::mesh();
        for vertex in &mut mesh.vertices {
            let offset = *vertex - Point3::new(54.0, 62.0, 50.0);
            *vertex = Point3::from(offset.normalize() * 15.0);
        }
        assert!(matches!(
            Crescent::of(&mesh, &Point3::new(99.0, 0.0, 0.0)),
            Err(Error::NotACrescent { .. })
        ));
    }
}
