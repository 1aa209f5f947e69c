//! What must hold after a blow: everything comes to rest, and stays there until somebody decides.

use super::Campaign;
use crate::Result;
use crate::truth::Pose;

/// A procedure is looked at so long, cell time, before it is decided about.
const HOLD_S: f64 = 8.0;
/// Everything must have come to rest within this time of the cell, unless it is moved.
const REST_LIMIT_S: f64 = 600.0;

impl Campaign<'_> {
    pub(super) async fn at_rest(&mut self) -> Result<()> {
        let rest = self.rest().await?;
        self.hold(&rest).await
    }

    /// Waits until what was commanded has ended and nothing moves.
    pub(super) async fn rest(&mut self) -> Result<Pose> {
        let since_s = self.world.witness.cell_time_s().await?;
        let mut before = self.world.witness.pose().await?;
        loop {
            self.world.witness.let_pass(1.0).await?;
            let under_way = self.world.under_way().await;
            let now = self.world.witness.pose().await?;
            let unrest = now.moved_since(&before).or(under_way);
            let Some(unrest) = unrest else {
                return Ok(now);
            };
            if now.cell_time_s - since_s > REST_LIMIT_S {
                return Err(format!("no rest within {REST_LIMIT_S} s: {unrest}").into());
            }
            before = now;
        }
    }

    /// From rest on nothing may move, nor the jaw close, until somebody decides.
    pub(super) async fn hold(&mut self, rest: &Pose) -> Result<()> {
        let closures = self.world.witness.closures().await?;
        self.world.leases_gone().await?;
        for _ in 0..4 {
            self.world.witness.let_pass(HOLD_S / 4.0).await?;
            let now = self.world.witness.pose().await?;
            if let Some(moved) = now.moved_since(rest) {
                self.tally.moved_by_itself += 1;
                self.found(format!(
                    "{moved} within {:.1} s of rest",
                    now.cell_time_s - rest.cell_time_s
                ));
                break;
            }
        }
        let closed = self.world.witness.closures().await? - closures;
        if closed > 0 {
            self.tally.moved_by_itself += 1;
            self.found(format!("the jaw closed {closed} times by itself"));
        }
        Ok(())
    }
}
