//! Contacts in closed form: capsules against capsules, a sphere, and a round slab.

use arthro_geometry::Point3;

/// Everything within a radius of a segment, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// Ends of the segment.
    pub ends: [Point3; 2],
    /// Radius, mm.
    pub radius_mm: f64,
}

impl Capsule {
    /// The same body with its ends mapped.
    pub fn moved(&self, map: impl Fn(&Point3) -> Point3) -> Self {
        Self {
            ends: [map(&self.ends[0]), map(&self.ends[1])],
            radius_mm: self.radius_mm,
        }
    }
}

/// How far two bodies are into each other, mm; negative while they are apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penetration(f64);

impl Penetration {
    /// Far apart.
    pub const NONE: Self = Self(f64::NEG_INFINITY);

    /// The depth of a contact; `None` while the bodies are apart.
    pub fn depth_mm(self) -> Option<f64> {
        (self.0 > 0.0).then_some(self.0)
    }

    /// The deeper of two.
    pub fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }
}

/// Two capsules.
pub fn capsules(first: &Capsule, second: &Capsule) -> Penetration {
    let distance_mm = segments_mm(&first.ends, &second.ends);
    Penetration(first.radius_mm + second.radius_mm - distance_mm)
}

/// A capsule and a sphere.
pub fn capsule_sphere(capsule: &Capsule, center: &Point3, radius_mm: f64) -> Penetration {
    let [a, b] = capsule.ends;
    let along = b - a;
    let length2 = along.norm_squared();
    let share = if length2 > 0.0 {
        ((center - a).dot(&along) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let distance_mm = (center - (a + along * share)).norm();
    Penetration(capsule.radius_mm + radius_mm - distance_mm)
}

/// A capsule and the bone below `surface_mm`, round about the z axis: the part of the segment above
/// its disc counts.
pub fn capsule_slab(capsule: &Capsule, surface_mm: f64, radius_mm: f64) -> Penetration {
    let [a, b] = capsule.ends;
    let along = b - a;
    // Where the segment crosses the cylinder: |a + t d|^2 = R^2 in the plane.
    let (dd, ad, aa) = (
        along.xy().norm_squared(),
        a.coords.xy().dot(&along.xy()),
        a.coords.xy().norm_squared() - radius_mm * radius_mm,
    );
    let (from, to) = if dd > 0.0 {
        let root = ad * ad - dd * aa;
        if root < 0.0 {
            return Penetration::NONE;
        }
        ((-ad - root.sqrt()) / dd, (-ad + root.sqrt()) / dd)
    } else if aa <= 0.0 {
        (0.0, 1.0)
    } else {
        return Penetration::NONE;
    };
    let (from, to) = (from.max(0.0), to.min(1.0));
    if from > to {
        return Penetration::NONE;
    }
    let lowest_mm = (a.z + along.z * from).min(a.z + along.z * to);
    Penetration(surface_mm - (lowest_mm - capsule.radius_mm))
}

/// Distance between two segments, mm.
fn segments_mm([a, b]: &[Point3; 2], [c, d]: &[Point3; 2]) -> f64 {
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, uv, vv, uw, vw) = (u.dot(&u), u.dot(&v), v.dot(&v), u.dot(&w), v.dot(&w));
    let share = |numerator: f64, denominator: f64| {
        if denominator > 0.0 {
            (numerator / denominator).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    // Closest points of the two lines, then each clamped against the other: for a clamped s the best
    // t is a projection, and for a clamped t the best s is.
    let s = share(uv * vw - vv * uw, uu * vv - uv * uv);
    let t = share(uv * s + vw, vv);
    let s = share(uv * t - uw, uu);
    (w + u * s - v * t).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point3> {
        (-10.0..10.0f64, -10.0..10.0f64, -10.0..10.0f64).prop_map(|(x, y, z)| Point3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn segments_are_as_far_apart_as_their_closest_samples(
            a in point(), b in point(), c in point(), d in point()
        ) {
            const STEPS: u32 = 200;
            let on = |p: &Point3, q: &Point3, i: u32| p + (q - p) * (f64::from(i) / f64::from(STEPS));
            let mut sampled = f64::INFINITY;
            for i in 0..=STEPS {
                let p = on(&a, &b, i);
                for j in 0..=STEPS {
                    sampled = sampled.min((p - on(&c, &d, j)).norm());
                }
            }
            let exact = segments_mm(&[a, b], &[c, d]);
            prop_assert!(exact <= sampled + 1e-9 && sampled - exact < 0.3, "{exact} {sampled}");
        }
    }

    #[test]
    fn a_shaft_over_the_edge_of_the_slab_does_not_touch_it() {
        let shaft = |from: [f64; 3], to: [f64; 3]| Capsule {
            ends: [Point3::from(from), Point3::from(to)],
            radius_mm: 1.75,
        };
        let touches = |capsule| capsule_slab(&capsule, 0.0, 30.0).depth_mm();
        assert_eq!(touches(shaft([0.0, 0.0, 2.0], [-90.0, 0.0, 20.0])), None);
        assert_eq!(touches(shaft([-40.0, 0.0, -5.0], [-90.0, 0.0, -5.0])), None);
        let depth = touches(shaft([0.0, 0.0, 1.0], [-90.0, 0.0, 20.0])).unwrap();
        assert!((depth - 0.75).abs() < 1e-9, "{depth}");
    }
}
