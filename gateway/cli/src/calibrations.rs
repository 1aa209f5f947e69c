//! `arthro calibration`: the calibrations that the gateway keeps.

use arthro_proto::gateway::v1::{
    ActivateCalibrationRequest, Calibration as Kept, GetCalibrationRequest,
    ListCalibrationsRequest, RevokeCalibrationRequest, SaveCalibrationRequest,
    save_calibration_request,
};
use serde_json::json;

use crate::arguments::{Calibration, CalibrationFile};
use crate::commands::show;
use crate::exit::Failure;
use crate::gateway::Gateway;
use crate::output::Output;

/// Runs one command to its end.
pub async fn run(command: Calibration, gateway: &str, output: &Output) -> Result<(), Failure> {
    let mut calibrations = Gateway::connect(gateway).await?.calibrations;
    let kept = match command {
        Calibration::List => {
            let listed = calibrations.list_calibrations(ListCalibrationsRequest {});
            let listed = listed.await?.into_inner().calibrations;
            let values: Vec<_> = listed.iter().map(show::calibration).collect();
            let value = json!({"calibrations": values});
            output.line(show::table(&value));
            output.result(&value);
            return Ok(());
        }
        Calibration::Show { calibration } => {
            let request = GetCalibrationRequest {
                calibration_id: calibration,
            };
            let answer = calibrations.get_calibration(request).await?;
            answer.into_inner().calibration
        }
        Calibration::Activate {
            calibration,
            operator,
        } => {
            let request = ActivateCalibrationRequest {
                calibration_id: calibration,
                operator,
            };
            let answer = calibrations.activate_calibration(request).await?;
            answer.into_inner().calibration
        }
        Calibration::Revoke {
            calibration,
            operator,
            because,
        } => {
            let request = RevokeCalibrationRequest {
                calibration_id: calibration,
                operator,
                because,
            };
            let answer = calibrations.revoke_calibration(request).await?;
            answer.into_inner().calibration
        }
    };
    print(&kept.unwrap_or_default(), output);
    Ok(())
}

/// Saves what a file of measurements gave, if that is asked for.
pub async fn save(
    result: save_calibration_request::Result,
    asked: &CalibrationFile,
    gateway: &str,
    output: &Output,
) -> Result<(), Failure> {
    let Some(label) = &asked.save else {
        return Ok(());
    };
    let request = SaveCalibrationRequest {
        label: label.clone(),
        operator: asked.operator.clone().unwrap_or_default(),
        valid_for_s: asked.valid_days.map_or(0.0, |days| days * 86_400.0),
        result: Some(result),
    };
    let mut calibrations = Gateway::connect(gateway).await?.calibrations;
    let saved = calibrations.save_calibration(request).await?.into_inner();
    print(&saved.calibration.unwrap_or_default(), output);
    Ok(())
}

fn print(calibration: &Kept, output: &Output) {
    let value = show::calibration(calibration);
    output.line(show::table(&value));
    output.result(&value);
}
