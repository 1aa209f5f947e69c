//! The parametric meniscus phantom: a crescent of known size in the coordinates of the paper.
//!
//! x is superior. Seen from above, the free edge and the rim are given in polar coordinates about
//! [`Phantom::center`]: the angle `phi` is zero in the middle of the body, positive towards the
//! anterior horn (+z) and negative towards the posterior horn; the width fraction `s` runs from 0 at
//! the free edge to 1 at the rim. The rim is an ellipse, the inferior surface is flat, and the
//! thickness grows from the free edge to the rim. With the default sizes the paper's start, goal and
//! target box lie on the tissue.

use std::f64::consts::FRAC_PI_2;

use crate::{Mesh, Point3, Vector3};

/// Towards the femur.
pub const SUPERIOR: Vector3 = Vector3::new(1.0, 0.0, 0.0);
/// Towards the anterior horn, in the meniscal plane.
pub const ANTERIOR: Vector3 = Vector3::new(0.0, 0.0, 1.0);
/// The paper's start of the path, mm: 11 % of the width from the free edge, anterior.
pub const START: Point3 = Point3::new(53.0, 48.0, 61.0);
/// The paper's goal of the path, mm: 71 % of the width from the free edge, posterior.
pub const GOAL: Point3 = Point3::new(54.0, 53.0, 36.0);
/// The paper's target box, mm: lowest and highest corner.
pub const TARGET_BOX: (Point3, Point3) =
    (Point3::new(50.0, 40.0, 30.0), Point3::new(60.0, 70.0, 70.0));
/// An anterolateral portal: 26 mm in front of the anterior rim, 10 mm above the joint line.
pub const PORTAL_ANTEROLATERAL: Point3 = Point3::new(62.0, 12.0, 94.5);

/// The sizes of the crescent; the default is the one the constants of this module lie on.
#[derive(Clone, Debug, PartialEq)]
pub struct Phantom {
    /// Centre of the polar coordinates, on the inferior surface, mm.
    pub center: Point3,
    /// Semi-axis of the rim's ellipse from the centre to the middle of the body (+y), mm.
    pub rim_body_mm: f64,
    /// Semi-axis of the rim's ellipse from the centre to the anterior and posterior side (z), mm.
    pub rim_side_mm: f64,
    /// Radial width at the anterior horn, mm.
    pub width_anterior_mm: f64,
    /// Radial width in the middle of the body, mm.
    pub width_body_mm: f64,
    /// Radial width at the posterior horn, mm.
    pub width_posterior_mm: f64,
    /// Thickness at the free edge, mm.
    pub free_edge_mm: f64,
    /// Thickness at the rim, mm.
    pub rim_mm: f64,
    /// Where both horns end: at plus and minus this angle.
    pub horn_rad: f64,
}

/// Where a point lies in the crescent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// Angle from the middle of the body, positive towards the anterior horn.
    pub phi_rad: f64,
    /// 0 at the free edge, 1 at the rim.
    pub width_fraction: f64,
    /// 0 at the inferior surface, 1 at the superior one.
    pub height_fraction: f64,
}

/// A cleft that runs from the free edge towards the rim through the full thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadialTear {
    /// Where along the crescent.
    pub phi_rad: f64,
    /// How far towards the rim, as a share of the local width.
    pub depth_fraction: f64,
    /// Across the cleft, mm.
    pub width_mm: f64,
}

impl RadialTear {
    /// The tear of the standard case: middle of the body, 42 % of the width, 1.5 mm across.
    pub const BODY: Self = Self {
        phi_rad: 0.0,
        depth_fraction: 0.42,
        width_mm: 1.5,
    };
}

/// The default phantom's closed surface.
pub fn mesh() -> Mesh {
    Phantom::default().mesh()
}

impl Default for Phantom {
    fn default() -> Self {
        Self {
            center: Point3::new(52.0, 46.0, 50.0),
            rim_body_mm: 22.5,
            rim_side_mm: 18.5,
            width_anterior_mm: 8.0,
            width_body_mm: 10.0,
            width_posterior_mm: 11.5,
            free_edge_mm: 1.6,
            rim_mm: 6.0,
            horn_rad: 104f64.to_radians(),
        }
    }
}

