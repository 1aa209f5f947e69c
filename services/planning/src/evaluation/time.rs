//! How long the robot needs for a bite: from the tray through the portal to the bite and back.
//!
//! The paper gives "about 34 s" a cycle and no split. The default split is an assumption that gives
//! those 34 s for a bite 60 mm from the portal, and moves with the distance from there.

use arthro_geometry::Point3;

use crate::error::Error;
use crate::jaw::Bite;

/// The parts of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Distance between portal and tray, mm; travelled twice a bite.
    pub tray_mm: f64,
    /// Mean speed between portal and tray, mm/s; above 0.
    pub free_mm_s: f64,
    /// Mean speed along the shaft inside the joint, mm/s; above 0. The way is travelled twice a bite.
    pub shaft_mm_s: f64,
    /// Way along the shaft of a bite whose portal is not known, mm.
    pub shaft_mm: f64,
    /// Pivoting about the portal, closing and opening the jaw, s.
    pub bite_s: f64,
    /// Releasing the tissue over the tray, s.
    pub release_s: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            tray_mm: 300.0,
            free_mm_s: 50.0,
            shaft_mm_s: 15.0,
            shaft_mm: 60.0,
            bite_s: 10.0,
            release_s: 4.0,
        }
    }
}

impl Timing {
    /// Refuses a speed that is not above 0, a way or a time below 0, and what is not finite.
    pub fn check(&self) -> Result<(), Error> {
        let refuse = |field, problem: String| Err(Error::invalid(field, problem));
        for (field, value) in [
            ("timing.free_mm_s", self.free_mm_s),
            ("timing.shaft_mm_s", self.shaft_mm_s),
        ] {
            if !value.is_finite() || value <= 0.0 {
                return refuse(field, format!("is {value} mm/s; must be above 0"));
            }
        }
        for (field, value) in [
            ("timing.tray_mm", self.tray_mm),
            ("timing.shaft_mm", self.shaft_mm),
            ("timing.bite_s", self.bite_s),
            ("timing.release_s", self.release_s),
        ] {
            if !value.is_finite() || value < 0.0 {
                return refuse(field, format!("is {value}; must be 0 or more"));
            }
        }
        Ok(())
    }

    /// The whole cycle of a bite through the one of `portals` that its shaft points from, s.
    pub fn cycle_s(&self, bite: &Bite, portals: &[Point3]) -> f64 {
        let shaft_mm = shaft_mm(bite, portals).unwrap_or(self.shaft_mm);
        let travel_s = self.tray_mm / self.free_mm_s + shaft_mm / self.shaft_mm_s;
        2.0 * travel_s + self.bite_s + self.release_s
    }
}

/// Way along the shaft from the portal that lies nearest to its line behind the bite, mm.
fn shaft_mm(bite: &Bite, portals: &[Point3]) -> Option<f64> {
    let ways = portals.iter().filter_map(|portal| {
        let way = bite.center - portal;
        let along_mm = way.dot(&bite.approach);
        (along_mm > 0.0).then(|| ((way - bite.approach * along_mm).norm(), way.norm()))
    });
    ways.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, way)| way)
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::Vector3;

    fn bite_from(portal: &Point3, way_mm: f64) -> Bite {
        let center = portal + Vector3::new(1.0, 0.5, -0.2).normalize() * way_mm;
        Bite::through(portal, center, &Vector3::z(), center).unwrap()
    }

    #[test]
    fn the_papers_cycle_takes_34_s() {
        let portal = Point3::new(-40.0, 3.0, 9.0);
        let timing = Timing::default();
        let bite = bite_from(&portal, 60.0);
        assert!((timing.cycle_s(&bite, &[portal]) - 34.0).abs() < 1e-9);
        assert!((timing.cycle_s(&bite, &[]) - 34.0).abs() < 1e-9);
    }

    #[test]
    fn a_deeper_bite_takes_the_way_in_and_out_longer() {
        let portal = Point3::new(-40.0, 3.0, 9.0);
        let timing = Timing::default();
        let cycle_s = |way_mm| timing.cycle_s(&bite_from(&portal, way_mm), &[portal]);
        assert!((cycle_s(75.0) - cycle_s(60.0) - 2.0).abs() < 1e-9);
    }

    #[test]
    fn the_way_is_that_from_the_bites_own_portal() {
        let (near, far) = (Point3::new(-30.0, 0.0, 9.0), Point3::new(-40.0, 40.0, 9.0));
        let bite = bite_from(&far, 75.0);
        let timing = Timing::default();
        let cycle_s = timing.cycle_s(&bite, &[near, far]);
        assert!((cycle_s - timing.cycle_s(&bite, &[far])).abs() < 1e-12);
    }

    #[test]
    fn a_speed_of_nothing_and_a_time_before_now_are_refused_by_name() {
        let refused = |timing: Timing| match timing.check() {
            Err(Error::Invalid { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let good = Timing::default();
        assert_eq!(good.check(), Ok(()));
        for free_mm_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(refused(Timing { free_mm_s, ..good }), "timing.free_mm_s");
        }
        for bite_s in [-1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(refused(Timing { bite_s, ..good }), "timing.bite_s");
        }
    }
}
