//! Power, brakes and safety system: what the arm may do now, and the transitions between, which take their time.

use ur_link::{RobotMode, SafetyMode};

/// Cycles that must pass after a protective stop before it may be unlocked: 5 s.
const UNLOCK_AFTER_S: f64 = 5.0;
/// From an accepted unlock to a normal safety mode.
const UNLOCK_TAKES_S: f64 = 0.5;

/// Modes and the change under way.
#[derive(Clone, Debug)]
pub struct Power {
    /// Power and brakes.
    pub mode: RobotMode,
    /// Safety system.
    pub safety: SafetyMode,
    now_s: f64,
    next_mode: Option<(f64, RobotMode)>,
    stopped_at_s: f64,
    unlocked_at_s: Option<f64>,
    boot_s: f64,
    brake_release_s: f64,
}

impl Power {
    /// In this mode, safety normal.
    pub fn new(mode: RobotMode, boot_s: f64, brake_release_s: f64) -> Self {
        Self {
            mode,
            safety: SafetyMode::Normal,
            now_s: 0.0,
            next_mode: None,
            stopped_at_s: 0.0,
            unlocked_at_s: None,
            boot_s,
            brake_release_s,
        }
    }

    /// Time goes on.
    pub fn tick(&mut self, now_s: f64) {
        self.now_s = now_s;
        if let Some((due_s, mode)) = self.next_mode
            && now_s >= due_s
        {
            self.mode = mode;
            self.next_mode = match mode {
                RobotMode::PowerOn => Some((now_s + 0.5 * self.boot_s, RobotMode::Idle)),
                _ => None,
            };
        }
        if self.unlocked_at_s.is_some_and(|due_s| now_s >= due_s) {
            self.unlocked_at_s = None;
            self.safety = SafetyMode::Normal;
        }
    }

    /// Programs may run and the arm may move.
    pub fn may_move(&self) -> bool {
        self.mode == RobotMode::Running && self.safety.allows_motion()
    }

    /// `POWER_OFF` to `IDLE`. False when the arm has power, or nothing can be powered now.
    pub fn power_on(&mut self) -> bool {
        match self.mode {
            RobotMode::PowerOff if self.safety == SafetyMode::Normal => {
                if self.next_mode.is_none() {
                    self.next_mode = Some((self.now_s + 0.5 * self.boot_s, RobotMode::PowerOn));
                }
                true
            }
            RobotMode::PowerOn | RobotMode::Idle | RobotMode::Running => true,
            _ => false,
        }
    }

    /// Brakes on at once, power off.
    pub fn power_off(&mut self) {
        self.mode = RobotMode::PowerOff;
        self.next_mode = None;
    }

    /// `IDLE` to `RUNNING`. False when there is no power.
    pub fn release_brakes(&mut self) -> bool {
        match self.mode {
            RobotMode::Idle if self.safety == SafetyMode::Normal => {
                if self.next_mode.is_none() {
                    self.next_mode = Some((self.now_s + self.brake_release_s, RobotMode::Running));
                }
                true
            }
            RobotMode::Running => true,
            _ => false,
        }
    }

    /// Stops the arm; further stops while one holds do not extend it.
    pub fn protective_stop(&mut self) {
        if self.safety.allows_motion() {
            self.safety = SafetyMode::ProtectiveStop;
            self.stopped_at_s = self.now_s;
            self.unlocked_at_s = None;
        }
    }

    /// Begins to unlock a protective stop. False within 5 s of it.
    pub fn unlock(&mut self) -> bool {
        if self.safety != SafetyMode::ProtectiveStop {
            return true;
        }
        if self.now_s - self.stopped_at_s < UNLOCK_AFTER_S {
            return false;
        }
        self.unlocked_at_s
            .get_or_insert(self.now_s + UNLOCK_TAKES_S);
        true
    }
}
