//! A bone prepared for many questions: does a shaft come near it, where, and how near.

use arthro_geometry::{Point3, Vector3};

use super::field::DistanceField;
use super::joint::Obstacle;
use super::limits::in_range;
use super::shaft::Capsule;
use super::surface::Surface;
use crate::error::Error;

/// Radii of a condyle, mm.
const BALL_RADIUS_MM: std::ops::RangeInclusive<f64> = 5.0..=100.0;

/// A bone in the axes of the crescent.
#[derive(Clone, Debug)]
pub struct Bone(Shape);

#[derive(Clone, Debug)]
enum Shape {
    Mesh(Box<Surface>),
    Ball { center: Point3, radius_mm: f64 },
    Below { height_mm: f64 },
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
        Self::while_awaited(name, obstacle, &|| true)
    }

    /// The same as long as it `is_awaited`.
    ///
    /// # Errors
    /// As [`Bone::of`], and [`Error::Cancelled`].
    pub fn while_awaited(
        name: &'static str,
        obstacle: &Obstacle,
        is_awaited: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, Error> {
        let shape = match obstacle {
            Obstacle::Mesh(mesh) => Shape::Mesh(Box::new(Surface::of(name, mesh, is_awaited)?)),
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
            Shape::Mesh(surface) => Some(surface.field()),
            Shape::Ball { .. } | Shape::Below { .. } => None,
        }
    }

    /// Distance of a point to the bone, mm, negative inside; that of a mesh is interpolated.
    pub fn point_mm(&self, point: &Point3) -> f64 {
        match &self.0 {
            Shape::Mesh(surface) => surface.field().distance_mm(point),
            Shape::Ball { center, radius_mm } => (point - center).norm() - radius_mm,
            Shape::Below { height_mm } => point.z - height_mm,
        }
    }

    /// Whether a shaft comes nearer than `clearance_mm`. Exact.
    pub fn touches(&self, shaft: &Capsule, clearance_mm: f64) -> bool {
        match &self.0 {
            Shape::Mesh(surface) => surface.first_hit(shaft, clearance_mm).is_some(),
            // Not a negated comparison: what is no number touches.
            _ => {
                !matches!(self.nearest(shaft), Near { distance_mm, .. } if distance_mm >= clearance_mm)
            }
        }
    }

    /// Where a shaft comes nearer than `clearance_mm`; `None` if it does not.
    pub fn hit(&self, shaft: &Capsule, clearance_mm: f64) -> Option<Near> {
        match &self.0 {
            Shape::Mesh(surface) => {
                let way_mm = surface.first_hit(shaft, clearance_mm)?;
                let first = surface.descend(shaft, way_mm);
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

    /// Where a shaft and the bone are nearest. Beyond [`super::MARGIN_MM`] around a mesh the distance
    /// may be that of a place a little less near.
    pub fn nearest(&self, shaft: &Capsule) -> Near {
        match &self.0 {
            Shape::Mesh(surface) => surface.descend(shaft, surface.nearest_way_mm(shaft)),
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
            Shape::Mesh(surface) => {
                surface
                    .field()
                    .distance_mm(&shaft.at(surface.nearest_way_mm(shaft)))
                    - shaft.radius_mm
            }
            _ => self.nearest(shaft).distance_mm,
        }
    }
}