impl Phantom {
    /// Radial width between the free edge and the rim at `phi_rad`, mm.
    pub fn width_mm(&self, phi_rad: f64) -> f64 {
        let horn_mm = if phi_rad > 0.0 {
            self.width_anterior_mm
        } else {
            self.width_posterior_mm
        };
        // Settles a quarter turn away from the body, without a step in slope.
        let share = (phi_rad.abs() / FRAC_PI_2).min(1.0);
        self.width_body_mm + (horn_mm - self.width_body_mm) * share * share * (3.0 - 2.0 * share)
    }

    /// Distance from the centre to the rim at `phi_rad`, mm.
    pub fn rim_radius_mm(&self, phi_rad: f64) -> f64 {
        (phi_rad.cos() / self.rim_body_mm)
            .hypot(phi_rad.sin() / self.rim_side_mm)
            .recip()
    }

    /// Thickness at `width_fraction`, mm.
    pub fn thickness_mm(&self, width_fraction: f64) -> f64 {
        // Hollow on top, as the femoral condyle shapes it.
        self.free_edge_mm + (self.rim_mm - self.free_edge_mm) * width_fraction.max(0.0).powf(1.35)
    }

    /// The point at these coordinates, mm.
    pub fn point(&self, at: Coordinates) -> Point3 {
        let radius_mm =
            self.rim_radius_mm(at.phi_rad) - (1.0 - at.width_fraction) * self.width_mm(at.phi_rad);
        let height_mm = at.height_fraction * self.thickness_mm(at.width_fraction);
        self.center
            + Vector3::new(
                height_mm,
                radius_mm * at.phi_rad.cos(),
                radius_mm * at.phi_rad.sin(),
            )
    }

    /// The inverse of [`Phantom::point`].
    pub fn coordinates(&self, point: &Point3) -> Coordinates {
        let from_center = point - self.center;
        let phi_rad = from_center.z.atan2(from_center.y);
        let radius_mm = from_center.y.hypot(from_center.z);
        let width_fraction =
            1.0 - (self.rim_radius_mm(phi_rad) - radius_mm) / self.width_mm(phi_rad);
        Coordinates {
            phi_rad,
            width_fraction,
            height_fraction: from_center.x / self.thickness_mm(width_fraction),
        }
    }

    /// Whether the point is in the tissue.
    pub fn contains(&self, point: &Point3) -> bool {
        let at = self.coordinates(point);
        at.phi_rad.abs() <= self.horn_rad
            && (0.0..=1.0).contains(&at.width_fraction)
            && (0.0..=1.0).contains(&at.height_fraction)
    }

    /// Whether the point is in tissue that belongs to `tear`.
    pub fn is_torn(&self, point: &Point3, tear: &RadialTear) -> bool {
        let at = self.coordinates(point);
        let radius_mm = (point - self.center).yz().norm();
        let across_mm = radius_mm * (at.phi_rad - tear.phi_rad).sin();
        self.contains(point)
            && (at.phi_rad - tear.phi_rad).cos() > 0.0
            && across_mm.abs() <= 0.5 * tear.width_mm
            && at.width_fraction <= tear.depth_fraction
    }

    /// The closed surface: about 6500 triangles, normals outwards.
    pub fn mesh(&self) -> Mesh {
        const SECTIONS: usize = 105;
        let outline = section_outline();
        let ring = outline.len();
        let mut mesh = Mesh::default();
        for section in 0..SECTIONS {
            let share = section as f64 / (SECTIONS - 1) as f64;
            let phi_rad = (2.0 * share - 1.0) * self.horn_rad;
            mesh.vertices
                .extend(outline.iter().map(|&(width_fraction, height_fraction)| {
                    self.point(Coordinates {
                        phi_rad,
                        width_fraction,
                        height_fraction,
                    })
                }));
        }
        for section in 0..SECTIONS - 1 {
            for step in 0..ring {
                let a = (section * ring + step) as u32;
                let b = (section * ring + (step + 1) % ring) as u32;
                let (c, d) = (a + ring as u32, b + ring as u32);
                mesh.triangles.push([a, c, b]);
                mesh.triangles.push([b, c, d]);
            }
        }
        // The horns end in flat caps: a fan about the middle of the section.
        for (section, posterior) in [(0, true), (SECTIONS - 1, false)] {
            let first = section * ring;
            let sum: Vector3 = mesh.vertices[first..first + ring]
                .iter()
                .map(|vertex| vertex.coords)
                .sum();
            let hub = mesh.vertices.len() as u32;
            mesh.vertices.push(Point3::from(sum / ring as f64));
            for step in 0..ring {
                let a = (first + step) as u32;
                let b = (first + (step + 1) % ring) as u32;
                mesh.triangles
                    .push(if posterior { [hub, a, b] } else { [hub, b, a] });
            }
        }
        mesh
    }
}

