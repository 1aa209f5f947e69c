//! Hand-eye, tool tip and shaft axis against mountings that are known, with the noise of a real arm and camera.

mod board;
mod hand_eye;
mod monte_carlo;
mod service;
mod shaft_axis;
mod tool_tip;
mod world;

use arthro_registration::calibration::gate::Reason;
use arthro_registration::error::Error;

/// The gates that an answer did not pass.
fn reasons<T: std::fmt::Debug>(outcome: Result<T, Error>) -> Vec<Reason> {
    match outcome {
        Err(Error::Refused(refusals)) => {
            refusals.into_iter().map(|refusal| refusal.reason).collect()
        }
        other => panic!("was not refused: {other:?}"),
    }
}

/// The fields that were found wrong.
fn fields<T: std::fmt::Debug>(outcome: Result<T, Error>) -> Vec<String> {
    match outcome {
        Err(Error::Invalid(violations)) => {
            violations.into_iter().map(|found| found.field).collect()
        }
        other => panic!("was not refused: {other:?}"),
    }
}
