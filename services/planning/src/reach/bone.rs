//! A bone prepared for many questions: does a shaft come near it, where, and how near.
//!
//! A mesh is asked twice. Its distance field leads along the shaft in steps as long as the free space
//! around the axis, so that only short pieces remain which may touch; those are tested exactly against
//! the triangles in their bounding box. A long diagonal shaft as a whole would have a bounding box
//! full of triangles.

use arthro_geometry::{Point3, Vector3};
use parry3d_f64::bounding_volume::BoundingVolume as _;
use parry3d_f64::math::Pose3;
use parry3d_f64::query::{self, ClosestPoints, PointQueryWithLocation as _};
use parry3d_f64::shape::{Shape as _, TriMesh};

use super::convert::{from_glam, to_glam, trimesh};
use super::field::{self, DistanceField};
use super::joint::Obstacle;
use super::limits::in_range;
use super::shaft::Capsule;
use crate::error::Error;

/// Longest piece of a shaft that is tested against triangles, mm.
const PIECE_MM: f64 = 4.0;
/// Shortest step along the axis, mm: below it testing a piece is cheaper.
const MIN_STEP_MM: f64 = 1.0;
/// Rounds that lead from the nearest sample to the nearest place.
const ROUNDS: usize = 4;
/// Least extent of a bone, mm: less is a mesh in metres.
const MIN_EXTENT_MM: f64 = 10.0;
/// Radii of a condyle, mm.
const BALL_RADIUS_MM: std::ops::RangeInclusive<f64> = 5.0..=100.0;

/// A bone in the axes of the crescent.
#[derive(Clone, Debug)]
pub struct Bone(Shape);

#[derive(Clone, Debug)]
enum Shape {
    Mesh {
        field: DistanceField,
        surface: TriMesh,
    },
    Ball {
        center: Point3,
        radius_mm: f64,
    },
    Below {
        height_mm: f64,
    },
}

/// Where a shaft and a bone are nearest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// Between the shaft's surface and the bone's, mm, negative by as much as they overlap.
    pub distance_mm: f64,
    /// The place on the bone, mm.
    pub at: Point3,
    /// The triangle of the bone's mesh that it is on.
    pub triangle: Option<u32>,
}

impl Bone {
    /// Prepares an obstacle. `name` names it in errors.
    ///
    /// # Errors
    /// When a mesh has no triangle, a vertex that is not finite or names none, is smaller than 10 mm or
    /// too large for its field; when a ball or plane is not finite.
    pub fn of(name: &'static str, obstacle: &Obstacle) -> Result<Self, Error> {
        let shape = match obstacle {
            Obstacle::Mesh(mesh) => {
                arthro_geometry::volume::check(mesh)?;
                let (low, high) = mesh.bounds().ok_or(arthro_geometry::volume::Error::Empty)?;
                let extent_mm = (high - low).max();
                if extent_mm < MIN_EXTENT_MM {
                    return Err(Error::invalid(
                        name,
                        format!(
                            "is {extent_mm:.3} mm long, the least is {MIN_EXTENT_MM} mm: is it in metres?"
                        ),
                    ));
                }
                let surface =
                    trimesh(mesh).map_err(|error| Error::invalid(name, error.to_string()))?;
                let field = DistanceField::of(name, mesh, &surface)?;
                Shape::Mesh { field, surface }
            }
            Obstacle::Ball { center, radius_mm } => {
                in_range(name, *radius_mm, BALL_RADIUS_MM)?;
                for value in center.iter() {
                    in_range(name, *value, -1000.0..=1000.0)?;
                }
                Shape::Ball {
                    center: *center,
                    radius_mm: *radius_mm,
                }
            }
            Obstacle::Below { height_mm } => {
                in_range(name, *height_mm, -1000.0..=1000.0)?;
                Shape::Below {
                    height_mm: *height_mm,
                }
            }
        };
        Ok(Self(shape))
    }

    /// The distance field of a mesh.
    pub fn field(&self) -> Option<&DistanceField> {
        match &self.0 {
            Shape::Mesh { field, .. } => Some(field),
            Shape::Ball { .. } | Shape::Below { .. } => None,
        }
    }

    /// Distance of a point to the bone, mm, negative inside; that of a mesh is interpolated.
    pub fn point_mm(&self, point: &Point3) -> f64 {
        match &self.0 {
            Shape::Mesh { field, .. } => field.distance_mm(point),
            Shape::Ball { center, radius_mm } => (point - center).norm() - radius_mm,
            Shape::Below { height_mm } => point.z - height_mm,
        }
    }

    /// Whether a shaft comes nearer than `clearance_mm`. Exact.
    pub fn touches(&self, shaft: &Capsule, clearance_mm: f64) -> bool {
        match &self.0 {
            Shape::Mesh { field, surface } => {
                first_hit(field, surface, shaft, clearance_mm).is_some()
            }
            // Not a negated comparison: what is no number touches.
            _ => {
                !matches!(self.nearest(shaft), Near { distance_mm, .. } if distance_mm >= clearance_mm)
            }
        }
    }

    /// Where a shaft comes nearer than `clearance_mm`; `None` if it does not.
    pub fn hit(&self, shaft: &Capsule, clearance_mm: f64) -> Option<Near> {
        match &self.0 {
            Shape::Mesh { field, surface } => {
                let way_mm = first_hit(field, surface, shaft, clearance_mm)?;
                let first = descend(field, surface, shaft, way_mm);
                let nearest = self.nearest(shaft);
                Some(if nearest.distance_mm < first.distance_mm {
                    nearest
                } else {
                    first
                })
            }
            _ => self
                .touches(shaft, clearance_mm)
                .then(|| self.nearest(shaft)),
        }
    }

