//! How evenly the new inner edge runs. A sudden change of contour is where a meniscus tears again, so
//! surgeons smooth it ("avoid sudden change in contours").
//!
//! The edge is walked with dividers opened half the jaw's width, seen in the plane: the turn at a
//! place is the angle between the leg that leads to it and the leg that leads on. The legs bridge the
//! small steps in which the edge is sampled, and a jaw's own scallops count as far as the jaw could
//! smooth them. A circle of radius r turns `2 asin(leg / 2 r)`: the limit of 45 degrees is that of a
//! notch about as narrow as the jaw (r = 2 mm for a jaw 3 mm wide), or half the corner of one bite.

use std::f64::consts::FRAC_PI_4;

use nalgebra::Vector2;

use super::edge::Edge;

/// Turn above which the edge is said to jump.
pub const JUMP_RAD: f64 = FRAC_PI_4;

/// Where the direction of the new edge changes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turns {
    /// How many times the edge turns by more than [`JUMP_RAD`].
    pub jumps: usize,
    /// The largest turn.
    pub largest_rad: f64,
}

impl Turns {
    /// Of the bitten part of an edge and one leg to each side, with legs of `leg_mm`.
    pub fn of(edge: &Edge, leg_mm: f64) -> Self {
        let points: Vec<Vector2<f64>> = edge
            .rays
            .iter()
            .map(|ray| Vector2::new(ray.angle_rad.cos(), ray.angle_rad.sin()) * ray.new_mm)
            .collect();
        let mut turns = Self::default();
        let mut jumping = 0.0;
        for (index, point) in points.iter().enumerate() {
            let is_far = |other: &&Vector2<f64>| (*other - point).norm() >= leg_mm;
            let before = points[..index].iter().rposition(|other| is_far(&other));
            let after = points[index..].iter().position(|other| is_far(&other));
            let (Some(before), Some(after)) = (before, after) else {
                continue;
            };
            let span = before..=index + after;
            if !edge.rays[span].iter().any(|ray| ray.is_bitten) {
                continue;
            }
            let (into, on) = (point - points[before], points[index + after] - point);
            let turn_rad = into.perp(&on).atan2(into.dot(&on));
            turns.largest_rad = turns.largest_rad.max(turn_rad.abs());
            // A corner is met at several places in a row: it is one jump.
            let side = if turn_rad.abs() > JUMP_RAD {
                turn_rad.signum()
            } else {
                0.0
            };
            turns.jumps += usize::from(side != 0.0 && side != jumping);
            jumping = side;
        }
        turns
    }
}
