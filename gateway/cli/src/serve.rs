//! `arthro serve NAME`: any service from the one binary.

use std::ffi::OsString;
use std::process::ExitCode;

use arthro_bootstrap::{Service as _, run as serve};

use crate::arguments::{Serve, ServiceName};

/// Runs a service in the foreground until it drains.
pub fn run(arguments: Serve) -> ExitCode {
    let name = arguments.service;
    let flags = std::iter::once(OsString::from(format!("arthro serve {}", name.as_str())))
        .chain(arguments.flags);
    match name {
        ServiceName::Registration => serve::<arthro_registration::Server>(flags),
        ServiceName::Planning => serve::<arthro_planning::Server>(flags),
        ServiceName::Motion => serve::<arthro_motion::Server>(flags),
        ServiceName::Instrument => serve::<arthro_instrument::Server>(flags),
        ServiceName::Simulator => serve::<arthro_simulator::Server>(flags),
        ServiceName::Gateway => serve::<arthro_gateway::Server>(flags),
    }
    .into()
}

impl ServiceName {
    /// As in the configuration file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Registration => "registration",
            Self::Planning => "planning",
            Self::Motion => "motion",
            Self::Instrument => "instrument",
            Self::Simulator => "simulator",
            Self::Gateway => "gateway",
        }
    }

    /// The port of the documentation.
    pub fn standard_port(self) -> u16 {
        match self {
            Self::Registration => arthro_registration::Server::DEFAULT_PORT,
            Self::Planning => arthro_planning::Server::DEFAULT_PORT,
            Self::Motion => arthro_motion::Server::DEFAULT_PORT,
            Self::Instrument => arthro_instrument::Server::DEFAULT_PORT,
            Self::Simulator => arthro_simulator::Server::DEFAULT_PORT,
            Self::Gateway => arthro_gateway::Server::DEFAULT_PORT,
        }
    }
}