    /// Where a shaft and the bone are nearest. Beyond [`field::MARGIN_MM`] around a mesh the distance
    /// may be that of a place a little less near.
    pub fn nearest(&self, shaft: &Capsule) -> Near {
        match &self.0 {
            Shape::Mesh { field, surface } => {
                descend(field, surface, shaft, nearest_way_mm(field, shaft))
            }
            Shape::Ball { center, radius_mm } => {
                let offset = shaft.at(shaft.way_mm(center)) - center;
                let outward = offset.try_normalize(1e-9).unwrap_or_else(Vector3::z);
                Near {
                    distance_mm: offset.norm() - radius_mm - shaft.radius_mm,
                    at: center + outward * *radius_mm,
                    triangle: None,
                }
            }
            Shape::Below { height_mm } => {
                let far = shaft.at(shaft.length_mm);
                let lowest = if far.z < shaft.start.z {
                    far
                } else {
                    shaft.start
                };
                Near {
                    distance_mm: lowest.z - height_mm - shaft.radius_mm,
                    at: Point3::new(lowest.x, lowest.y, *height_mm),
                    triangle: None,
                }
            }
        }
    }

    /// Distance between a shaft and the bone, mm, negative by as much as they overlap. That of a mesh
    /// is looked up in its field: fast and a little off.
    pub fn distance_mm(&self, shaft: &Capsule) -> f64 {
        match &self.0 {
            Shape::Mesh { field, .. } => {
                field.distance_mm(&shaft.at(nearest_way_mm(field, shaft))) - shaft.radius_mm
            }
            _ => self.nearest(shaft).distance_mm,
        }
    }
}

/// How far along the axis the first piece begins that comes nearer than `clearance_mm`, mm.
fn first_hit(
    field: &DistanceField,
    surface: &TriMesh,
    shaft: &Capsule,
    clearance_mm: f64,
) -> Option<f64> {
    let reach_mm = shaft.radius_mm + clearance_mm;
    let mut way_mm = 0.0;
    loop {
        let distance_mm = field.distance_mm(&shaft.at(way_mm));
        if distance_mm < -field::ERROR_MM {
            return Some(way_mm);
        }
        // No place of the axis within this step is nearer to the surface than `reach_mm`.
        let free_mm = distance_mm - field::ERROR_MM - reach_mm;
        if free_mm >= MIN_STEP_MM {
            way_mm += free_mm;
        } else {
            let end_mm = (way_mm + PIECE_MM).min(shaft.length_mm);
            if let Some(hit_mm) = exact(surface, shaft, (way_mm, end_mm), reach_mm) {
                return Some(hit_mm);
            }
            way_mm = end_mm;
        }
        if way_mm >= shaft.length_mm {
            return None;
        }
    }
}

/// Where on a piece of the axis a triangle is within `reach_mm`, mm from the start of the axis.
fn exact(
    surface: &TriMesh,
    shaft: &Capsule,
    (from_mm, to_mm): (f64, f64),
    reach_mm: f64,
) -> Option<f64> {
    let piece = shaft.segment(from_mm, to_mm);
    let near = piece.compute_aabb(&Pose3::IDENTITY).loosened(reach_mm);
    surface.bvh().intersect_aabb(&near).find_map(|index| {
        let triangle = surface.triangle(index);
        let closest = query::details::closest_points_support_map_support_map(
            &Pose3::IDENTITY,
            &piece,
            &triangle,
            reach_mm,
        );
        match closest {
            ClosestPoints::WithinMargin(on_axis, _) => Some(shaft.way_mm(&from_glam(on_axis))),
            ClosestPoints::Intersecting => Some(0.5 * (from_mm + to_mm)),
            ClosestPoints::Disjoint => None,
        }
    })
}

/// Where on the axis the field is least, mm from its start.
fn nearest_way_mm(field: &DistanceField, shaft: &Capsule) -> f64 {
    let (mut nearest_mm, mut nearest_way_mm) = (f64::INFINITY, 0.0);
    let mut way_mm = 0.0;
    loop {
        let distance_mm = field.distance_mm(&shaft.at(way_mm));
        if distance_mm < nearest_mm {
            (nearest_mm, nearest_way_mm) = (distance_mm, way_mm);
        }
        if way_mm >= shaft.length_mm {
            return nearest_way_mm;
        }
        // Distance falls by at most 1 mm a mm: before that far nothing is nearer.
        let step_mm = (distance_mm - nearest_mm).max(MIN_STEP_MM);
        way_mm = (way_mm + step_mm).min(shaft.length_mm);
    }
}

/// The nearest place to a place of the axis, then the nearest place of the axis to that, and so on:
/// each round is at least as near as the one before.
fn descend(field: &DistanceField, surface: &TriMesh, shaft: &Capsule, way_mm: f64) -> Near {
    let mut on_axis = shaft.at(way_mm);
    let mut near = nearest_to(surface, &on_axis);
    for _ in 0..ROUNDS {
        on_axis = shaft.at(shaft.way_mm(&near.at));
        near = nearest_to(surface, &on_axis);
    }
    // Close to the surface its exact distance tells more than the sign of an interpolated one.
    let is_inside = field.distance_mm(&on_axis) < -1e-3;
    let axis_mm = if is_inside {
        -near.distance_mm
    } else {
        near.distance_mm
    };
    Near {
        distance_mm: axis_mm - shaft.radius_mm,
        ..near
    }
}

/// The place of the surface nearest to a point and its distance, mm, never negative.
fn nearest_to(surface: &TriMesh, point: &Point3) -> Near {
    let at = to_glam(point);
    let (nearest, (triangle, _)) = surface.project_local_point_and_get_location(at, false);
    Near {
        distance_mm: (nearest.point - at).length(),
        at: from_glam(nearest.point),
        triangle: Some(triangle),
    }
}
