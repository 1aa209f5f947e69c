//! The joints themselves: how far the motors follow what is commanded. A first-order lag per joint with limits of speed
//! and acceleration.

use super::kinematics::Joints;

/// True state of the joints.
#[derive(Clone, Debug)]
pub struct Drives {
    /// rad
    pub q: Joints,
    /// rad/s
    pub qd: Joints,
    lag_s: Joints,
    speed_limit_rad_s: f64,
    accel_limit_rad_s2: f64,
}

impl Drives {
    /// At rest.
    pub fn resting(
        q: Joints,
        lag_s: Joints,
        speed_limit_rad_s: f64,
        accel_limit_rad_s2: f64,
    ) -> Self {
        Self {
            q,
            qd: [0.0; 6],
            lag_s,
            speed_limit_rad_s,
            accel_limit_rad_s2,
        }
    }

    /// Follows the target for one cycle.
    pub fn follow(&mut self, target: &Joints, dt: f64) {
        for (joint, goal) in target.iter().enumerate() {
            let share = 1.0 - (-dt / self.lag_s[joint].max(1e-6)).exp();
            let wanted = (goal - self.q[joint]) * share / dt;
            let reachable = self.accel_limit_rad_s2 * dt;
            let speed = wanted.clamp(self.qd[joint] - reachable, self.qd[joint] + reachable);
            self.qd[joint] = speed.clamp(-self.speed_limit_rad_s, self.speed_limit_rad_s);
            self.q[joint] += self.qd[joint] * dt;
        }
    }

    /// The brakes are on.
    pub fn brake(&mut self) {
        self.qd = [0.0; 6];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_followed_one_lag_behind() {
        let mut drives = Drives::resting([0.0; 6], [0.03; 6], 3.2, 40.0);
        let mut target = 0.0;
        for _ in 0..500 {
            target += 0.5 * 0.008;
            drives.follow(&[target; 6], 0.008);
        }
        let lag_s = (target - drives.q[0]) / 0.5;
        assert!((lag_s - 0.03).abs() < 0.005, "{lag_s}");
    }

    #[test]
    fn a_jump_of_the_target_breaks_no_limit() {
        let mut drives = Drives::resting([0.0; 6], [0.01; 6], 1.0, 20.0);
        let mut before = 0.0;
        for _ in 0..300 {
            drives.follow(&[2.0; 6], 0.008);
            assert!(
                drives.qd[3] <= 1.0 + 1e-12
                    && (drives.qd[3] - before).abs() <= 20.0 * 0.008 + 1e-12
            );
            before = drives.qd[3];
        }
        assert!((drives.q[3] - 2.0).abs() < 1e-3, "{}", drives.q[3]);
    }
}
