//! Looking at an axis: by what its drive sends, or by asking.

use std::time::Duration;

use epos4_link::cia402::Statusword;
use epos4_link::objects;

use super::super::board::I2t;
use super::super::process_data::{Dated, Image, Load, Motion};
use super::Link;
use crate::error::Failure;
use crate::positioning::Sample;

/// What is older than this is confirmed during a motion.
const MOVING_LIMIT: Duration = Duration::from_millis(50);
/// What is older than this is confirmed at rest.
const RESTING_LIMIT: Duration = Duration::from_millis(500);
/// A change that the drive confirms and has not sent for this long, of bus time, is lost: five inhibit times.
const LATE_LIMIT: Duration = Duration::from_millis(50);
/// Object 0x3202:01 while torque is permitted: both inputs have voltage. Assumed, the specification was not at hand.
const STO_INPUTS_HIGH: u8 = 0x03;

impl Link {
    /// The next measurement: what the drive sends next, or, when nothing comes for a moment, what it sent last and
    /// confirms. The measurement is on the board. A statusword that no standard knows is a failure, and so is a drive
    /// that has changed and did not send it.
    pub(in super::super) async fn sample(&self) -> Result<Sample, Failure> {
        let before = self.process_data.image();
        let Some(last) = oldest(&before) else {
            return self.confirm().await;
        };
        tokio::select! {
            biased;
            image = self.process_data.until(|image| image.motion_since(&before)) => {
                let is_recent = |load: Dated<Load>, motion: Dated<Motion>| {
                    motion.stamp.saturating_sub(load.stamp) <= MOVING_LIMIT
                };
                if let (Some(motion), Some(load)) = (image.motion, image.load)
                    && is_recent(load, motion)
                {
                    return self.show(sample_of(self, motion, load));
                }
            }
            () = self.process_data.older_than(last, MOVING_LIMIT) => {}
        }
        self.confirm().await
    }

    /// Measures by asking the drive, and shows the measurement on the board: for what must be known after an order.
    pub(in super::super) async fn ask(&self) -> Result<Sample, Failure> {
        let (motion, load, stamp) = self.asked().await?;
        let sample = sample_of(self, Dated::asked(motion, stamp), Dated::asked(load, stamp));
        self.show(sample)
    }

    /// Has the drive confirm what it sent last. A drive that is otherwise, and does not send that either, is a failure.
    async fn confirm(&self) -> Result<Sample, Failure> {
        let before = self.process_data.image();
        let (motion, load, stamp) = self.asked().await?;
        self.process_data.confirm(motion, load, stamp);
        let is_motion_new = before.motion.map(|sent| sent.value) != Some(motion);
        let is_load_new = before.load.map(|sent| sent.value) != Some(load);
        let came = self.process_data.until(|image| {
            (!is_motion_new || image.motion_since(&before))
                && (!is_load_new || image.load_since(&before))
        });
        tokio::select! {
            biased;
            _ = came => {}
            () = self.process_data.past(stamp + LATE_LIMIT) => {
                return Err(Failure::StaleProcessData {
                    statusword: motion.statusword,
                    position_qc: motion.position_qc,
                    limit_s: LATE_LIMIT.as_secs_f64(),
                });
            }
        }
        self.show(sample_of(
            self,
            Dated::asked(motion, stamp),
            Dated::asked(load, stamp),
        ))
    }

    async fn asked(&self) -> Result<(Motion, Load, Duration), Failure> {
        // The position dates the sample: much time of the bus may pass between two answers, and a drive
        // must not be held for late by where it was before that.
        let position = self.node.read_stamped(objects::POSITION_ACTUAL).await?;
        let load = Load {
            current_ma: self.node.read(objects::CURRENT_ACTUAL).await?,
            inputs: self.node.read(objects::DIGITAL_INPUTS).await?,
        };
        let motion = Motion {
            statusword: Statusword(self.node.read(objects::STATUSWORD).await?),
            position_qc: position.value,
        };
        Ok((motion, load, position.stamp))
    }

    /// Waits until the drive has to be looked at although nobody commands it, and looks: also at what it does not send.
    pub(in super::super) async fn look(&self) -> Result<Sample, Failure> {
        let last = oldest(&self.process_data.image()).unwrap_or_default();
        self.process_data.older_than(last, RESTING_LIMIT).await;
        self.read_condition().await?;
        self.confirm().await
    }

    /// Waits until the board shows another state of the drive than now, or that it is commanded.
    pub(in super::super) async fn until_shown_otherwise(&self) {
        let shown = self.board.drive_state(self.axis);
        let mut states = self.board.subscribe();
        let otherwise = states.wait_for(|state| {
            let axis = &state.axes[self.axis.index()];
            let drive_state = axis.sample.and_then(|sample| sample.statusword.state());
            axis.operation_id.is_some() || drive_state != shown
        });
        if otherwise.await.is_err() {
            std::future::pending().await
        }
    }

    /// Reads safe torque off and the thermal models, and shows them on the board.
    pub(in super::super) async fn read_condition(&self) -> Result<(), Failure> {
        let sto_inputs = self.node.read(objects::STO_INPUTS).await?;
        let i2t = I2t {
            motor_percent: self.node.read(objects::I2T_MOTOR).await?,
            power_stage_percent: self.node.read(objects::I2T_POWER_STAGE).await?,
        };
        self.board.update_axis(self.axis, |state| {
            state.safe_torque_off = Some(sto_inputs & STO_INPUTS_HIGH != STO_INPUTS_HIGH);
            state.i2t = Some(i2t);
        });
        Ok(())
    }

    /// Shows what the drive has sent by itself.
    pub(in super::super) fn show_image(&self) -> Result<(), Failure> {
        let image = self.process_data.image();
        match (image.motion, image.load) {
            (Some(motion), Some(load)) => self.show(sample_of(self, motion, load)).map(|_| ()),
            _ => Ok(()),
        }
    }

    fn show(&self, sample: Sample) -> Result<Sample, Failure> {
        self.board
            .update_axis(self.axis, |state| state.sample = Some(sample));
        match sample.statusword.state() {
            Some(_) => Ok(sample),
            None => Err(Failure::UnknownStatusword(sample.statusword)),
        }
    }
}

fn sample_of(link: &Link, motion: Dated<Motion>, load: Dated<Load>) -> Sample {
    Sample {
        statusword: motion.value.statusword,
        position: link.spec().drivetrain.to_position(motion.value.position_qc),
        current_ma: f64::from(load.value.current_ma),
        inputs: load.value.inputs,
        stamp: motion.stamp,
    }
}

/// When the older of the two parts was sent or confirmed; `None` while one is missing.
fn oldest(image: &Image) -> Option<Duration> {
    Some(image.motion?.stamp.min(image.load?.stamp))
}
