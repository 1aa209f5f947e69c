//! The demand: where the profile generator wants the shaft at this moment. Trapezoidal, from any state of motion.

use super::parameters::Profile;

/// The demanded state of motion, in coordinates of the true shaft.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Position.
    pub position_qc: f64,
    /// Speed, signed.
    pub speed_qc_s: f64,
    /// Acceleration of the last cycle, signed.
    pub acceleration_qc_s2: f64,
}

/// How far a movement has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// On the way.
    Moving,
    /// At the target, standing; or at the demanded speed.
    Arrived,
}

impl Trajectory {
    /// Standing at a position.
    #[must_use]
    pub fn standing_at(position_qc: f64) -> Self {
        Self {
            position_qc,
            ..Self::default()
        }
    }

    /// One cycle towards standing exactly at `target_qc`.
    pub fn towards_position(&mut self, target_qc: f64, profile: Profile, dt_s: f64) -> Progress {
        let distance_qc = target_qc - self.position_qc;
        // The highest speed from which braking in whole cycles ends at the target: v²/2d + v·dt/2 = distance.
        let half_step_qc_s = profile.deceleration_qc_s2 * dt_s / 2.0;
        let braking_qc_s = (half_step_qc_s * half_step_qc_s
            + 2.0 * profile.deceleration_qc_s2 * distance_qc.abs())
        .sqrt()
            - half_step_qc_s;
        let goal_qc_s = braking_qc_s.min(profile.speed_qc_s).copysign(distance_qc);
        let before = *self;
        self.towards_speed(goal_qc_s, profile, dt_s);
        let landed = distance_qc.abs() <= (self.speed_qc_s * dt_s).abs()
            && self.speed_qc_s * distance_qc >= 0.0
            && self.speed_qc_s.abs() <= 2.0 * profile.deceleration_qc_s2 * dt_s;
        // A distance too small for a cycle at the lowest speed is covered in one.
        if landed
            || distance_qc.abs() < 0.5
                && before.speed_qc_s.abs() <= profile.deceleration_qc_s2 * dt_s
        {
            *self = Self::standing_at(target_qc);
            return Progress::Arrived;
        }
        Progress::Moving
    }

    /// One cycle towards moving at `goal_qc_s`.
    pub fn towards_speed(&mut self, goal_qc_s: f64, profile: Profile, dt_s: f64) -> Progress {
        let before_qc_s = self.speed_qc_s;
        let slows_down = before_qc_s * (goal_qc_s - before_qc_s) < 0.0;
        let rate_qc_s2 = if slows_down {
            profile.deceleration_qc_s2
        } else {
            profile.acceleration_qc_s2
        };
        let step_qc_s = rate_qc_s2 * dt_s;
        self.speed_qc_s = goal_qc_s.clamp(before_qc_s - step_qc_s, before_qc_s + step_qc_s);
        self.acceleration_qc_s2 = (self.speed_qc_s - before_qc_s) / dt_s;
        self.position_qc += self.speed_qc_s * dt_s;
        if self.speed_qc_s == goal_qc_s {
            Progress::Arrived
        } else {
            Progress::Moving
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CYCLE_S: f64 = 0.0004;

    proptest! {
        #[test]
        fn every_move_lands_on_its_target_within_the_limits(
            start in -1e6_f64..1e6,
            distance in -5e5_f64..5e5,
            speed in 500.0_f64..3e5,
            acceleration in 1e4_f64..2e6,
            deceleration in 1e4_f64..2e6,
        ) {
            let profile = Profile { speed_qc_s: speed, acceleration_qc_s2: acceleration, deceleration_qc_s2: deceleration };
            let target = (start + distance).round();
            let mut trajectory = Trajectory::standing_at(start);
            let ideal_s = distance.abs() / speed + speed / acceleration + speed / deceleration;
            let mut cycles = 0.0;
            while trajectory.towards_position(target, profile, CYCLE_S) == Progress::Moving {
                cycles += 1.0;
                prop_assert!(trajectory.speed_qc_s.abs() <= speed * 1.000_001);
                prop_assert!(trajectory.acceleration_qc_s2.abs() <= acceleration.max(deceleration) * 1.000_001);
                prop_assert!((trajectory.position_qc - target) * distance <= distance.abs(), "overshoot by more than 1 qc");
                prop_assert!(cycles * CYCLE_S < ideal_s * 1.05 + 0.05, "not there after {} s", cycles * CYCLE_S);
            }
            prop_assert_eq!(trajectory, Trajectory::standing_at(target));
        }
    }

    #[test]
    fn a_target_behind_is_reached_by_turning_back() {
        let profile = Profile {
            speed_qc_s: 1e5,
            acceleration_qc_s2: 1e6,
            deceleration_qc_s2: 1e6,
        };
        let mut trajectory = Trajectory {
            position_qc: 0.0,
            speed_qc_s: 1e5,
            acceleration_qc_s2: 0.0,
        };
        let mut furthest: f64 = 0.0;
        while trajectory.towards_position(-100.0, profile, CYCLE_S) == Progress::Moving {
            furthest = furthest.max(trajectory.position_qc);
        }
        assert_eq!(trajectory.position_qc, -100.0);
        // v² / 2d = 5000 qc
        assert!((furthest - 5000.0).abs() < 50.0, "{furthest}");
    }
}
