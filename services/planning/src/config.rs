//! The section `planning` of the configuration.

use serde::{Deserialize, Serialize};

/// What can be set beside `server`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Plans and evaluations computed at the same time; others wait until their deadline.
    pub max_computations: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            max_computations: std::thread::available_parallelism().map_or(1, usize::from),
        }
    }
}
