//! Looking at an axis: by what its drive sends, or by asking.

use std::time::Duration;

use epos4_link::cia402::Statusword;
use epos4_link::objects;
use tokio::time::sleep;

use super::super::board::I2t;
use super::super::process_data::{Image, Part, Values};
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
        let Some(confirm_at) = due(&before) else {
            return self.confirm().await;
        };
        tokio::select! {
            biased;
            image = self.process_data.until(|image| {
                image.is_newer(Part::Motion, &before) || image.is_newer(Part::Status, &before)
            }) => {
                if let Some(sample) = self.sample_of(&image).filter(|_| is_current(&image)) {
                    return self.show(sample);
                }
            }
            () = self.process_data.past(confirm_at) => {}
            // A silent bus is asked too.
            () = sleep(MOVING_LIMIT) => {}
        }
        self.confirm().await
    }

    /// Position, current and stamp of all that the drive sent after `from` and before `to`, in the order of time.
    pub(in super::super) fn passed(
        &self,
        from: Duration,
        to: Duration,
    ) -> impl Iterator<Item = (f64, f64, Duration)> {
        let drivetrain = &self.spec().drivetrain;
        let passed = self.process_data.passed(from, to).into_iter();
        passed.map(|frame| {
            let position = drivetrain.to_position(frame.position_qc);
            (position, f64::from(frame.current_ma), frame.stamp)
        })
    }

    /// Measures by asking the drive, and shows the measurement on the board: for what must be known after an order.
    pub(in super::super) async fn ask(&self) -> Result<Sample, Failure> {
        let before = self.process_data.image();
        let (values, stamp) = self.asked().await?;
        self.process_data.confirm(&before, &values, stamp);
        self.show(self.measured(values, stamp))
    }

    /// Has the drive confirm what it sent last. A drive that is otherwise for longer than a frame may take, and does not
    /// send that either, is a failure. What was otherwise for a moment only, it need not send: it is asked again.
    async fn confirm(&self) -> Result<Sample, Failure> {
        let before = self.process_data.image();
        let (values, stamp) = self.asked().await?;
        self.process_data.confirm(&before, &values, stamp);
        let differing = before.differing(&values);
        let came = self.process_data.until(|image| {
            let mut differing = differing.iter();
            differing.all(|part| image.is_newer(*part, &before))
        });
        tokio::select! {
            biased;
            _ = came => return self.show(self.measured(values, stamp)),
            () = self.process_data.past(stamp + LATE_LIMIT) => {}
        }
        let since = self.process_data.image();
        let (values, stamp) = self.asked().await?;
        self.process_data.confirm(&since, &values, stamp);
        let image = self.process_data.image();
        let still_differing = image.differing(&values);
        let is_lost =
            |part: &Part| still_differing.contains(part) && !image.is_newer(*part, &before);
        if differing.iter().any(is_lost) {
            return Err(Failure::StaleProcessData {
                statusword: values.statusword,
                position_qc: values.position_qc,
                current_ma: values.current_ma,
                limit_s: LATE_LIMIT.as_secs_f64(),
            });
        }
        self.show(self.measured(values, stamp))
    }

    async fn asked(&self) -> Result<(Values, Duration), Failure> {
        // The load first: a current that rises is then told where the axis is or has passed, never before, so that blade
        // on blade is not taken for tissue.
        let current_ma = self.node.read(objects::CURRENT_ACTUAL).await?;
        let inputs = self.node.read(objects::DIGITAL_INPUTS).await?;
        // The position dates the sample: much time of the bus may pass between two answers, and a drive
        // must not be held for late by where it was before that.
        let position = self.node.read_stamped(objects::POSITION_ACTUAL).await?;
        let values = Values {
            position_qc: position.value,
            current_ma,
            inputs,
            statusword: Statusword(self.node.read(objects::STATUSWORD).await?),
        };
        Ok((values, position.stamp))
    }

    /// Waits until the drive has to be looked at although nobody commands it, and looks: also at what it does not send.
    pub(in super::super) async fn look(&self) -> Result<Sample, Failure> {
        let image = self.process_data.image();
        let oldest = Part::ALL
            .into_iter()
            .filter_map(|part| image.stamp(part))
            .min();
        tokio::select! {
            () = self.process_data.past(oldest.unwrap_or_default() + RESTING_LIMIT) => {}
            () = sleep(RESTING_LIMIT) => {}
        }
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
        match self.sample_of(&self.process_data.image()) {
            Some(sample) => self.show(sample).map(|_| ()),
            None => Ok(()),
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

    fn sample_of(&self, image: &Image) -> Option<Sample> {
        Some(self.measured(image.values()?, image.stamp(Part::Motion)?))
    }

    fn measured(&self, values: Values, stamp: Duration) -> Sample {
        Sample {
            statusword: values.statusword,
            position: self.spec().drivetrain.to_position(values.position_qc),
            current_ma: f64::from(values.current_ma),
            inputs: values.inputs,
            stamp,
        }
    }
}

/// When the drive is to be asked during a motion; `None` while a part has never come.
fn due(image: &Image) -> Option<Duration> {
    let due = |part| Some(image.stamp(part)? + limit(part));
    let [status, motion, inputs] = Part::ALL.map(due);
    Some(status?.min(motion?).min(inputs?))
}

/// Whether no part is older than its limit when the newest came, or behind what the drive said after an order.
fn is_current(image: &Image) -> bool {
    if Part::ALL.into_iter().any(|part| image.is_behind(part)) {
        return false;
    }
    let newest = Part::ALL
        .into_iter()
        .filter_map(|part| image.stamp(part))
        .max();
    match (due(image), newest) {
        (Some(due), Some(newest)) => newest <= due,
        _ => false,
    }
}

/// Inputs change rarely, and what they stop the drive stops itself.
fn limit(part: Part) -> Duration {
    match part {
        Part::Status | Part::Motion => MOVING_LIMIT,
        Part::Inputs => RESTING_LIMIT,
    }
}
