//! The divot: a cone on three dial gauges. It follows a tip that is put into it and reads how far it is held from its
//! rest.

use arthro_geometry::frame::{Flange, ForcepsBase};
use arthro_geometry::{Point3, Rigid, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::camera::normal_pair;
use crate::scenario::Scenario;

/// How far it can follow, mm.
pub const REACH_MM: f64 = 12.0;
/// Deviation of each gauge, with the play of the tip in the cone, mm.
const NOISE_MM: f64 = 0.03;

/// The tip is not in it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the tip is {distance_mm:.1} mm from the divot, which follows it over {REACH_MM} mm")]
pub struct Empty {
    /// From the tip to the divot at rest, mm.
    pub distance_mm: f64,
}

impl Scenario {
    /// What the gauges read while the flange of the forceps arm is here, mm.
    ///
    /// # Errors
    /// When the tip is not in the divot.
    pub fn divot_reading(
        &self,
        base_from_flange: &Rigid<ForcepsBase, Flange>,
        seed: u64,
    ) -> Result<Vector3, Empty> {
        let mounted = &self.truth.mounted;
        let tip = *base_from_flange * mounted.flange_from_tools[0].origin();
        read(&tip, &mounted.divot, self.spec.seed, seed)
    }
}

/// What the gauges read, mm. The same case and seed give the same noise.
///
/// # Errors
/// When the tip is out of reach.
pub fn read(tip: &Point3, rest: &Point3, case_seed: u64, seed: u64) -> Result<Vector3, Empty> {
    let displacement = tip - rest;
    let distance_mm = displacement.norm();
    if distance_mm > REACH_MM {
        return Err(Empty { distance_mm });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(case_seed);
    rng.set_stream(seed);
    let ([x, y], [z, _]) = (normal_pair(&mut rng), normal_pair(&mut rng));
    Ok(displacement + Vector3::new(x, y, z) * NOISE_MM)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gauges_read_the_displacement_and_nothing_beyond_their_reach() {
        let rest = Point3::new(100.0, 200.0, 50.0);
        let held = Vector3::new(3.0, -4.0, 5.0);
        let reading = read(&(rest + held), &rest, 1, 1).unwrap();
        assert!((reading - held).norm() < 0.2, "{reading}");
        assert_eq!(reading, read(&(rest + held), &rest, 1, 1).unwrap());
        let far = read(&(rest + held * 2.0), &rest, 1, 1);
        assert_eq!(
            far,
            Err(Empty {
                distance_mm: 2.0 * held.norm()
            })
        );
    }
}
