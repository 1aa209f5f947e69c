//! Where the tip of an arm that stands still is, as the motion service measures it.

use arthro_geometry::Point3;
use arthro_proto::motion::v1 as proto;

use super::{Arm, Motion, PEER, SHORT_DEADLINE, arm_state, ask, within};
use crate::clients::Failure;

/// Readings come this often and are taken for this long, s of the controller's clock.
const PERIOD_S: f64 = 0.05;
const WATCHED_S: f64 = 0.2;
/// Readings of an arm that stands still differ by less than this, mm: a UR5's joints tell its tip to some hundredths.
const STILL_MM: f64 = 0.1;

/// What was seen of an arm while it was watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TipWatch {
    /// It stood still: its tip in its own base.
    Still(Point3),
    /// It moved.
    Moving {
        /// By so much between two readings, mm.
        moved_mm: f64,
    },
    /// Its controller is away: what is told of it is old.
    NotConnected,
}

impl Motion {
    /// Watches an arm for a fifth of a second of its own clock.
    pub async fn watch_tip(&self, arm: Arm) -> Result<TipWatch, Failure> {
        let request = proto::WatchStateRequest { period_s: PERIOD_S };
        let call = within(SHORT_DEADLINE, request);
        let mut states = ask(PEER, self.0.clone().watch_state(call)).await?;
        let mut first: Option<(f64, Point3)> = None;
        loop {
            let message = states.message().await;
            let message = message
                .map_err(|status| Failure::answered(PEER, status))?
                .ok_or_else(|| Failure::unusable(PEER, "the states ended"))?;
            let state = message
                .arms
                .iter()
                .find(|state| state.arm() == arm.message());
            let Some(state) = state.filter(|state| state.connected) else {
                return Ok(TipWatch::NotConnected);
            };
            let time_s = state.controller_time_s;
            let tip = arm_state(state)?.base_from_tool.origin();
            let (since_s, began_at) = *first.get_or_insert((time_s, tip));
            let moved_mm = (tip - began_at).norm();
            if state.moving || moved_mm > STILL_MM {
                return Ok(TipWatch::Moving { moved_mm });
            }
            // A clock that runs backwards is that of a controller that was started again.
            if time_s < since_s {
                return Ok(TipWatch::NotConnected);
            }
            if time_s - since_s >= WATCHED_S {
                return Ok(TipWatch::Still(tip));
            }
        }
    }

    /// The tip that the motion service moves: in the flange of an arm, mm.
    pub async fn tip_in_flange(&self, arm: Arm) -> Result<Point3, Failure> {
        let request = within(SHORT_DEADLINE, proto::GetCellRequest {});
        let cell = ask(PEER, self.0.clone().get_cell(request)).await?;
        let described = cell
            .arms
            .iter()
            .find(|described| described.arm() == arm.message());
        let translation = described
            .and_then(|described| described.flange_from_tool)
            .and_then(|pose| pose.translation)
            .ok_or_else(|| Failure::unusable(PEER, "the cell lacks flange_from_tool"))?;
        Ok(Point3::new(
            translation.x_mm,
            translation.y_mm,
            translation.z_mm,
        ))
    }
}
