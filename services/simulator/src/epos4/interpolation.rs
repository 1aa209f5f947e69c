//! The cyclic position mode between two targets of the master: a straight line over the interpolation period.

use super::trajectory::Trajectory;

/// The line under way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interpolation {
    target_qc: Option<f64>,
    left_s: f64,
}

impl Interpolation {
    /// One cycle towards the master's newest target. With a period of 0 the demand steps to it. No demand exceeds
    /// `max_speed_qc_s`.
    pub fn cycle(
        &mut self,
        trajectory: &mut Trajectory,
        target_qc: f64,
        period_s: f64,
        max_speed_qc_s: f64,
        dt_s: f64,
    ) {
        if self.target_qc.replace(target_qc) != Some(target_qc) {
            self.left_s = period_s;
        }
        let distance_qc = target_qc - trajectory.position_qc;
        let share = if self.left_s > dt_s {
            dt_s / self.left_s
        } else {
            1.0
        };
        self.left_s = (self.left_s - dt_s).max(0.0);
        let reach_qc = max_speed_qc_s * dt_s;
        let step_qc = (distance_qc * share).clamp(-reach_qc, reach_qc);
        *trajectory = Trajectory {
            position_qc: trajectory.position_qc + step_qc,
            // A step has no speed that the controller could follow.
            speed_qc_s: if period_s > 0.0 { step_qc / dt_s } else { 0.0 },
            acceleration_qc_s2: 0.0,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_is_reached_at_the_end_of_its_period_on_a_straight_line() {
        let (mut interpolation, mut trajectory) = (Interpolation::default(), Trajectory::default());
        let mut positions = Vec::new();
        for _ in 0..6 {
            interpolation.cycle(&mut trajectory, 100.0, 0.002, 1e6, 0.0004);
            positions.push(trajectory.position_qc.round());
        }
        assert_eq!(positions, [20.0, 40.0, 60.0, 80.0, 100.0, 100.0]);
        assert_eq!(trajectory.speed_qc_s, 0.0);
    }

    #[test]
    fn a_period_of_zero_steps_and_the_speed_limit_holds() {
        let (mut interpolation, mut trajectory) = (Interpolation::default(), Trajectory::default());
        interpolation.cycle(&mut trajectory, 100.0, 0.0, 100_000.0, 0.0004);
        assert!((trajectory.position_qc - 40.0).abs() < 1e-9);
    }
}
