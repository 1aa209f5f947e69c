//! The motor's shaft: a current-limited servo against friction, the mechanism's force and its hard stops.
//!
//! Gear and feed screw are self-locking: the mechanism's force slows the shaft and costs current, but never turns it.

use super::defects::Drivetrain;
use super::mechanics::Mechanics;
use super::trajectory::Trajectory;

/// The motor with its gear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Current that friction costs while turning, mA.
    pub friction_ma: f64,
    /// Current that acceleration costs, mA per qc/s².
    pub inertia_ma_s2_per_qc: f64,
}

/// What the power stage is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// No current.
    Free,
    /// Hold the shaft on the demand.
    Follow(Trajectory),
    /// This current, mA.
    Current(f64),
}

/// The shaft as its encoder sees it, and what it truly does.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shaft {
    /// Position as the encoder counts it: the drive knows no other.
    pub position_qc: f64,
    /// Speed as the encoder sees it, signed.
    pub speed_qc_s: f64,
    /// Motor current, signed, mA.
    pub current_ma: f64,
    /// Motor current, averaged, mA.
    pub current_averaged_ma: f64,
    /// Speed, averaged.
    pub speed_averaged_qc_s: f64,
    /// Whether the current limit cuts what the controller wants.
    pub limited: bool,
    /// Where the rotor truly is.
    rotor_qc: f64,
    rotor_qc_s: f64,
    /// What a frozen encoder has not counted.
    uncounted_qc: f64,
    /// What a slipping belt has not carried.
    slipped_qc: f64,
}

/// Bandwidth of the position controller, rad/s.
const CONTROLLER_RAD_S: f64 = 400.0;
/// Time constant of the averaged values.
const AVERAGING_S: f64 = 0.01;
/// Nearer than this and slower than this is settled: an encoder cannot see less.
const SETTLED_QC: f64 = 0.05;
const SETTLED_QC_S: f64 = 20.0;

impl Default for Motor {
    /// A DCX 12 with a 21:1 gear: 10 000 rpm/s cost 5 mA.
    fn default() -> Self {
        Self {
            friction_ma: 40.0,
            inertia_ma_s2_per_qc: 1.5e-5,
        }
    }
}

impl Shaft {
    /// Standing here.
    #[must_use]
    pub fn at(position_qc: f64) -> Self {
        Self {
            position_qc,
            rotor_qc: position_qc,
            ..Self::default()
        }
    }

    /// Where the mechanism truly is, quadcounts.
    #[must_use]
    pub fn mechanism_qc(&self) -> f64 {
        self.rotor_qc - self.slipped_qc
    }

    /// The rotor's true speed, signed.
    #[must_use]
    pub fn rotor_qc_s(&self) -> f64 {
        self.rotor_qc_s
    }

    /// One controller cycle.
    pub fn cycle(
        &mut self,
        order: Order,
        limit_ma: f64,
        motor: &Motor,
        (mechanics, drivetrain): (&Mechanics, Drivetrain),
        dt_s: f64,
    ) {
        self.limited = false;
        let before_qc = self.rotor_qc;
        match order {
            Order::Free => self.turn(0.0, motor, mechanics, dt_s),
            Order::Current(wanted_ma) => {
                let current_ma = self.limit(wanted_ma, limit_ma);
                self.turn(current_ma, motor, mechanics, dt_s);
            }
            Order::Follow(demand) => self.follow(&demand, limit_ma, motor, mechanics, dt_s),
        }
        if drivetrain.jammed {
            (self.rotor_qc, self.rotor_qc_s) = (before_qc, 0.0);
        }
        self.meet_hard_stops(mechanics);
        let turned_qc = self.rotor_qc - before_qc;
        self.slipped_qc += turned_qc * drivetrain.slip_share;
        if drivetrain.encoder_frozen {
            self.uncounted_qc += turned_qc;
            self.speed_qc_s = 0.0;
        } else {
            self.speed_qc_s = self.rotor_qc_s;
        }
        self.position_qc = self.rotor_qc - self.uncounted_qc;
        let weight = (dt_s / AVERAGING_S).min(1.0);
        self.current_averaged_ma += (self.current_ma - self.current_averaged_ma) * weight;
        self.speed_averaged_qc_s += (self.speed_qc_s - self.speed_averaged_qc_s) * weight;
    }

    fn meet_hard_stops(&mut self, mechanics: &Mechanics) {
        if let Some(low_qc) = mechanics.hard_stop_low_qc
            && self.mechanism_qc() <= low_qc
        {
            self.rotor_qc = low_qc + self.slipped_qc;
            self.rotor_qc_s = self.rotor_qc_s.max(0.0);
        }
        if let Some(high_qc) = mechanics.hard_stop_high_qc
            && self.mechanism_qc() >= high_qc
        {
            self.rotor_qc = high_qc + self.slipped_qc;
            self.rotor_qc_s = self.rotor_qc_s.min(0.0);
        }
    }

