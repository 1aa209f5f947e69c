//! What RTDE clients and programs write: registers, outputs, the speed slider; and the watchdogs over it.

use ur_link::rtde::wire::Value;

use super::{Robot, WatchdogAction};
use crate::ur5::registers::{Input, Outputs};

impl Robot {
    /// `rtde_set_watchdog`.
    pub fn set_watchdog(&mut self, input: Input, min_frequency_hz: f64, action: WatchdogAction) {
        let now_s = self.now_s();
        self.watchdogs
            .set(input, 1.0 / min_frequency_hz, now_s, action);
    }

    /// The action of a watchdog whose input was not written in time.
    pub fn watchdog_bite(&self) -> Option<WatchdogAction> {
        self.watchdogs.bite(self.now_s())
    }

    /// What an RTDE client writes; takes effect in the next cycle.
    pub fn write_input(&mut self, input: Input, value: Value) {
        self.watchdogs.feed(input, self.now_s());
        match (input, value) {
            (Input::Register(register), value) => register.write(&mut self.inputs, value),
            (Input::SpeedSliderMask, Value::UInt32(mask)) => self.slider_unlocked = mask & 1 == 1,
            (Input::SpeedSliderFraction, Value::Double(fraction))
                if self.slider_unlocked && fraction.is_finite() =>
            {
                self.speed_slider = fraction.clamp(0.0, 1.0);
            }
            (Input::OutputMask(group), Value::UInt8(mask)) => {
                self.output_masks[group as usize] = mask
            }
            (Input::Output(group), Value::UInt8(bits)) => {
                let mask = self.output_masks[group as usize];
                for bit in (0..group.count()).filter(|bit| mask >> bit & 1 == 1) {
                    self.set_output(group, bit, bits >> bit & 1 == 1);
                }
            }
            (Input::AnalogMask, Value::UInt8(mask)) => self.analog_mask = mask,
            (Input::AnalogType, Value::UInt8(volts)) => {
                let mask = self.analog_mask;
                self.analog_in_volts = self.analog_in_volts & !mask | volts & mask;
            }
            (Input::Analog(output), Value::Double(value))
                if self.analog_mask >> output & 1 == 1 && value.is_finite() =>
            {
                self.analog_outputs[output] = value.clamp(0.0, 1.0)
            }
            (Input::ExternalForceTorque, Value::Vector6D(wrench))
                if wrench.iter().all(|part| part.is_finite()) =>
            {
                self.external_wrench = wrench;
            }
            _ => {}
        }
    }

    /// Switches one digital output; numbers outside the group are left out.
    pub fn set_output(&mut self, group: Outputs, number: u32, on: bool) {
        if number < group.count() {
            let mask = 1 << (group.first_bit() + number);
            self.digital_outputs = if on {
                self.digital_outputs | mask
            } else {
                self.digital_outputs & !mask
            };
        }
    }
}
