//! The contract: messages and services generated from the `.proto` files beside this crate.
//!
//! The comments in the `.proto` files are the operators' manual (`grpcurl describe` prints them);
//! nothing here is written by hand.
#![allow(missing_docs, clippy::all, rustdoc::all)]

/// Every descriptor of the contract, for server reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/arthro.binpb"));

pub mod common {
    pub mod v1 {
        tonic::include_proto!("arthro.common.v1");
    }
}

pub mod registration {
    pub mod v1 {
        tonic::include_proto!("arthro.registration.v1");
    }
}

pub mod planning {
    pub mod v1 {
        tonic::include_proto!("arthro.planning.v1");
    }
}

pub mod motion {
    pub mod v1 {
        tonic::include_proto!("arthro.motion.v1");
    }
}

pub mod instrument {
    pub mod v1 {
        tonic::include_proto!("arthro.instrument.v1");
    }
}

pub mod gateway {
    pub mod v1 {
        tonic::include_proto!("arthro.gateway.v1");
    }
}

pub mod simulator {
    pub mod v1 {
        tonic::include_proto!("arthro.simulator.v1");
    }
}

/// Transforms and scenes as viewers of recordings know them.
pub mod foxglove {
    tonic::include_proto!("foxglove");
}
