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
    /// Root mean square of the turns over the length of the edge.
    pub rms_rad: f64,
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
        let (mut squares, mut length_mm) = (0.0, 0.0);
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
            let piece_mm = (points[index + 1] - points[index - 1]).norm();
            squares += turn_rad * turn_rad * piece_mm;
            length_mm += piece_mm;
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
        if length_mm > 0.0 {
            turns.rms_rad = (squares / length_mm).sqrt();
        }
        turns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::edge::Ray;
    use arthro_geometry::Point3;

    /// An edge bitten between -45 and 45 deg, its radius a function of the angle.
    fn edge(radius_mm: impl Fn(f64) -> f64) -> Edge {
        let rays = (-180i32..=180).map(|half_deg| {
            let angle_rad = f64::from(half_deg).to_radians() / 2.0;
            let new_mm = radius_mm(angle_rad);
            Ray {
                angle_rad,
                old_mm: 12.0,
                new_mm,
                rim_mm: 22.0 - new_mm,
                is_bitten: half_deg.abs() <= 90,
                at: Point3::new(new_mm * angle_rad.cos(), new_mm * angle_rad.sin(), 0.0),
            }
        });
        Edge {
            rays: rays.collect(),
        }
    }

    #[test]
    fn a_circle_turns_by_its_radius() {
        let turns = Turns::of(&edge(|_| 14.0), 1.5);
        let expected_rad = 2.0 * (1.5f64 / 28.0).asin();
        assert_eq!(turns.jumps, 0);
        assert!((turns.largest_rad / expected_rad - 1.0).abs() < 0.1);
        assert!((turns.rms_rad / expected_rad - 1.0).abs() < 0.1);
    }

    #[test]
    fn the_steps_of_the_sampling_are_no_jumps() {
        let stepped = edge(|angle_rad| ((14.0 + 2.0 * angle_rad) * 10.0).round() / 10.0);
        let turns = Turns::of(&stepped, 1.5);
        assert_eq!(turns.jumps, 0);
        assert!(turns.largest_rad < 0.25, "{turns:?}");
    }

    #[test]
    fn a_notch_with_upright_walls_jumps_at_its_four_corners() {
        let notch = edge(|angle_rad| if angle_rad.abs() < 0.25 { 17.0 } else { 13.0 });
        let turns = Turns::of(&notch, 1.5);
        assert_eq!(turns.jumps, 4);
        assert!(turns.largest_rad > 1.3, "{turns:?}");
    }

    #[test]
    fn what_no_bite_met_does_not_count() {
        let mut whole = edge(|angle_rad| if angle_rad.abs() < 0.25 { 17.0 } else { 13.0 });
        whole.rays.iter_mut().for_each(|ray| ray.is_bitten = false);
        assert_eq!(Turns::of(&whole, 1.5), Turns::default());
        assert_eq!(Turns::of(&Edge { rays: vec![] }, 1.5), Turns::default());
    }
}
