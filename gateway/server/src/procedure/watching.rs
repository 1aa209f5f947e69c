//! From which of a plan's views all of its bites are watched: the arthroscope stays where it is for the whole procedure,
//! so of the places that planning found for one bite each, the one that leaves the forceps the most room is taken.

use arthro_geometry::{Point3, Vector3};

/// Below this length a segment is taken as a point, mm.
const POINT_MM: f64 = 1e-9;

/// The straight axis of a shaft inside the joint: from the portal to the tip.
#[derive(Clone, Copy, Debug)]
pub struct Shaft {
    /// Where it enters.
    pub portal: Point3,
    /// Where it ends.
    pub tip: Point3,
}

/// The tip whose shaft through `portal` keeps farthest from all `forceps`; the first of equals, `None` without tips.
pub fn roomiest(tips: &[Point3], portal: Point3, forceps: &[Shaft]) -> Option<Point3> {
    let room_mm = |tip: Point3| {
        let shaft = Shaft { portal, tip };
        let distances = forceps.iter().map(|other| shaft.distance_mm(other));
        distances.fold(f64::INFINITY, f64::min)
    };
    let mut best: Option<(Point3, f64)> = None;
    for &tip in tips {
        let room_mm = room_mm(tip);
        if best.is_none_or(|(_, best_mm)| room_mm > best_mm) {
            best = Some((tip, room_mm));
        }
    }
    best.map(|(tip, _)| tip)
}

impl Shaft {
    /// Between the axes of two shafts, mm.
    ///
    /// The distance of a point that runs along one axis from the other is convex, so that its least value is at the
    /// common normal of the lines where that meets both, or else at an end of either.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        let ends = [
            other.distance_to_mm(&self.portal),
            other.distance_to_mm(&self.tip),
            self.distance_to_mm(&other.portal),
            self.distance_to_mm(&other.tip),
        ];
        let at_an_end = ends.into_iter().fold(f64::INFINITY, f64::min);
        self.common_normal_mm(other)
            .map_or(at_an_end, |normal_mm| normal_mm.min(at_an_end))
    }

    fn direction(&self) -> Vector3 {
        self.tip - self.portal
    }

    /// Length of the common normal of both lines; `None` where it misses a shaft or the lines are parallel.
    fn common_normal_mm(&self, other: &Self) -> Option<f64> {
        let (a, b) = (self.direction(), other.direction());
        let between = other.portal - self.portal;
        let normal = a.cross(&b);
        let length2 = normal.norm_squared();
        if length2 <= POINT_MM * a.norm_squared() * b.norm_squared() {
            return None;
        }
        let along_a = between.cross(&b).dot(&normal) / length2;
        let along_b = between.cross(&a).dot(&normal) / length2;
        let meets = (0.0..=1.0).contains(&along_a) && (0.0..=1.0).contains(&along_b);
        meets.then(|| between.dot(&normal).abs() / length2.sqrt())
    }

    fn distance_to_mm(&self, point: &Point3) -> f64 {
        let direction = self.direction();
        let length2 = direction.norm_squared();
        let along = if length2 > POINT_MM * POINT_MM {
            ((point - self.portal).dot(&direction) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (self.portal + direction * along - point).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shaft(portal: [f64; 3], tip: [f64; 3]) -> Shaft {
        Shaft {
            portal: portal.into(),
            tip: tip.into(),
        }
    }

    #[test]
    fn the_place_that_crosses_the_forceps_is_not_taken() {
        let portal = Point3::new(0.0, -30.0, 0.0);
        let forceps = [shaft([-30.0, 0.0, 0.0], [10.0, 0.0, 0.0])];
        let across = Point3::new(0.0, 20.0, 0.0);
        let short = Point3::new(0.0, -15.0, 0.0);
        assert_eq!(roomiest(&[across, short], portal, &forceps), Some(short));
        assert_eq!(roomiest(&[], portal, &forceps), None);
    }

    fn place() -> impl Strategy<Value = [f64; 3]> {
        [-20.0..20.0f64, -20.0..20.0, -20.0..20.0]
    }

    proptest! {
        #[test]
        fn no_pair_of_points_is_nearer_than_the_distance_and_one_is_as_near(
            a in place(), b in place(), c in place(), d in place()
        ) {
            let (one, other) = (shaft(a, b), shaft(c, d));
            let distance_mm = one.distance_mm(&other);
            prop_assert!((distance_mm - other.distance_mm(&one)).abs() < 1e-9);
            let steps = 60;
            let at = |shaft: &Shaft, step: i32| {
                shaft.portal + shaft.direction() * (f64::from(step) / f64::from(steps))
            };
            let mut nearest_mm = f64::INFINITY;
            for i in 0..=steps {
                for j in 0..=steps {
                    nearest_mm = nearest_mm.min((at(&one, i) - at(&other, j)).norm());
                }
            }
            prop_assert!(nearest_mm >= distance_mm - 1e-9);
            // Half a step along both.
            let slack_mm = 0.5 * (one.direction().norm() + other.direction().norm()) / f64::from(steps);
            prop_assert!(nearest_mm <= distance_mm + slack_mm);
        }
    }
}
