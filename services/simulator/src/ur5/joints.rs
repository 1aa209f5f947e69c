//! The joints themselves: how far the motors follow what is commanded.
//!
//! A model of tracking, not of rigid bodies: each joint follows its target with a first-order lag, as a position loop does
//! whose viscous friction is compensated to a rest; dry friction that is left leaves a following error; speed is limited,
//! and acceleration by what the drives grant and by torque against the inertia of arm and payload. There is no gravity.

use super::kinematics::Joints;

/// Inertia that a joint turns with an empty flange, kg m²: an arm half stretched out. Model, not measured.
const INERTIA_KG_M2: Joints = [2.5, 2.5, 1.0, 0.12, 0.12, 0.05];
/// Friction that the drives work against, Nm and Nm s/rad. Model, not measured.
const DRY_FRICTION_NM: Joints = [8.0, 8.0, 5.0, 1.5, 1.5, 1.5];
const VISCOUS_FRICTION_NM_S: Joints = [12.0, 12.0, 8.0, 2.0, 2.0, 2.0];
/// Torque of a joint for one ampere in its motor, Nm/A. Model, not measured.
const TORQUE_NM_A: Joints = [12.0, 12.0, 12.0, 8.0, 8.0, 8.0];
/// Below this a joint stands, rad/s.
const STANDING_RAD_S: f64 = 1e-4;

/// What the drives can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// rad/s
    pub speed_rad_s: f64,
    /// rad/s²
    pub accel_rad_s2: f64,
    /// Nm
    pub torque_nm: Joints,
}

/// State of the joints.
#[derive(Clone, Debug)]
pub struct Drives {
    /// As the encoders tell, rad.
    pub q: Joints,
    /// rad/s
    pub qd: Joints,
    /// rad/s²
    pub qdd: Joints,
    /// Time constants of the position loops, s.
    pub lag_s: Joints,
    /// Following error that dry friction leaves, rad.
    pub friction_rad: Joints,
    /// By how much the encoders tell more than what is true, rad.
    offset_rad: Joints,
    /// Mass at the flange and, of its centre of gravity, the squared distance from each joint's axis.
    payload_kg_m2: Joints,
    limits: Limits,
}

impl Drives {
    /// At rest.
    pub fn resting(q: Joints, lag_s: Joints, friction_rad: Joints, limits: Limits) -> Self {
        Self {
            q,
            qd: [0.0; 6],
            qdd: [0.0; 6],
            lag_s,
            friction_rad,
            offset_rad: [0.0; 6],
            payload_kg_m2: [0.0; 6],
            limits,
        }
    }

    /// Follows the target for one cycle.
    pub fn follow(&mut self, target: &Joints, dt: f64) {
        let before = self.qd;
        for (joint, goal) in target.iter().enumerate() {
            let share = 1.0 - (-dt / self.lag_s[joint].max(1e-6)).exp();
            let wanted = self.pull(joint, goal - self.q[joint]) * share / dt;
            let reachable = self.accel_limit(joint) * dt;
            let speed = wanted.clamp(self.qd[joint] - reachable, self.qd[joint] + reachable);
            self.qd[joint] = speed.clamp(-self.limits.speed_rad_s, self.limits.speed_rad_s);
            self.q[joint] += self.qd[joint] * dt;
            self.qdd[joint] = (self.qd[joint] - before[joint]) / dt;
        }
    }

    /// The brakes are on.
    pub fn brake(&mut self) {
        self.qd = [0.0; 6];
        self.qdd = [0.0; 6];
    }

    /// Where the joints truly are, rad.
    pub fn true_q(&self) -> Joints {
        std::array::from_fn(|joint| self.q[joint] - self.offset_rad[joint])
    }

    /// What the encoders tell too much, rad.
    pub fn offset_rad(&self) -> Joints {
        self.offset_rad
    }

    /// Lets the encoders slip: what they tell jumps, the arm does not.
    pub fn slip_encoders(&mut self, offset_rad: Joints) {
        for joint in 0..6 {
            self.q[joint] += offset_rad[joint] - self.offset_rad[joint];
        }
        self.offset_rad = offset_rad;
    }

    /// What the payload adds to the inertia of each joint, kg m².
    pub fn carry(&mut self, payload_kg_m2: Joints) {
        self.payload_kg_m2 = payload_kg_m2;
    }

