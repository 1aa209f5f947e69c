//! Power, brakes and safety system: what the arm may do now, and the transitions between, which take their time.

use ur_link::{RobotMode, SafetyMode};

/// Time that must pass after a protective stop before it may be unlocked.
const UNLOCK_AFTER_S: f64 = 5.0;
/// From an accepted unlock to a normal safety mode.
const UNLOCK_TAKES_S: f64 = 0.5;
/// From an emergency stop to power off: the time that a stop of category 1 has to bring the arm to rest.
const EMERGENCY_STOP_S: f64 = 0.5;
/// From `restart safety` to power off with a normal safety mode.
const RESTART_S: f64 = 1.0;

/// Modes and the change under way.
#[derive(Clone, Debug)]
pub struct Power {
    /// Power and brakes.
    pub mode: RobotMode,
    now_s: f64,
    next_mode: Option<(f64, RobotMode)>,
    /// What `restart safety` clears.
    fault: Option<Breakdown>,
    restarted_at_s: Option<f64>,
    pressed: [bool; 2],
    safeguard: Safeguard,
    protective: Option<Protective>,
    boot_s: f64,
    brake_release_s: f64,
}

/// What takes the power away until the safety system is restarted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Breakdown {
    /// A safety limit was broken.
    Violation,
    /// The hardware failed.
    Fault,
}

/// The emergency stop buttons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// On the pendant.
    Robot,
    /// Anywhere else in the cell.
    System,
}

/// The safeguard input, such as a door.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Safeguard {
    /// Nothing there.
    Clear,
    /// The door is open.
    Open,
    /// The door is closed; somebody must press reset.
    AwaitsReset,
}

#[derive(Clone, Copy, Debug)]
struct Protective {
    since_s: f64,
    ends_at_s: Option<f64>,
}

/// What becomes of a program now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// It runs.
    Run,
    /// It waits where it is.
    Wait,
    /// It ends.
    End,
}

impl Power {
    /// In this mode, safety normal.
    pub fn new(mode: RobotMode, boot_s: f64, brake_release_s: f64) -> Self {
        Self {
            mode,
            now_s: 0.0,
            next_mode: None,
            fault: None,
            restarted_at_s: None,
            pressed: [false; 2],
            safeguard: Safeguard::Clear,
            protective: None,
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
        let is_over = |stop: &Protective| stop.ends_at_s.is_some_and(|end_s| now_s >= end_s);
        self.protective.take_if(|stop| is_over(stop));
        if self
            .restarted_at_s
            .take_if(|due_s| now_s >= *due_s)
            .is_some()
        {
            self.fault = None;
            self.protective = None;
        }
    }

    /// What the safety system reports: the gravest of what holds.
    pub fn safety(&self) -> SafetyMode {
        let [robot, system] = self.pressed;
        match self.fault {
            Some(Breakdown::Fault) => SafetyMode::Fault,
            Some(Breakdown::Violation) => SafetyMode::Violation,
            None if robot => SafetyMode::RobotEmergencyStop,
            None if system => SafetyMode::SystemEmergencyStop,
            None if self.protective.is_some() => SafetyMode::ProtectiveStop,
            None if self.safeguard != Safeguard::Clear => SafetyMode::SafeguardStop,
            None => SafetyMode::Normal,
        }
    }

    /// Programs may run and the arm may move.
    pub fn may_move(&self) -> bool {
        self.permission() == Permission::Run
    }

    /// What becomes of a program now.
    pub fn permission(&self) -> Permission {
        match self.safety() {
            SafetyMode::Normal if self.mode == RobotMode::Running => Permission::Run,
            SafetyMode::SafeguardStop if self.mode == RobotMode::Running => Permission::Wait,
            _ => Permission::End,
        }
    }

    /// `POWER_OFF` to `IDLE`. False when nothing can be powered now.
    pub fn power_on(&mut self) -> bool {
        match self.mode {
            RobotMode::PowerOff if self.safety() == SafetyMode::Normal => {
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
            RobotMode::Idle if self.safety() == SafetyMode::Normal => {
                if self.next_mode.is_none() {
                    self.next_mode = Some((self.now_s + self.brake_release_s, RobotMode::Running));
                }
                true
            }
            RobotMode::Running => true,
            _ => false,
        }
    }

    /// Stops the arm; further stops while one holds do not extend it. False when something graver holds.
    pub fn protective_stop(&mut self) -> bool {
        let begins = self.mode == RobotMode::Running
            && matches!(
                self.safety(),
                SafetyMode::Normal | SafetyMode::SafeguardStop
            );
        if begins {
            self.protective = Some(Protective {
                since_s: self.now_s,
                ends_at_s: None,
            });
        }
        begins
    }

    /// Begins to unlock a protective stop. False within 5 s of it.
    pub fn unlock(&mut self) -> bool {
        let now_s = self.now_s;
        match &mut self.protective {
            None => true,
            Some(stop) if now_s - stop.since_s < UNLOCK_AFTER_S => false,
            Some(stop) => {
                stop.ends_at_s.get_or_insert(now_s + UNLOCK_TAKES_S);
                true
            }
        }
    }

    /// Presses an emergency stop; the power goes once the arm had time to stop.
    pub fn press(&mut self, button: Button) {
        self.pressed[button as usize] = true;
        if self.mode != RobotMode::PowerOff {
            let due_s = self.now_s + EMERGENCY_STOP_S;
            match self.mode {
                RobotMode::Running => self.next_mode = Some((due_s, RobotMode::PowerOff)),
                _ => self.power_off(),
            }
        }
        // Without power there is nothing left to unlock.
        self.protective = None;
    }

    /// Pulls it out again. The arm stays without power.
    pub fn release(&mut self, button: Button) {
        self.pressed[button as usize] = false;
    }

    /// Which are pressed.
    pub fn is_pressed(&self, button: Button) -> bool {
        self.pressed[button as usize]
    }

    /// The safeguard input.
    pub fn safeguard(&self) -> Safeguard {
        self.safeguard
    }

    /// Opens the safeguard: programs wait.
    pub fn open_safeguard(&mut self) {
        self.safeguard = Safeguard::Open;
    }

    /// Closes it; the stop stays until it is reset.
    pub fn close_safeguard(&mut self) {
        if self.safeguard == Safeguard::Open {
            self.safeguard = Safeguard::AwaitsReset;
        }
    }

    /// Presses reset: a program that waited goes on. False while the safeguard is open.
    pub fn reset_safeguard(&mut self) -> bool {
        let closed = self.safeguard != Safeguard::Open;
        if closed {
            self.safeguard = Safeguard::Clear;
        }
        closed
    }

    /// Power off until the safety system is restarted.
    pub fn break_down(&mut self, breakdown: Breakdown) {
        self.fault.get_or_insert(breakdown);
        self.restarted_at_s = None;
        self.power_off();
    }

    /// `restart safety`: power off; after a while the safety mode is what its causes make it.
    pub fn restart_safety(&mut self) {
        self.power_off();
        self.restarted_at_s = Some(self.now_s + RESTART_S);
    }
}