/// One turn around the cross-section as (width fraction, height fraction): inferior surface outwards,
/// up the rim, superior surface inwards, down the free edge.
fn section_outline() -> Vec<(f64, f64)> {
    const ACROSS: usize = 12;
    const UP_RIM: usize = 5;
    const DOWN_EDGE: usize = 2;
    let share = |step: usize, steps: usize| step as f64 / steps as f64;
    let inferior = (0..ACROSS).map(|step| (share(step, ACROSS), 0.0));
    let rim = (0..UP_RIM).map(|step| (1.0, share(step, UP_RIM)));
    let superior = (0..ACROSS).map(|step| (1.0 - share(step, ACROSS), 1.0));
    let edge = (0..DOWN_EDGE).map(|step| (0.0, 1.0 - share(step, DOWN_EDGE)));
    inferior.chain(rim).chain(superior).chain(edge).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn the_surface_is_closed_and_faces_outwards() {
        let mesh = mesh();
        let mut edges = HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_insert(0) += 1;
            }
        }
        for (&(a, b), &count) in &edges {
            assert_eq!(count, 1, "edge {a}-{b} is used {count} times");
            assert!(edges.contains_key(&(b, a)), "edge {a}-{b} is open");
        }
        assert!((3000..8000).contains(&mesh.triangles.len()));
        let volume_mm3 = mesh.volume_mm3();
        assert!((1900.0..2100.0).contains(&volume_mm3), "{volume_mm3} mm3");
    }

    #[test]
    fn the_crescent_is_37_by_27_mm_inside_the_papers_box() {
        let (low, high) = mesh().bounds().unwrap();
        let size = high - low;
        assert!((size.z - 37.0).abs() < 0.1, "{} mm", size.z);
        assert!((size.y - 27.0).abs() < 0.2, "{} mm", size.y);
        assert!((size.x - 6.0).abs() < 1e-9, "{} mm", size.x);
        let (box_low, box_high) = TARGET_BOX;
        assert_eq!(low.sup(&box_low), low);
        assert_eq!(high.inf(&box_high), high);
    }

    #[test]
    fn the_papers_start_and_goal_lie_in_the_tissue() {
        let phantom = Phantom::default();
        assert!(phantom.contains(&START) && phantom.contains(&GOAL));
        let start = phantom.coordinates(&START);
        let goal = phantom.coordinates(&GOAL);
        assert!((start.width_fraction - 0.11).abs() < 0.03, "{start:?}");
        assert!((goal.width_fraction - 0.71).abs() < 0.03, "{goal:?}");
        assert!((start.phi_rad.to_degrees() - 79.7).abs() < 1.0, "{start:?}");
        assert!((goal.phi_rad.to_degrees() + 63.4).abs() < 1.0, "{goal:?}");
    }

    #[test]
    fn coordinates_and_point_are_inverse() {
        let phantom = Phantom::default();
        for phi_deg in [-100.0, -63.0, -5.0, 0.0, 31.0, 99.0f64] {
            for width_fraction in [0.0, 0.3, 0.9] {
                let at = Coordinates {
                    phi_rad: phi_deg.to_radians(),
                    width_fraction,
                    height_fraction: 0.4,
                };
                let back = phantom.coordinates(&phantom.point(at));
                assert!((back.phi_rad - at.phi_rad).abs() < 1e-9);
                assert!((back.width_fraction - at.width_fraction).abs() < 1e-9);
                assert!((back.height_fraction - at.height_fraction).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_body_tear_is_about_17_mm3_on_the_free_edge() {
        const STEP_MM: f64 = 0.1;
        let phantom = Phantom::default();
        let mut count = 0;
        for (x, y, z) in (0..60).flat_map(|x| {
            (0..240).flat_map(move |y| (0..20).map(move |z| (x as f64, y as f64, z as f64)))
        }) {
            let offset = Vector3::new(x, y, z - 9.5) * STEP_MM;
            count += usize::from(phantom.is_torn(&(phantom.center + offset), &RadialTear::BODY));
        }
        let volume_mm3 = count as f64 * STEP_MM.powi(3);
        assert!((14.0..18.0).contains(&volume_mm3), "{volume_mm3} mm3");
    }
}