    /// Torque that turns the joints this way, Nm.
    pub fn torque_nm(&self, qd: &Joints, qdd: &Joints) -> Joints {
        std::array::from_fn(|joint| {
            let dry = if qd[joint].abs() > STANDING_RAD_S {
                DRY_FRICTION_NM[joint].copysign(qd[joint])
            } else {
                0.0
            };
            self.inertia(joint) * qdd[joint] + dry + VISCOUS_FRICTION_NM_S[joint] * qd[joint]
        })
    }

    /// Current for that, A.
    pub fn current_a(&self, qd: &Joints, qdd: &Joints) -> Joints {
        let torque_nm = self.torque_nm(qd, qdd);
        std::array::from_fn(|joint| torque_nm[joint] / TORQUE_NM_A[joint])
    }

    /// The part of a following error that the joint acts on.
    fn pull(&self, joint: usize, error: f64) -> f64 {
        let held = self.friction_rad[joint];
        if error.abs() <= held {
            0.0
        } else {
            error - held.copysign(error)
        }
    }

    fn inertia(&self, joint: usize) -> f64 {
        INERTIA_KG_M2[joint] + self.payload_kg_m2[joint]
    }

    fn accel_limit(&self, joint: usize) -> f64 {
        let spare_nm = (self.limits.torque_nm[joint] - DRY_FRICTION_NM[joint]).max(0.0);
        self.limits.accel_rad_s2.min(spare_nm / self.inertia(joint))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        speed_rad_s: 3.2,
        accel_rad_s2: 40.0,
        torque_nm: [150.0, 150.0, 150.0, 28.0, 28.0, 28.0],
    };

    fn drives(lag_s: f64) -> Drives {
        Drives::resting([0.0; 6], [lag_s; 6], [0.0; 6], LIMITS)
    }

    #[test]
    fn a_ramp_is_followed_one_lag_behind_at_either_rate() {
        for dt in [0.008, 0.002] {
            let mut drives = drives(0.03);
            let mut target = 0.0;
            for _ in 0..(4.0 / dt) as usize {
                target += 0.5 * dt;
                drives.follow(&[target; 6], dt);
            }
            let lag_s = (target - drives.q[0]) / 0.5;
            assert!((lag_s - 0.03).abs() < 0.005, "{lag_s}");
        }
    }

    #[test]
    fn a_jump_of_the_target_breaks_no_limit() {
        let limits = Limits {
            speed_rad_s: 1.0,
            accel_rad_s2: 20.0,
            ..LIMITS
        };
        let mut drives = Drives::resting([0.0; 6], [0.01; 6], [0.0; 6], limits);
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

    #[test]
    fn dry_friction_leaves_a_following_error_on_the_side_that_the_joint_came_from() {
        for goal in [0.5, -0.5] {
            let mut drives = Drives::resting([0.0; 6], [0.01; 6], [1e-4; 6], LIMITS);
            for cycle in 0..1000 {
                let share = (f64::from(cycle) / 500.0).min(1.0);
                drives.follow(&[goal * share; 6], 0.008);
            }
            let error: f64 = goal - drives.q[2];
            assert!((error - 1e-4_f64.copysign(goal)).abs() < 1e-6, "{error}");
        }
    }

    #[test]
    fn a_payload_takes_acceleration_away_where_torque_is_short() {
        let fastest = |payload_kg_m2: f64| {
            let mut drives = drives(0.001);
            drives.carry([payload_kg_m2; 6]);
            drives.follow(&[1.0; 6], 0.002);
            drives.qdd[0]
        };
        assert!((fastest(0.0) - 40.0).abs() < 1e-9);
        assert!((fastest(4.0) - (150.0 - 8.0) / 6.5).abs() < 1e-9);
    }

    #[test]
    fn encoders_that_slip_move_what_is_told_and_the_loop_moves_the_arm() {
        let mut drives = drives(0.01);
        drives.slip_encoders([0.02; 6]);
        assert_eq!((drives.q, drives.true_q()), ([0.02; 6], [0.0; 6]));
        for _ in 0..500 {
            drives.follow(&[0.0; 6], 0.008);
        }
        assert!(drives.q[0].abs() < 1e-6 && (drives.true_q()[0] + 0.02).abs() < 1e-6);
    }
}