    /// The controller knows friction and load (its integral part has found them) and places both poles at
    /// [`CONTROLLER_RAD_S`]; the current limit is what it cannot overcome.
    fn follow(
        &mut self,
        demand: &Trajectory,
        limit_ma: f64,
        motor: &Motor,
        mechanics: &Mechanics,
        dt_s: f64,
    ) {
        let error_qc = demand.position_qc - self.position_qc;
        let error_qc_s = demand.speed_qc_s - self.speed_qc_s;
        let demand_stands = demand.speed_qc_s == 0.0 && demand.acceleration_qc_s2 == 0.0;
        if demand_stands && error_qc.abs() < SETTLED_QC && self.speed_qc_s.abs() < SETTLED_QC_S {
            let holding_ma = self.limit(mechanics.load_ma, limit_ma);
            if self.rotor_qc_s.abs() < SETTLED_QC_S {
                (self.rotor_qc_s, self.current_ma) = (0.0, holding_ma);
            } else {
                // A frozen encoder hides that the rotor runs out.
                self.turn(holding_ma, motor, mechanics, dt_s);
            }
            return;
        }
        let acceleration_qc_s2 = demand.acceleration_qc_s2
            + CONTROLLER_RAD_S * CONTROLLER_RAD_S * error_qc
            + 2.0 * CONTROLLER_RAD_S * error_qc_s;
        let direction = if self.speed_qc_s == 0.0 {
            acceleration_qc_s2
        } else {
            self.speed_qc_s
        };
        let wanted_ma = mechanics.load_ma
            + motor.friction_ma * direction.signum()
            + motor.inertia_ma_s2_per_qc * acceleration_qc_s2;
        let current_ma = self.limit(wanted_ma, limit_ma);
        self.turn(current_ma, motor, mechanics, dt_s);
    }

    fn limit(&mut self, wanted_ma: f64, limit_ma: f64) -> f64 {
        self.limited = wanted_ma.abs() > limit_ma;
        wanted_ma.clamp(-limit_ma, limit_ma)
    }

    /// Newton, in currents.
    fn turn(&mut self, current_ma: f64, motor: &Motor, mechanics: &Mechanics, dt_s: f64) {
        self.current_ma = current_ma;
        let driving_ma = current_ma - mechanics.load_ma;
        if self.rotor_qc_s == 0.0 {
            // It starts only where the motor drives it, never where the load pushes it.
            let breaks_loose =
                driving_ma.abs() > motor.friction_ma && driving_ma * current_ma > 0.0;
            if !breaks_loose {
                return;
            }
        }
        let moving = if self.rotor_qc_s == 0.0 {
            driving_ma
        } else {
            self.rotor_qc_s
        };
        let acceleration_qc_s2 =
            (driving_ma - motor.friction_ma * moving.signum()) / motor.inertia_ma_s2_per_qc;
        let speed_qc_s = self.rotor_qc_s + acceleration_qc_s2 * dt_s;
        // Friction and a self-locking load can stop the shaft but not turn it round.
        let turns_round = speed_qc_s * self.rotor_qc_s < 0.0 && speed_qc_s * current_ma <= 0.0;
        self.rotor_qc_s = if turns_round { 0.0 } else { speed_qc_s };
        self.rotor_qc += self.rotor_qc_s * dt_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_S: f64 = 0.0004;

    fn run(shaft: &mut Shaft, order: Order, limit_ma: f64, mechanics: &Mechanics, time_s: f64) {
        for _ in 0..(time_s / CYCLE_S) as usize {
            shaft.cycle(
                order,
                limit_ma,
                &Motor::default(),
                (mechanics, Drivetrain::default()),
                CYCLE_S,
            );
        }
    }

    #[test]
    fn the_shaft_settles_on_the_demand_against_a_load() {
        let mut shaft = Shaft::default();
        let demand = Order::Follow(Trajectory::standing_at(300.0));
        run(
            &mut shaft,
            demand,
            1000.0,
            &Mechanics {
                load_ma: 150.0,
                ..Mechanics::default()
            },
            0.3,
        );
        assert!((shaft.position_qc - 300.0).abs() < SETTLED_QC, "{shaft:?}");
        assert_eq!((shaft.speed_qc_s, shaft.current_ma), (0.0, 150.0));
    }

    #[test]
    fn a_hard_stop_draws_the_current_limit() {
        let mut shaft = Shaft::default();
        let mechanics = Mechanics {
            hard_stop_high_qc: Some(500.0),
            ..Mechanics::default()
        };
        run(
            &mut shaft,
            Order::Follow(Trajectory::standing_at(5000.0)),
            300.0,
            &mechanics,
            0.3,
        );
        assert_eq!(
            (shaft.position_qc, shaft.speed_qc_s, shaft.current_ma),
            (500.0, 0.0, 300.0)
        );
        assert!(shaft.limited);
    }

    #[test]
    fn a_load_beyond_the_limit_stalls_but_never_drives_back() {
        let mut shaft = Shaft::default();
        let mechanics = Mechanics {
            load_ma: 400.0,
            ..Mechanics::default()
        };
        run(
            &mut shaft,
            Order::Follow(Trajectory::standing_at(1000.0)),
            300.0,
            &mechanics,
            0.5,
        );
        assert_eq!(shaft.position_qc, 0.0);
        run(&mut shaft, Order::Free, 300.0, &mechanics, 0.5);
        assert_eq!((shaft.position_qc, shaft.current_ma), (0.0, 0.0));
    }

    #[test]
    fn a_free_shaft_coasts_to_a_stand() {
        let mut shaft = Shaft {
            rotor_qc_s: 30_000.0,
            ..Shaft::default()
        };
        run(&mut shaft, Order::Free, 0.0, &Mechanics::default(), 1.0);
        // v² · inertia / 2 friction = 169 qc
        assert!((shaft.position_qc - 169.0).abs() < 8.0, "{shaft:?}");
        assert_eq!(shaft.speed_qc_s, 0.0);
    }
}
