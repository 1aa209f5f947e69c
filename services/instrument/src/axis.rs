//! The four axes of the paper: their units, travel, and the way from mm and degrees to the quadcounts of the motor's
//! encoder.

use std::fmt;

/// An axis by name.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Axis {
    /// Turns the jaw about the shaft.
    ForcepsRotation,
    /// Forward closes the jaw.
    ForcepsFeed,
    /// Turns the oblique view about the shaft.
    ArthroscopeRotation,
    /// Moves the arthroscope along its shaft.
    ArthroscopeFeed,
}

/// The unit of an axis' positions.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Unit {
    /// Rotation axes.
    Degree,
    /// Feed axes.
    Millimetre,
}

/// An axis as it is built. All positions, speeds and accelerations are in the axis' [`Unit`].
#[derive(Clone, PartialEq, Debug)]
pub struct AxisSpec {
    /// Which axis.
    pub axis: Axis,
    /// Its drive's number on the bus.
    pub node_id: u8,
    /// Where it may go.
    pub travel: Travel,
    /// From the motor to the axis.
    pub drivetrain: Drivetrain,
    /// Speed of moves, unit/s.
    pub speed: f64,
    /// Acceleration and deceleration of moves, unit/s^2.
    pub acceleration: f64,
    /// Deceleration of a quick stop, unit/s^2.
    pub quick_stop_deceleration: f64,
    /// What the drive may draw at most, mA.
    pub current_limit_ma: f64,
    /// How far the motor may lag behind its profile, in the axis' unit.
    pub following_error: f64,
    /// How near to its target a move must end, in the axis' unit.
    pub tolerance: f64,
}

/// The range of an axis.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Travel {
    /// Lowest position.
    pub lowest: f64,
    /// Highest position.
    pub highest: f64,
}

/// Encoder, gear, and what turns the gear's output into the axis' movement.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Drivetrain {
    /// Four times the encoder's pulses.
    pub quadcounts_per_motor_turn: u32,
    /// Motor turns for one of the gear's output, numerator.
    pub gear_numerator: u32,
    /// Denominator.
    pub gear_denominator: u32,
    /// mm (screw lead) or degrees (360 times the belt's ratio) for one turn of the gear's output. Negative where the
    /// motor turns the other way round.
    pub travel_per_gear_turn: f64,
}

/// A position that the axis cannot take.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum TargetError {
    /// NaN or infinite.
    #[error("{value} is not a position of {axis}")]
    NotFinite {
        /// Which axis.
        axis: Axis,
        /// As given.
        value: f64,
    },
    /// Too far.
    #[error("{value} {unit} is outside the travel of {axis}, {} to {} {unit}", .travel.lowest, .travel.highest)]
    OutsideTravel {
        /// Which axis.
        axis: Axis,
        /// As given.
        value: f64,
        /// The limits.
        travel: Travel,
        /// Of all three.
        unit: Unit,
    },
}

// === impl Axis ===

impl Axis {
    /// All axes, in the order of the proto.
    pub const ALL: [Self; 4] = [
        Self::ForcepsRotation,
        Self::ForcepsFeed,
        Self::ArthroscopeRotation,
        Self::ArthroscopeFeed,
    ];

    /// Its unit.
    pub const fn unit(self) -> Unit {
        match self {
            Self::ForcepsRotation | Self::ArthroscopeRotation => Unit::Degree,
            Self::ForcepsFeed | Self::ArthroscopeFeed => Unit::Millimetre,
        }
    }

    /// Its place in [`Axis::ALL`].
    pub const fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ForcepsRotation => "forceps_rotation",
            Self::ForcepsFeed => "forceps_feed",
            Self::ArthroscopeRotation => "arthroscope_rotation",
            Self::ArthroscopeFeed => "arthroscope_feed",
        })
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Degree => "deg",
            Self::Millimetre => "mm",
        })
    }
}

// === impl AxisSpec ===

