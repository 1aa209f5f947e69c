//! Everything that can go wrong in the simulated cell, and how it is told over gRPC.

use std::net::SocketAddr;
use std::path::PathBuf;

use arthro_geometry::ply;

use crate::scenario::crescent::NotACrescent;

/// Why the cell could not be built or a question not be answered.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The given surface cannot be laid into a knee.
    #[error("the model is not a meniscus")]
    Model(#[from] NotACrescent),
    /// A file could not be read or written.
    #[error("cannot access {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// A surface file was refused.
    #[error("cannot read {}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: ply::Error,
    },
    /// The scenario file was refused.
    #[error("cannot read {}", path.display())]
    ScenarioText {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        source: Box<toml::de::Error>,
    },
    /// The scenario could not be put into words.
    #[error("cannot write the scenario")]
    ScenarioValue(#[from] toml::ser::Error),
    /// A number of the configuration is out of its range.
    #[error("{field} is {value}, must be {limit}")]
    Config {
        /// Where in the configuration.
        field: &'static str,
        /// What stands there.
        value: String,
        /// What may stand there.
        limit: &'static str,
    },
    /// A number of an arm is out of its range.
    #[error("simulated arm: {0}")]
    Arm(#[from] crate::ur5::OutOfRange),
    /// An address is taken or not this machine's.
    #[error("cannot listen on {address}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        #[source]
        source: std::io::Error,
    },
}
