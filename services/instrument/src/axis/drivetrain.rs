//! From the motor's encoder to the axis: every conversion between quadcounts and mm or degrees.

use std::fmt;

/// Encoder, gear, belt, and the screw or turn that makes the axis' movement of it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Drivetrain {
    /// Four times the encoder's pulses.
    pub quadcounts_per_motor_turn: u32,
    /// Motor turns for one turn of the gear's output.
    pub gear: Ratio,
    /// Turns of the gear's output for one of the screw or of the rotation: the driven pulley's teeth over the driving
    /// pulley's.
    pub belt: Ratio,
    /// mm for one turn of the screw, its lead; 360 degrees for a rotation. Positive.
    pub travel_per_turn: f64,
    /// Whether the axis goes up while the encoder counts down.
    pub reversed: bool,
}

/// A ratio as a fraction, so that nothing is rounded before the end. Neither is 0.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ratio {
    /// Above.
    pub numerator: u32,
    /// Below.
    pub denominator: u32,
}

impl Drivetrain {
    /// Quadcounts for one mm or degree, signed.
    pub fn quadcounts_per_unit(&self) -> f64 {
        self.motor_turns_per_unit() * f64::from(self.quadcounts_per_motor_turn)
    }

    /// The encoder's count at a position, saturated at the range of the drive's objects.
    pub fn to_quadcounts(&self, position: f64) -> i32 {
        (position * self.quadcounts_per_unit()).round() as i32
    }

    /// The position at an encoder's count.
    pub fn to_position(&self, quadcounts: i32) -> f64 {
        f64::from(quadcounts) / self.quadcounts_per_unit()
    }

    /// A distance as a count without sign.
    pub fn to_quadcount_distance(&self, distance: f64) -> u32 {
        (distance * self.quadcounts_per_unit()).abs().round() as u32
    }

    /// Motor speed, rpm, for a speed of the axis, unit/s; or rpm/s for unit/s^2. At least 1, which is the drive's lowest.
    pub fn to_rpm(&self, per_second: f64) -> u32 {
        ((per_second * self.motor_turns_per_unit() * 60.0)
            .abs()
            .round() as u32)
            .max(1)
    }

    /// What the axis does in one turn of the motor, in its unit.
    pub fn travel_per_motor_turn(&self) -> f64 {
        self.motor_turns_per_unit().abs().recip()
    }

    /// Products first and one division last: the whole is rounded twice, to 1 part in 2^52.
    fn motor_turns_per_unit(&self) -> f64 {
        let [gear, belt] = [self.gear, self.belt];
        let above = f64::from(gear.numerator) * f64::from(belt.numerator);
        let below =
            f64::from(gear.denominator) * f64::from(belt.denominator) * self.travel_per_turn;
        let sign = if self.reversed { -1.0 } else { 1.0 };
        sign * above / below
    }
}

impl Ratio {
    /// Whether both are the same number, though not the same fraction.
    pub fn equals(self, other: Self) -> bool {
        u64::from(self.numerator) * u64::from(other.denominator)
            == u64::from(other.numerator) * u64::from(self.denominator)
    }
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.numerator, self.denominator)
    }
}