impl AxisSpec {
    /// The position, if the axis may go there.
    pub fn check_target(&self, value: f64) -> Result<f64, TargetError> {
        let axis = self.axis;
        if !value.is_finite() {
            return Err(TargetError::NotFinite { axis, value });
        }
        if value < self.travel.lowest || value > self.travel.highest {
            return Err(TargetError::OutsideTravel {
                axis,
                value,
                travel: self.travel,
                unit: axis.unit(),
            });
        }
        Ok(value)
    }

    /// How long a move over this distance takes with the trapezoidal profile, s.
    pub fn move_duration_s(&self, distance: f64, speed: f64) -> f64 {
        let distance = distance.abs();
        // Below this distance the speed is never reached.
        if distance < speed * speed / self.acceleration {
            2.0 * (distance / self.acceleration).sqrt()
        } else {
            distance / speed + speed / self.acceleration
        }
    }
}

impl Travel {
    /// From end to end.
    pub fn span(&self) -> f64 {
        self.highest - self.lowest
    }
}

// === impl Drivetrain ===

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

    fn motor_turns_per_unit(&self) -> f64 {
        f64::from(self.gear_numerator)
            / f64::from(self.gear_denominator)
            / self.travel_per_gear_turn
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::config::Config;

    fn spec(axis: Axis) -> AxisSpec {
        Config::default().check().unwrap().axes[axis.index()]
            .spec
            .clone()
    }

    #[test]
    fn the_counts_are_those_of_the_papers_gear_and_encoder() {
        let feed = spec(Axis::ForcepsFeed).drivetrain;
        assert_eq!(feed.to_quadcounts(1.0), 21_504);
        assert_eq!(feed.to_quadcounts(14.0), 301_056);
        let rotation = spec(Axis::ArthroscopeRotation).drivetrain;
        assert_eq!(rotation.to_quadcounts(-45.0), -5_376);
        assert_eq!(rotation.to_quadcounts(180.0), 21_504);
        assert!((rotation.quadcounts_per_unit() - 119.4667).abs() < 1e-4);
        // 1 mm/s is half a turn of the screw, 10.5 of the motor.
        assert_eq!(feed.to_rpm(1.0), 630);
    }

    #[test]
    fn a_target_outside_of_the_travel_is_named_with_the_limits() {
        let error = spec(Axis::ForcepsFeed).check_target(14.001).unwrap_err();
        assert_eq!(
            error.to_string(),
            "14.001 mm is outside the travel of forceps_feed, -1 to 14 mm"
        );
        assert_eq!(spec(Axis::ForcepsFeed).check_target(14.0), Ok(14.0));
        assert_eq!(
            spec(Axis::ArthroscopeRotation).check_target(-45.0),
            Ok(-45.0)
        );
        for value in [f64::NAN, f64::INFINITY] {
            let error = spec(Axis::ForcepsRotation).check_target(value).unwrap_err();
            assert!(matches!(error, TargetError::NotFinite { .. }));
        }
    }

    #[test]
    fn a_reversed_motor_counts_down() {
        let mut feed = spec(Axis::ForcepsFeed).drivetrain;
        feed.travel_per_gear_turn = -2.0;
        assert_eq!(feed.to_quadcounts(1.0), -21_504);
        assert_eq!(feed.to_rpm(1.0), 630);
    }

    #[test]
    fn a_short_move_does_not_reach_its_speed() {
        let mut spec = spec(Axis::ForcepsFeed);
        spec.acceleration = 10.0;
        assert!((spec.move_duration_s(-10.0, 5.0) - 2.5).abs() < 1e-12);
        assert!((spec.move_duration_s(0.1, 5.0) - 0.2).abs() < 1e-12);
        assert_eq!(spec.move_duration_s(0.0, 5.0), 0.0);
    }

    proptest! {
        #[test]
        fn a_position_survives_the_counts_to_half_a_count(position in -1.0..14.0) {
            let feed = spec(Axis::ForcepsFeed).drivetrain;
            let back = feed.to_position(feed.to_quadcounts(position));
            prop_assert!((back - position).abs() <= 0.5 / 21_504.0 + 1e-12);
        }
    }
}
