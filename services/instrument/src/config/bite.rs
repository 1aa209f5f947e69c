//! The bite: where the jaw is open and closed, how it is felt, and what it presses with.

use serde::{Deserialize, Serialize};

use super::{ConfigError, bad, within};
use crate::axis::{AxisSpec, Travel};
use crate::bite::contact::ContactSpec;
use crate::bite::{BiteSpec, Blades, Press};
use crate::force::ForceTable;

/// The bite of the forceps feed.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BiteConfig {
    /// Where the jaw is open, mm.
    pub open_mm: f64,
    /// Where the empty blades touch, mm.
    pub closed_mm: f64,
    /// How far before that the jaw counts as closed on what is between its blades, mm.
    pub closed_tolerance_mm: f64,
    /// Closing speed, mm/s.
    pub speed_mm_s: f64,
    /// Speed from contact on, and where the blades are about to touch, mm/s. The faster, the more the motor's momentum
    /// presses beyond what the current does.
    pub press_speed_mm_s: f64,
    /// How far before the blades touch the jaw becomes slow, mm.
    pub press_from_mm: f64,
    /// The highest current of a bite, mA.
    pub current_limit_ma: f64,
    /// A current below this while closing is no contact, mA.
    pub contact_current_ma: f64,
    /// Nor is one that is not this much above the current of the free jaw, mA.
    pub contact_rise_ma: f64,
    /// How far the current of the free jaw is learnt for, from where the motor has its speed, mm.
    pub free_running_mm: f64,
    /// What the jaw's spring adds to that current, mA/mm.
    pub spring_ma_per_mm: f64,
    /// How much the current rises over the last 0.2 mm when blade meets blade, at least, mA; 0: it is not looked for, and
    /// a slipping belt passes for a closed jaw.
    pub blades_touch_current_ma: f64,
    /// How far the feed presses on to feel it, mm.
    pub blades_touch_mm: f64,
    /// What the jaw presses with: pairs of current, mA, and force, N, both rising, as measured, friction included.
    /// Empty: not measured; no force can be asked for and none is told.
    pub force_table: Vec<[f64; 2]>,
}

impl Default for BiteConfig {
    fn default() -> Self {
        Self {
            open_mm: 0.0,
            closed_mm: 10.0,
            closed_tolerance_mm: 0.3,
            speed_mm_s: 5.0,
            press_speed_mm_s: 0.8,
            press_from_mm: 0.4,
            current_limit_ma: 500.0,
            contact_current_ma: 120.0,
            contact_rise_ma: 40.0,
            free_running_mm: 1.0,
            spring_ma_per_mm: 0.0,
            blades_touch_current_ma: 90.0,
            blades_touch_mm: 0.1,
            force_table: Vec::new(),
        }
    }
}

impl BiteConfig {
    pub(super) fn check(&self, feed: &AxisSpec) -> Result<BiteSpec, ConfigError> {
        let Travel { lowest, highest } = feed.travel;
        let positive = f64::MIN_POSITIVE;
        let open_mm = within("bite.open_mm", self.open_mm, lowest, highest)?;
        let closed_mm = within("bite.closed_mm", self.closed_mm, open_mm, highest)?;
        let stroke_mm = closed_mm - open_mm;
        let current_limit_ma = within(
            "bite.current_limit_ma",
            self.current_limit_ma,
            1.0,
            feed.current_limit_ma,
        )?;
        let contact = ContactSpec {
            current_ma: within(
                "bite.contact_current_ma",
                self.contact_current_ma,
                1.0,
                current_limit_ma,
            )?,
            rise_ma: within(
                "bite.contact_rise_ma",
                self.contact_rise_ma,
                10.0,
                current_limit_ma,
            )?,
            free_running_mm: within(
                "bite.free_running_mm",
                self.free_running_mm,
                positive,
                stroke_mm,
            )?,
            spring_ma_per_mm: within("bite.spring_ma_per_mm", self.spring_ma_per_mm, 0.0, 1e3)?,
            speed_mm_s: within("bite.speed_mm_s", self.speed_mm_s, positive, feed.speed)?,
            acceleration_mm_s2: feed.acceleration,
        };
        let press = Press {
            speed_mm_s: within(
                "bite.press_speed_mm_s",
                self.press_speed_mm_s,
                0.05,
                contact.speed_mm_s,
            )?,
            from_mm: within("bite.press_from_mm", self.press_from_mm, 0.0, stroke_mm)?,
            deceleration_mm_s2: feed.quick_stop_deceleration,
        };
        let blades_ma = within(
            "bite.blades_touch_current_ma",
            self.blades_touch_current_ma,
            0.0,
            current_limit_ma,
        )?;
        let blades = (blades_ma > 0.0).then_some(Blades {
            current_ma: blades_ma,
            overtravel_mm: within(
                "bite.blades_touch_mm",
                self.blades_touch_mm,
                0.0,
                highest - closed_mm,
            )?,
        });
        let force = match self.force_table.as_slice() {
            [] => None,
            points => Some(
                ForceTable::new(points.to_vec())
                    .map_err(|error| bad("bite.force_table", error.to_string()))?,
            ),
        };
        Ok(BiteSpec {
            open_mm,
            closed_mm,
            closed_tolerance_mm: within(
                "bite.closed_tolerance_mm",
                self.closed_tolerance_mm,
                0.0,
                stroke_mm,
            )?,
            current_limit_ma,
            contact,
            press,
            blades,
            force,
        })
    }
}
