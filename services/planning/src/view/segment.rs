//! How close two straight shafts come.

use arthro_geometry::{Point3, Vector3};

/// The axis of a shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end, mm.
    pub from: Point3,
    /// The other end, mm.
    pub to: Point3,
}

impl Segment {
    /// Distance between the nearest points of two segments, mm.
    ///
    /// The squared distance is convex in both parameters: the minimum lies where the lines come
    /// closest or, if that is beyond an end, on an end; clamping one parameter and solving for the
    /// other finds it (Ericson, Real-Time Collision Detection, 5.1.9).
    pub fn distance_mm(&self, other: &Self) -> f64 {
        let (a, b) = (self.to - self.from, other.to - other.from);
        let between = self.from - other.from;
        let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
        let (ta, tb) = (a.dot(&between), b.dot(&between));
        let parallel = aa * bb - ab * ab;
        let on_lines = if parallel > f64::EPSILON * aa * bb {
            ((ab * tb - bb * ta) / parallel).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let along_other = share(ab * on_lines + tb, bb);
        let along_self = share(ab * along_other - ta, aa);
        (between + a * along_self - b * along_other).norm()
    }
}

/// `way / length`, kept on the segment; a segment without length has one point only.
fn share(way: f64, length: f64) -> f64 {
    if length > 0.0 {
        (way / length).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// The segment that ends at `tip` and comes from `length_mm` behind it.
pub(super) fn behind(tip: Point3, approach: &Vector3, length_mm: f64) -> Segment {
    Segment {
        from: tip - approach * length_mm,
        to: tip,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point3> {
        (-20.0..20.0f64, -20.0..20.0f64, -20.0..20.0f64).prop_map(|(x, y, z)| Point3::new(x, y, z))
    }

    fn segment() -> impl Strategy<Value = Segment> {
        (point(), point()).prop_map(|(from, to)| Segment { from, to })
    }

    proptest! {
        #[test]
        fn no_pair_of_points_is_nearer_than_the_distance_and_some_pair_is_as_near(
            (one, other) in (segment(), segment())
        ) {
            let distance_mm = one.distance_mm(&other);
            let steps = 60;
            let at = |segment: &Segment, step: i32| {
                segment.from + (segment.to - segment.from) * (f64::from(step) / f64::from(steps))
            };
            let mut nearest_mm = f64::INFINITY;
            for i in 0..=steps {
                for j in 0..=steps {
                    nearest_mm = nearest_mm.min((at(&one, i) - at(&other, j)).norm());
                }
            }
            prop_assert!(distance_mm <= nearest_mm + 1e-9);
            // Half a step along either segment away at most.
            prop_assert!(nearest_mm - distance_mm <= 70.0 / f64::from(steps));
            prop_assert!((distance_mm - other.distance_mm(&one)).abs() < 1e-9);
        }
    }

    #[test]
    fn parallel_touching_and_pointlike_segments_have_a_distance() {
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let along = Segment {
            from: at(0.0, 0.0),
            to: at(10.0, 0.0),
        };
        let beside = Segment {
            from: at(12.0, 3.0),
            to: at(4.0, 3.0),
        };
        let behind = Segment {
            from: at(13.0, 4.0),
            to: at(20.0, 4.0),
        };
        let place = Segment {
            from: at(5.0, -2.0),
            to: at(5.0, -2.0),
        };
        assert_eq!(along.distance_mm(&beside), 3.0);
        assert_eq!(along.distance_mm(&behind), 5.0);
        assert_eq!(along.distance_mm(&along), 0.0);
        assert_eq!(along.distance_mm(&place), 2.0);
        assert_eq!(place.distance_mm(&place), 0.0);
    }
}
