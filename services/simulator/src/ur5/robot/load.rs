//! What hangs at the flange, and the force that the controller believes to feel.

use nalgebra::{Isometry3, Translation3};

use super::Robot;
use crate::ur5::kinematics::Joints;

/// Gravity where the arm stands, m/s².
pub const GRAVITY_M_S2: f64 = 9.82;

impl Robot {
    /// What truly hangs at the flange, kg.
    pub fn carried_kg(&self) -> f64 {
        self.config.carried_kg.unwrap_or(self.payload_kg)
    }

    /// Force and torque that the controller believes to feel, in base axes: the weight that was not declared, and what an
    /// external sensor tells. N and Nm.
    pub fn wrench(&self) -> Joints {
        let mut wrench = self.external_wrench;
        wrench[2] -= (self.carried_kg() - self.payload_kg) * GRAVITY_M_S2;
        wrench
    }

    /// What hangs at the flange is inertia to the joints that swing it.
    pub(super) fn carry_payload(&mut self) {
        let carried_kg = self.carried_kg();
        let inertia_kg_m2 = if carried_kg > 0.0 {
            let flange_from_cog = Isometry3::from(Translation3::from(self.payload_cog_m));
            let jacobian = self.dh.jacobian(&self.drives.q, &flange_from_cog);
            std::array::from_fn(|joint| {
                carried_kg * jacobian.fixed_view::<3, 1>(0, joint).norm_squared()
            })
        } else {
            [0.0; 6]
        };
        self.drives.carry(inertia_kg_m2);
    }
}
