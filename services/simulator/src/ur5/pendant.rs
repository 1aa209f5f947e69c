//! What a person at the teach pendant has set, as far as clients can see it.

use serde::{Deserialize, Serialize};

/// Who may command an e-Series controller over the network. CB3 knows no difference.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// Clients.
    #[default]
    Remote,
    /// The person at the pendant: programs from clients and most dashboard commands are refused.
    Local,
}

/// Operational mode of an e-Series controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperationalMode {
    /// Programs are made.
    Manual,
    /// Programs run.
    Automatic,
}

impl OperationalMode {
    /// From the word of the dashboard, in either case.
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Manual, Self::Automatic]
            .into_iter()
            .find(|mode| mode.word().eq_ignore_ascii_case(word))
    }

    /// The word of the dashboard.
    pub fn word(self) -> &'static str {
        match self {
            Self::Manual => "MANUAL",
            Self::Automatic => "AUTOMATIC",
        }
    }
}

/// The pendant.
#[derive(Clone, Debug)]
pub struct Pendant {
    /// Who may command.
    pub control: Control,
    /// None while no client or password controls it.
    pub operational: Option<OperationalMode>,
    /// Role of the user, CB3 only.
    pub role: &'static str,
}

impl Pendant {
    /// Roles of a CB3.
    pub const ROLES: [&'static str; 5] = ["PROGRAMMER", "OPERATOR", "NONE", "LOCKED", "RESTRICTED"];

    /// As after the start.
    pub fn new(control: Control) -> Self {
        Self {
            control,
            operational: None,
            role: "NONE",
        }
    }
}
