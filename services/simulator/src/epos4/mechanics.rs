//! What stands around one drive: the mechanism that its shaft turns, and what is wired to its inputs.

/// Pins of the drive.
pub const INPUT_COUNT: usize = epos4_link::objects::INPUT_COUNT as usize;

/// What the mechanism does to one drive during a step of the cell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mechanics {
    /// Current that the mechanism demands at the present position, mA. Positive pushes the shaft towards negative
    /// positions.
    pub load_ma: f64,
    /// The part of the load that acts at the tool, N: between the blades of a jaw. For whoever asks for the truth; the
    /// drive does not know.
    pub tool_force_n: f64,
    /// Where the mechanism is stopped, quadcounts of the true shaft.
    pub hard_stop_low_qc: Option<f64>,
    /// Likewise at the other end.
    pub hard_stop_high_qc: Option<f64>,
    /// What is wired to digital inputs 1 to 8. From the factory the first three are the negative limit switch, the
    /// positive one and the home switch.
    pub inputs: [Input; INPUT_COUNT],
}

/// A switch or sensor and its wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Input {
    /// Whether the mechanism stands at it.
    pub actuated: bool,
    /// What that does to the level.
    pub contact: Contact,
    /// Nothing arrives at the pin any more.
    pub cut: bool,
}

/// How a switch is built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Contact {
    /// High when actuated.
    #[default]
    NormallyOpen,
    /// Low when actuated: a cut wire looks the same.
    NormallyClosed,
}

impl Input {
    /// A switch of this kind.
    #[must_use]
    pub fn new(contact: Contact, actuated: bool) -> Self {
        Self {
            actuated,
            contact,
            cut: false,
        }
    }

    /// The level at the pin: an open one is low.
    #[must_use]
    pub fn level(self) -> bool {
        !self.cut && (self.actuated != (self.contact == Contact::NormallyClosed))
    }
}

impl Mechanics {
    /// Levels of the pins, pin n in bit n-1, before polarity: object 0x3141:01.
    #[must_use]
    pub fn levels(&self) -> u16 {
        (0..).zip(self.inputs).fold(0, |levels, (pin, input)| {
            levels | u16::from(input.level()) << pin
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_wire_reads_as_an_actuated_normally_closed_switch_and_as_a_free_normally_open_one() {
        for (contact, free, actuated) in [
            (Contact::NormallyOpen, false, true),
            (Contact::NormallyClosed, true, false),
        ] {
            let switch = Input::new(contact, false);
            let cut = Input {
                cut: true,
                ..switch
            };
            assert_eq!(switch.level(), free);
            assert_eq!(Input::new(contact, true).level(), actuated);
            assert!(!cut.level());
        }
    }
}
