//! The factory calibration of one arm, from its controller's primary interface to the lines of a configuration.

use std::time::Duration;

use arthro_motion::kinematics::dh::Dh;
use serde_json::json;
use ur_link::primary::{Message, Notice, Primary};
use ur_link::rtde::ControllerVersion;
use ur_link::{Calibration, Model};

use super::{place, unreachable};
use crate::arguments::Controller;
use crate::exit::Failure;
use crate::output::Output;

/// Of the primary interface that takes no programs.
const PORT: u16 = 30011;
const REPLY_TIMEOUT: Duration = Duration::from_secs(5);
const MM: f64 = 1000.0;

/// Prints what goes below `[motion.arms.NAME]`.
pub async fn show(arguments: &Controller, output: &Output) -> Result<(), Failure> {
    let (host, port) = place(&arguments.controller, PORT)?;
    let (make, calibration) = read(&host, port).await?;
    let dh = Dh {
        theta_rad: calibration.dh_theta,
        a_mm: calibration.dh_a.map(|metres| MM * metres),
        d_mm: calibration.dh_d.map(|metres| MM * metres),
        alpha_rad: calibration.dh_alpha,
    };
    let is_drawing = calibration.dh_a == make.nominal().dh_a
        && calibration.dh_d == make.nominal().dh_d
        && calibration.dh_alpha == make.nominal().dh_alpha
        && calibration.dh_theta == make.nominal().dh_theta;
    let name = format!("{make:?}").to_lowercase();
    output.line(format!("model = \"{name}\""));
    for (key, values) in [
        ("calibration.theta_rad", dh.theta_rad),
        ("calibration.a_mm", dh.a_mm),
        ("calibration.d_mm", dh.d_mm),
        ("calibration.alpha_rad", dh.alpha_rad),
    ] {
        output.line(format!("{key} = {values:?}"));
    }
    if is_drawing {
        output.note("these are the drawing's own numbers: this arm tells no calibration");
    }
    output.result(&json!({
        "model": name,
        "calibration": dh,
        "is_drawing": is_drawing,
        "checksum": calibration.checksum,
    }));
    Ok(())
}

/// The version comes first, configuration and kinematics with the first state.
async fn read(host: &str, port: u16) -> Result<(Model, Calibration), Failure> {
    let unreachable = |error| unreachable(&error);
    let mut primary = Primary::connect(host, port, REPLY_TIMEOUT)
        .await
        .map_err(unreachable)?;
    let software = match primary.next(REPLY_TIMEOUT).await.map_err(unreachable)? {
        Message::Notice(
            _,
            Notice::Version {
                version: [major, minor],
                bugfix,
                build,
                ..
            },
        ) => ControllerVersion {
            major: major.into(),
            minor: minor.into(),
            bugfix: bugfix.unsigned_abs(),
            build: build.unsigned_abs(),
        },
        _ => {
            let fault = "the first message is not the version of a controller";
            return Err(Failure::refused("CONTROLLER_UNKNOWN", fault));
        }
    };
    let (configuration, kinematics) = primary.identity().await.map_err(unreachable)?;
    let make = Model::of(&configuration, software).ok_or_else(|| {
        let fault = format!("robot type {} is no known arm", configuration.robot_type);
        Failure::refused("CONTROLLER_UNKNOWN", fault)
    })?;
    let calibration = Calibration::import(&kinematics, make)
        .map_err(|error| Failure::refused_because("CALIBRATION_IMPLAUSIBLE", &error))?;
    Ok((make, calibration))
}
