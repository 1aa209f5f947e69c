//! The surface of a bone as triangles and as the distance to them, asked together.
//!
//! The distance field leads along a shaft in steps as long as the free space around the axis, so that
//! only short pieces remain which may touch; those are tested exactly against the triangles in their
//! bounding box. A long diagonal shaft as a whole would have a bounding box full of triangles.

use arthro_geometry::{Mesh, Point3, volume};
use parry3d_f64::bounding_volume::BoundingVolume as _;
use parry3d_f64::math::Pose3;
use parry3d_f64::query::{self, ClosestPoints, PointQueryWithLocation as _};
use parry3d_f64::shape::{Segment, Shape as _, TriMesh, Triangle};

use super::bone::Near;
use super::convert::{from_glam, to_glam, trimesh};
use super::field::{self, DistanceField};
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

/// Triangles and their distance field.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    field: DistanceField,
    triangles: TriMesh,
}

impl Surface {
    /// Prepares a mesh as long as it `is_awaited`. `name` names it in errors.
    pub(super) fn of(
        name: &'static str,
        mesh: &Mesh,
        is_awaited: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, Error> {
        let unusable = |error: volume::Error| Error::invalid(name, error.to_string());
        volume::check(mesh).map_err(unusable)?;
        let (low, high) = mesh.bounds().ok_or(unusable(volume::Error::Empty))?;
        let extent_mm = (high - low).max();
        if extent_mm < MIN_EXTENT_MM {
            return Err(Error::invalid(
                name,
                format!(
                    "is {extent_mm:.3} mm long, the least is {MIN_EXTENT_MM} mm: is it in metres?"
                ),
            ));
        }
        let triangles = trimesh(mesh).map_err(|error| Error::invalid(name, error.to_string()))?;
        let field = DistanceField::of(name, mesh, &triangles, is_awaited)?;
        Ok(Self { field, triangles })
    }

    pub(super) fn field(&self) -> &DistanceField {
        &self.field
    }

    /// How far along the axis the first piece begins that comes nearer than `clearance_mm`, mm.
    pub(super) fn first_hit(&self, shaft: &Capsule, clearance_mm: f64) -> Option<f64> {
        let reach_mm = shaft.radius_mm + clearance_mm;
        let mut way_mm = 0.0;
        loop {
            let distance_mm = self.field.distance_mm(&shaft.at(way_mm));
            // Surely near enough, or inside; of what is farther than the margin the field knows nothing.
            if distance_mm + field::ERROR_MM < reach_mm.min(field::MARGIN_MM) {
                return Some(way_mm);
            }
            // No place of the axis within this step is nearer to the surface than `reach_mm`.
            let free_mm = distance_mm - field::ERROR_MM - reach_mm;
            if free_mm >= MIN_STEP_MM {
                way_mm += free_mm;
            } else {
                let end_mm = (way_mm + PIECE_MM).min(shaft.length_mm);
                if let Some(hit_mm) = self.exact(shaft, (way_mm, end_mm), reach_mm) {
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
    fn exact(&self, shaft: &Capsule, (from_mm, to_mm): (f64, f64), reach_mm: f64) -> Option<f64> {
        let piece = shaft.segment(from_mm, to_mm);
        let near = piece.compute_aabb(&Pose3::IDENTITY).loosened(reach_mm);
        self.triangles
            .bvh()
            .intersect_aabb(&near)
            .find_map(|index| {
                let triangle = self.triangles.triangle(index);
                if is_off_plane(&piece, &triangle, reach_mm) {
                    return None;
                }
                let closest = query::details::closest_points_support_map_support_map(
                    &Pose3::IDENTITY,
                    &piece,
                    &triangle,
                    reach_mm,
                );
                match closest {
                    ClosestPoints::WithinMargin(on_axis, _) => {
                        Some(shaft.way_mm(&from_glam(on_axis)))
                    }
                    ClosestPoints::Intersecting => Some(0.5 * (from_mm + to_mm)),
                    ClosestPoints::Disjoint => None,
                }
            })
    }

    /// Where on the axis the field is least, mm from its start.
    pub(super) fn nearest_way_mm(&self, shaft: &Capsule) -> f64 {
        let (mut nearest_mm, mut nearest_way_mm) = (f64::INFINITY, 0.0);
        let mut way_mm = 0.0;
        loop {
            let distance_mm = self.field.distance_mm(&shaft.at(way_mm));
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
    pub(super) fn descend(&self, shaft: &Capsule, way_mm: f64) -> Near {
        let mut on_axis = shaft.at(way_mm);
        let mut near = self.nearest_to(&on_axis);
        for _ in 0..ROUNDS {
            on_axis = shaft.at(shaft.way_mm(&near.at));
            near = self.nearest_to(&on_axis);
        }
        // Close to the surface its exact distance tells more than the sign of an interpolated one.
        let is_inside = self.field.distance_mm(&on_axis) < -1e-3;
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
    fn nearest_to(&self, point: &Point3) -> Near {
        let at = to_glam(point);
        let (nearest, (triangle, _)) = self
            .triangles
            .project_local_point_and_get_location(at, false);
        Near {
            distance_mm: (nearest.point - at).length(),
            at: from_glam(nearest.point),
            triangle: Some(triangle),
        }
    }
}

/// Whether a segment keeps to one side of a triangle's plane, farther than `reach_mm` from it: cheap
/// to tell, and true of most triangles of a bounding box.
fn is_off_plane(piece: &Segment, triangle: &Triangle, reach_mm: f64) -> bool {
    let normal = triangle.scaled_normal();
    let limit = reach_mm * normal.length();
    let heights = [piece.a, piece.b].map(|end| (end - triangle.a).dot(normal));
    heights.iter().all(|height| *height > limit) || heights.iter().all(|height| *height < -limit)
}
