//! The I2t models of motor and power stage: heat that current brings and time takes away.

use super::parameters::Parameters;

/// How warm motor and power stage are, 1 being what their nominal current holds for ever.
#[derive(Clone, Copy, Debug, Default)]
pub struct Thermal {
    motor: f64,
    power_stage: f64,
    limiting: bool,
}

/// The power stage's continuous current: that of the drive.
const POWER_STAGE_NOMINAL_MA: f64 = 1500.0;
/// The power stage's time constant; assumed.
const POWER_STAGE_S: f64 = 4.0;
/// Below this level the limit is lifted again; assumed.
const LIFTED_BELOW: f64 = 0.95;
/// The highest level shown, %.
const LEVEL_MAX_PERCENT: f64 = 200.0;

impl Thermal {
    /// One cycle with this current.
    pub fn cycle(&mut self, current_ma: f64, parameters: &Parameters, dt_s: f64) {
        let warm = |level: &mut f64, nominal_ma: f64, time_constant_s: f64| {
            let load = (current_ma / nominal_ma.max(1.0)).powi(2);
            *level += (load - *level) * (dt_s / time_constant_s.max(dt_s));
        };
        warm(
            &mut self.motor,
            parameters.nominal_current_ma,
            parameters.thermal_time_constant_s,
        );
        warm(&mut self.power_stage, POWER_STAGE_NOMINAL_MA, POWER_STAGE_S);
        let highest = self.motor.max(self.power_stage);
        self.limiting = highest >= if self.limiting { LIFTED_BELOW } else { 1.0 };
    }

    /// What the motor may draw now.
    #[must_use]
    pub fn limit_ma(&self, parameters: &Parameters) -> f64 {
        if self.limiting {
            parameters
                .current_limit_ma
                .min(parameters.nominal_current_ma)
        } else {
            parameters.current_limit_ma
        }
    }

    /// Whether current is cut to the nominal one.
    #[must_use]
    pub fn limits(&self) -> bool {
        self.limiting
    }

    /// Objects 0x3200:01 and :02, %.
    #[must_use]
    pub fn levels_percent(&self) -> [i64; 2] {
        [self.motor, self.power_stage].map(|level| (level * 100.0).min(LEVEL_MAX_PERCENT) as i64)
    }

    /// Makes the motor as warm as this, %.
    pub fn heat_motor(&mut self, level_percent: f64) {
        self.motor = level_percent / 100.0;
    }
}
