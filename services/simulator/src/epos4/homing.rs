//! Homing mode: finds the reference by the configured method and gives the home point its position.
//!
//! A method is a sequence of legs. After the last one the shaft moves by the home offset distance (0x30B1) from where
//! the reference was found; the place reached is the home point and gets the home position (0x30B0).

use std::collections::VecDeque;

use super::inputs::{Inputs, Switch};
use super::parameters::{HomingParameters, Profile};
use super::shaft::Shaft;
use super::trajectory::{Progress, Trajectory};

/// A search, and how the last one ended.
#[derive(Clone, Debug, Default)]
pub struct Homing {
    status: Status,
    legs: VecDeque<Leg>,
    /// The switches that the method uses: while it runs they are no error.
    switches: Vec<Switch>,
    /// The shaft at the end of the last cycle: an index lies between two cycles.
    last_position_qc: f64,
    /// How long the current has been above the threshold, s.
    pressed_s: f64,
    /// The switch has been active while the shaft turned in the direction in which its edge counts.
    on_switch: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Status {
    #[default]
    Idle,
    Running,
    /// Slowing down after the start bit fell or the halt bit rose.
    Interrupting,
    Interrupted,
    Attained,
    Failed,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Leg {
    /// Fast, until the switch is active.
    ToSwitch(Direction, Switch),
    /// Slowly, until it is not any more. A switch that was run over is crossed again.
    OffSwitch(Direction, Switch),
    /// Fast, until the mechanism stops the motor.
    ToStop(Direction),
    /// Slowly, until the encoder's index.
    ToIndex(Direction),
    /// To the home point; true shaft. None until the reference is found.
    ToHomePoint(Option<f64>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Negative,
    Positive,
}

/// A current above the threshold counts as a stop after this time: acceleration peaks are shorter.
const PRESSED_S: f64 = 0.002;

impl Homing {
    /// Begins, on the rising edge of bit 4.
    pub fn start(&mut self, parameters: &HomingParameters, shaft: &Shaft) {
        let legs = legs(parameters.method);
        *self = Self {
            status: Status::Running,
            switches: legs.iter().flat_map(Leg::switches).copied().collect(),
            legs,
            last_position_qc: shaft.position_qc,
            pressed_s: 0.0,
            on_switch: false,
        };
    }

    /// The present position was taken without a search.
    pub fn attain(&mut self) {
        *self = Self {
            status: Status::Attained,
            ..Self::default()
        };
    }

    /// Ends a search on request.
    pub fn interrupt(&mut self) {
        if self.status == Status::Running {
            self.status = Status::Interrupting;
        }
    }

    /// Ends a search because of an error.
    pub fn fail(&mut self) {
        if matches!(self.status, Status::Running | Status::Interrupting) {
            self.status = Status::Failed;
        }
    }

    /// Whether the search under way needs this switch, so that it is no error.
    #[must_use]
    pub fn uses(&self, switch: Switch) -> bool {
        self.status == Status::Running && self.switches.contains(&switch)
    }

    /// One cycle; when the home point is reached, where the shaft stands at position 0 from now on. An encoder without
    /// index has no spacing of it: it is searched for ever.
    pub fn cycle(
        &mut self,
        trajectory: &mut Trajectory,
        shaft: &Shaft,
        inputs: Inputs,
        parameters: &HomingParameters,
        index_spacing_qc: Option<f64>,
        dt_s: f64,
    ) -> Option<f64> {
        let from_qc = std::mem::replace(&mut self.last_position_qc, shaft.position_qc);
        if self.status != Status::Running {
            let stopped =
                trajectory.towards_speed(0.0, parameters.switch_search, dt_s) == Progress::Arrived;
            if self.status == Status::Interrupting && stopped {
                self.status = Status::Interrupted;
            }
            return None;
        }
        let mut run = |direction: Direction, profile: Profile| {
            trajectory.towards_speed(direction.sign() * profile.speed_qc_s, profile, dt_s);
        };
        match *self.legs.front()? {
            Leg::ToSwitch(direction, switch) => {
                if inputs.finds(switch) {
                    self.legs.pop_front();
                } else if switch == Switch::Home && inputs.finds(direction.limit()) {
                    self.search_home_the_other_way(direction);
                } else {
                    run(direction, parameters.switch_search);
                }
            }
            Leg::OffSwitch(direction, switch) => {
                let active = inputs.finds(switch);
                if self.on_switch && !active {
                    // The first whole quadcount off the switch.
                    let edge_qc = direction.sign() * (direction.sign() * shaft.position_qc).ceil();
                    self.found(edge_qc, parameters);
                } else {
                    self.on_switch |= active && shaft.speed_qc_s * direction.sign() > 0.0;
                    run(direction, parameters.zero_search);
                }
            }
            Leg::ToStop(direction) => {
                let presses =
                    shaft.current_ma * direction.sign() >= parameters.current_threshold_ma;
                self.pressed_s = if presses { self.pressed_s + dt_s } else { 0.0 };
                if self.pressed_s >= PRESSED_S {
                    *trajectory = Trajectory::standing_at(shaft.position_qc);
                    self.found(shaft.position_qc, parameters);
                } else {
                    run(direction, parameters.switch_search);
                }
            }
            Leg::ToIndex(direction) => {
                match index_between(from_qc, shaft.position_qc, index_spacing_qc, direction) {
                    Some(index_qc) => self.found(index_qc, parameters),
                    None => run(direction, parameters.zero_search),
                }
            }
            Leg::ToHomePoint(target_qc) => {
                let home_qc = target_qc.unwrap_or(shaft.position_qc + parameters.offset_qc);
                self.legs[0] = Leg::ToHomePoint(Some(home_qc));
                if trajectory.towards_position(home_qc, parameters.switch_search, dt_s)
                    == Progress::Arrived
                {
                    self.legs.clear();
                    self.status = Status::Attained;
                    return Some(home_qc - parameters.position_qc);
                }
            }
        }
        None
    }

    /// Statusword bits 10, 12 and 13.
    #[must_use]
    pub fn status(&self) -> (bool, bool, bool) {
        match self.status {
            Status::Idle | Status::Running | Status::Interrupting => (false, false, false),
            Status::Interrupted => (true, false, false),
            Status::Attained => (true, true, false),
            Status::Failed => (false, false, true),
        }
    }

    /// The leg has its reference; it counts for the home point if nothing else is searched after it.
    fn found(&mut self, reference_qc: f64, parameters: &HomingParameters) {
        self.legs.pop_front();
        if let Some(leg @ Leg::ToHomePoint(_)) = self.legs.front_mut() {
            *leg = Leg::ToHomePoint(Some((reference_qc + parameters.offset_qc).round()));
        }
    }

    /// The end of the travel came before the home switch: it lies behind, and its same edge is left going back.
    fn search_home_the_other_way(&mut self, direction: Direction) {
        self.legs[0] = Leg::ToSwitch(direction.opposite(), Switch::Home);
    }
}

/// CiA 402 methods, and maxon's -1 to -4 by current threshold.
fn legs(method: i64) -> VecDeque<Leg> {
    use Direction::{Negative, Positive};
    use Switch::{Home, NegativeLimit, PositiveLimit};
    let mut legs: VecDeque<Leg> = match method {
        1 => [
            Leg::ToSwitch(Negative, NegativeLimit),
            Leg::OffSwitch(Positive, NegativeLimit),
            Leg::ToIndex(Positive),
        ]
        .into(),
        2 => [
            Leg::ToSwitch(Positive, PositiveLimit),
            Leg::OffSwitch(Negative, PositiveLimit),
            Leg::ToIndex(Negative),
        ]
        .into(),
        7 => [
            Leg::ToSwitch(Positive, Home),
            Leg::OffSwitch(Negative, Home),
            Leg::ToIndex(Negative),
        ]
        .into(),
        11 => [
            Leg::ToSwitch(Negative, Home),
            Leg::OffSwitch(Positive, Home),
            Leg::ToIndex(Positive),
        ]
        .into(),
        17 => [
            Leg::ToSwitch(Negative, NegativeLimit),
            Leg::OffSwitch(Positive, NegativeLimit),
        ]
        .into(),
        18 => [
            Leg::ToSwitch(Positive, PositiveLimit),
            Leg::OffSwitch(Negative, PositiveLimit),
        ]
        .into(),
        23 => [
            Leg::ToSwitch(Positive, Home),
            Leg::OffSwitch(Negative, Home),
        ]
        .into(),
        27 => [
            Leg::ToSwitch(Negative, Home),
            Leg::OffSwitch(Positive, Home),
        ]
        .into(),
        33 => [Leg::ToIndex(Negative)].into(),
        34 => [Leg::ToIndex(Positive)].into(),
        -1 => [Leg::ToStop(Positive), Leg::ToIndex(Negative)].into(),
        -2 => [Leg::ToStop(Negative), Leg::ToIndex(Positive)].into(),
        -3 => [Leg::ToStop(Positive)].into(),
        -4 => [Leg::ToStop(Negative)].into(),
        // 37: the present position.
        _ => VecDeque::new(),
    };
    legs.push_back(Leg::ToHomePoint(None));
    legs
}

impl Leg {
    /// The switches that may become active. On the way to a home switch the end of the travel may come first.
    fn switches(&self) -> &'static [Switch] {
        match self {
            Self::ToSwitch(_, Switch::Home) => {
                &[Switch::NegativeLimit, Switch::PositiveLimit, Switch::Home]
            }
            Self::ToSwitch(_, Switch::NegativeLimit) => &[Switch::NegativeLimit],
            Self::ToSwitch(_, Switch::PositiveLimit) => &[Switch::PositiveLimit],
            Self::OffSwitch(..) | Self::ToStop(_) | Self::ToIndex(_) | Self::ToHomePoint(_) => &[],
        }
    }
}

/// The encoder's index, once a motor turn, if the shaft passed one in this direction.
fn index_between(
    from_qc: f64,
    to_qc: f64,
    spacing_qc: Option<f64>,
    direction: Direction,
) -> Option<f64> {
    let spacing_qc = spacing_qc?;
    let (from, to) = (from_qc / spacing_qc, to_qc / spacing_qc);
    match direction {
        Direction::Positive if to.floor() > from.floor() => Some(to.floor() * spacing_qc),
        Direction::Negative if to.ceil() < from.ceil() => Some(to.ceil() * spacing_qc),
        _ => None,
    }
}

impl Direction {
    fn sign(self) -> f64 {
        match self {
            Self::Negative => -1.0,
            Self::Positive => 1.0,
        }
    }

    fn opposite(self) -> Self {
        match self {
            Self::Negative => Self::Positive,
            Self::Positive => Self::Negative,
        }
    }

    fn limit(self) -> Switch {
        match self {
            Self::Negative => Switch::NegativeLimit,
            Self::Positive => Switch::PositiveLimit,
        }
    }
}
