//! Loopback addresses for the simulated controllers.
//!
//! Foreign UR clients have the controllers' ports fixed, so two arms need two addresses, and any
//! number of cells beside each other need pairs of their own.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};

use crate::cell::Ports;
use crate::exit::{Failure, Kind};

/// Ports that a UR controller listens on.
const CONTROLLER_PORTS: [u16; 8] = [
    29_999, 30_001, 30_002, 30_003, 30_004, 30_011, 30_012, 30_013,
];

/// Addresses of the forceps' and the arthroscope's controller.
pub fn arms(ports: Ports) -> Result<[IpAddr; 2], Failure> {
    let pair = |second: u8, third: u8| {
        [11, 12].map(|last| IpAddr::V4(Ipv4Addr::new(127, second, third, last)))
    };
    if ports == Ports::Standard {
        return Ok(pair(0, 0));
    }
    // Starting at the process id keeps cells that start together apart.
    let first = std::process::id();
    (0..64_000)
        .map(|step| first.wrapping_mul(251).wrapping_add(step) % 64_000)
        .map(|number| pair(1 + (number / 256) as u8, (number % 256) as u8))
        .find(|pair| pair.iter().all(is_free))
        .ok_or_else(|| {
            Failure::new(
                Kind::Failed,
                "NO_FREE_LOOPBACK_ADDRESS",
                "no pair of loopback addresses has its UR ports free",
            )
        })
}

fn is_free(address: &IpAddr) -> bool {
    CONTROLLER_PORTS
        .iter()
        .all(|port| TcpListener::bind(SocketAddr::new(*address, *port)).is_ok())
}
