//! The four axes of the paper: their units, travel, and the way from mm and degrees to the quadcounts of the motor's
//! encoder.

mod drivetrain;

use std::fmt;

pub use self::drivetrain::{Drivetrain, Ratio};

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

    /// Whether its feed closes the jaw.
    pub const fn closes_jaw(self) -> bool {
        matches!(self, Self::ForcepsFeed)
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
        feed.reversed = true;
        assert_eq!(feed.to_quadcounts(1.0), -21_504);
        assert_eq!(feed.to_position(-21_504), 1.0);
        assert_eq!(feed.to_rpm(1.0), 630);
    }

    #[test]
    fn a_belt_multiplies_the_gear() {
        let mut rotation = spec(Axis::ForcepsRotation).drivetrain;
        // 40 teeth on the shaft, 16 on the gear.
        rotation.belt = Ratio {
            numerator: 40,
            denominator: 16,
        };
        assert_eq!(rotation.to_quadcounts(360.0), 43_008 * 5 / 2);
        let same = Ratio {
            numerator: 5,
            denominator: 2,
        };
        assert!(rotation.belt.equals(same) && !rotation.gear.equals(same));
    }

    #[test]
    fn a_short_move_does_not_reach_its_speed() {
        let mut spec = spec(Axis::ForcepsFeed);
        spec.acceleration = 10.0;
        assert!((spec.move_duration_s(-10.0, 5.0) - 2.5).abs() < 1e-12);
        assert!((spec.move_duration_s(0.1, 5.0) - 0.2).abs() < 1e-12);
        assert_eq!(spec.move_duration_s(0.0, 5.0), 0.0);
    }

    fn ratios() -> impl Strategy<Value = Ratio> {
        (1..5000_u32, 1..500_u32).prop_map(|(numerator, denominator)| Ratio {
            numerator,
            denominator,
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        /// Against whole numbers: leads and positions in um or 1e-3 degrees.
        #[test]
        fn a_conversion_is_right_to_one_quadcount_over_the_whole_travel(
            gear in ratios(),
            belt in ratios(),
            pulses in 16..100_000_u32,
            lead in prop_oneof![Just(360_000_i64), 100..20_000_i64],
            share in -1.0..1.0_f64,
            reversed: bool,
        ) {
            let drivetrain = Drivetrain {
                quadcounts_per_motor_turn: 4 * pulses,
                gear,
                belt,
                travel_per_turn: lead as f64 / 1000.0,
                reversed,
            };
            let farthest = f64::from(i32::MAX) / 2.0 / drivetrain.quadcounts_per_unit().abs();
            let position = (share * farthest.min(400.0) * 1000.0).round() as i64;
            let above = i128::from(position)
                * i128::from(4 * pulses)
                * i128::from(gear.numerator)
                * i128::from(belt.numerator);
            let below = i128::from(gear.denominator) * i128::from(belt.denominator) * i128::from(lead);
            let exact = above / below * if reversed { -1 } else { 1 };
            let counts = drivetrain.to_quadcounts(position as f64 / 1000.0);
            prop_assert!((i128::from(counts) - exact).abs() <= 1, "{} {}", counts, exact);
            prop_assert_eq!(drivetrain.to_quadcounts(drivetrain.to_position(counts)), counts);
        }

        /// Whatever is asked of an axis: what is accepted lies within the travel, and within the drive's own limits.
        #[test]
        fn no_target_beyond_the_travel_reaches_the_drive(
            lowest in -400.0..400.0_f64,
            span in 0.001..800.0_f64,
            gear in ratios(),
            reversed: bool,
            asked in prop::collection::vec(prop_oneof![-1500.0..1500.0_f64, any::<f64>()], 20),
        ) {
            let mut spec = spec(Axis::ForcepsFeed);
            spec.travel = Travel { lowest, highest: lowest + span };
            spec.drivetrain.gear = gear;
            spec.drivetrain.reversed = reversed;
            let within = crate::check::position_limits(&spec);
            let ends = [lowest, lowest + span].map(|end| spec.drivetrain.to_quadcounts(end));
            let sent = asked
                .iter()
                .filter_map(|target| spec.check_target(*target).ok())
                .map(|target| spec.drivetrain.to_quadcounts(target));
            for target in sent {
                prop_assert!((ends[0].min(ends[1])..=ends[0].max(ends[1])).contains(&target));
                prop_assert!((within[0]..=within[1]).contains(&target));
            }
        }

        #[test]
        fn a_position_survives_the_counts_to_half_a_count(position in -1.0..14.0) {
            let feed = spec(Axis::ForcepsFeed).drivetrain;
            let back = feed.to_position(feed.to_quadcounts(position));
            prop_assert!((back - position).abs() <= 0.5 / 21_504.0 + 1e-12);
        }
    }
}
