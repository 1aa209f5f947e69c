//! Configuration of the registration server.

use serde::{Deserialize, Serialize};

/// Fields of the section `registration` beside `server`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Computations at the same time; further calls are refused with TOO_MANY_COMPUTATIONS. Bounds memory: one
    /// holds up to 100 MB of points, or 256 MiB of voxels and 500 MB of the surface being made of them.
    pub max_computations: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            max_computations: 8,
        }
    }
}
