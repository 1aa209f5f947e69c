//! The bite: the forceps feed runs forward until the jaw is closed or something stops it, and the current says which.

use std::time::Duration;

use epos4_link::cia402::{State, Statusword};

use crate::positioning::Sample;

/// The bite of this forceps.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct BiteSpec {
    /// Where the jaw is open.
    pub open_mm: f64,
    /// Where the empty jaws touch.
    pub closed_mm: f64,
    /// Closing speed.
    pub speed_mm_s: f64,
    /// The highest current of a bite.
    pub current_limit_ma: f64,
    /// A current above this while closing means that something is between the jaws.
    pub contact_current_ma: f64,
}

/// What is known of the jaw.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Jaw {
    /// At or behind the open position.
    Open,
    /// A command moves it.
    Moving,
    /// Closed, and nothing was felt on the way.
    ClosedEmpty,
    /// Something was felt on the way, or stopped it.
    ClosedOnTissue,
    /// After any doubt, until opened or homed.
    #[default]
    Unknown,
}

/// How a bite ended.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct BiteEnd {
    /// Closed empty or on tissue.
    pub jaw: Jaw,
    /// Where the feed stands.
    pub position_mm: f64,
    /// The highest current seen.
    pub peak_current_ma: f64,
}

/// Why a bite is in doubt.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum BiteError {
    /// The drive does not obey any more.
    #[error("the drive left operation at {position_mm:.3} mm, statusword {statusword}")]
    LeftOperation {
        /// Where.
        position_mm: f64,
        /// What it reports.
        statusword: Statusword,
    },
    /// It stands, and not because of the current.
    #[error(
        "stands at {position_mm:.3} mm short of {closed_mm} mm with {current_ma:.0} mA, below the limit of {limit_ma:.0} mA"
    )]
    StoodStill {
        /// Where.
        position_mm: f64,
        /// Where it should be.
        closed_mm: f64,
        /// At the end.
        current_ma: f64,
        /// Of this bite.
        limit_ma: f64,
    },
}

/// Watches a closing jaw.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    spec: BiteSpec,
    limit_ma: f64,
    tolerance_mm: f64,
    peak_current_ma: f64,
    contact: bool,
    /// The farthest position and when it was reached.
    farthest: (f64, Duration),
}

impl Watch {
    /// Less than this is no progress.
    const PROGRESS_MM: f64 = 0.02;
    /// Standing for this long at the current limit is a jaw that is stopped.
    const STOPPED_AFTER: Duration = Duration::from_millis(150);
    /// Standing for this long without current is a fault.
    const STALLED_AFTER: Duration = Duration::from_secs(1);
    /// At the limit means: from this share on.
    const AT_LIMIT: f64 = 0.9;

    /// Closing began with this sample.
    pub fn new(spec: BiteSpec, limit_ma: f64, tolerance_mm: f64, first: &Sample) -> Self {
        let farthest = (first.position, first.stamp);
        Self {
            spec,
            limit_ma,
            tolerance_mm,
            peak_current_ma: 0.0,
            contact: false,
            farthest,
        }
    }

    /// The highest current seen.
    pub fn peak_current_ma(&self) -> f64 {
        self.peak_current_ma
    }

    /// Takes a sample; an answer when the bite is over.
    pub fn observe(&mut self, sample: &Sample) -> Option<Result<BiteEnd, BiteError>> {
        let Sample {
            statusword,
            position,
            stamp,
            ..
        } = *sample;
        let current_ma = sample.current_ma.abs();
        self.peak_current_ma = self.peak_current_ma.max(current_ma);
        // The first tenth of the way is the motor's own acceleration.
        let closing_from_mm = self.spec.open_mm + 0.1 * (self.spec.closed_mm - self.spec.open_mm);
        self.contact |= position > closing_from_mm && current_ma >= self.spec.contact_current_ma;
        if statusword.state() != Some(State::OperationEnabled) {
            return Some(Err(BiteError::LeftOperation {
                position_mm: position,
                statusword,
            }));
        }
        let closed = position >= self.spec.closed_mm - self.tolerance_mm;
        if closed && statusword.has(Statusword::TARGET_REACHED) {
            return Some(Ok(self.end(
                if self.contact {
                    Jaw::ClosedOnTissue
                } else {
                    Jaw::ClosedEmpty
                },
                position,
            )));
        }
        if position >= self.farthest.0 + Self::PROGRESS_MM {
            self.farthest = (position, stamp);
            return None;
        }
        let standing = stamp.saturating_sub(self.farthest.1);
        let at_limit = current_ma >= Self::AT_LIMIT * self.limit_ma
            || statusword.has(Statusword::INTERNAL_LIMIT);
        if at_limit && standing >= Self::STOPPED_AFTER {
            return Some(Ok(self.end(Jaw::ClosedOnTissue, position)));
        }
        (standing >= Self::STALLED_AFTER).then_some(Err(BiteError::StoodStill {
            position_mm: position,
            closed_mm: self.spec.closed_mm,
            current_ma,
            limit_ma: self.limit_ma,
        }))
    }

    fn end(&self, jaw: Jaw, position_mm: f64) -> BiteEnd {
        BiteEnd {
            jaw,
            position_mm,
            peak_current_ma: self.peak_current_ma,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    const ENABLED: u16 = 0x0027;

    fn sample(statusword: u16, position: f64, current_ma: f64, ms: u64) -> Sample {
        Sample {
            statusword: Statusword(statusword),
            position,
            current_ma,
            inputs: 0,
            stamp: Duration::from_millis(ms),
        }
    }

    fn watch() -> Watch {
        let spec = Config::default().check().unwrap().bite;
        Watch::new(
            spec,
            spec.current_limit_ma,
            0.02,
            &sample(ENABLED, 0.0, 0.0, 0),
        )
    }

    /// Feeds at 5 mm/s with this current.
    fn close(watch: &mut Watch, to_mm: f64, current_ma: f64) -> u64 {
        let ms = (to_mm * 200.0) as u64;
        for at in (0..ms).step_by(10) {
            assert_eq!(
                watch.observe(&sample(ENABLED, at as f64 / 200.0, current_ma, at)),
                None
            );
        }
        ms
    }

    #[test]
    fn an_empty_jaw_closes_to_its_position() {
        let mut watch = watch();
        assert_eq!(
            watch.observe(&sample(ENABLED, 0.1, 300.0, 5)),
            None,
            "the motor's own acceleration is no contact"
        );
        let ms = close(&mut watch, 10.0, 40.0);
        let end = watch
            .observe(&sample(0x0427, 9.99, 30.0, ms))
            .unwrap()
            .unwrap();
        assert_eq!(
            end,
            BiteEnd {
                jaw: Jaw::ClosedEmpty,
                position_mm: 9.99,
                peak_current_ma: 300.0
            }
        );
    }

    #[test]
    fn tissue_that_is_cut_is_felt_by_the_current() {
        let mut watch = watch();
        let ms = close(&mut watch, 10.0, 260.0);
        let end = watch
            .observe(&sample(0x0427, 10.0, 30.0, ms))
            .unwrap()
            .unwrap();
        assert_eq!((end.jaw, end.peak_current_ma), (Jaw::ClosedOnTissue, 260.0));
    }

    #[test]
    fn a_jaw_that_stands_at_the_current_limit_is_closed_on_tissue() {
        let mut watch = watch();
        let ms = close(&mut watch, 7.0, 100.0);
        assert_eq!(watch.observe(&sample(ENABLED, 7.0, 495.0, ms)), None);
        assert_eq!(watch.observe(&sample(ENABLED, 7.01, 495.0, ms + 140)), None);
        let end = watch
            .observe(&sample(ENABLED, 7.01, 495.0, ms + 160))
            .unwrap()
            .unwrap();
        assert_eq!((end.jaw, end.position_mm), (Jaw::ClosedOnTissue, 7.01));
    }

    #[test]
    fn a_jaw_that_stands_without_current_is_a_fault() {
        let mut watch = watch();
        let ms = close(&mut watch, 7.0, 50.0);
        assert_eq!(watch.observe(&sample(ENABLED, 7.0, 50.0, ms)), None);
        let error = watch
            .observe(&sample(ENABLED, 7.0, 50.0, ms + 1001))
            .unwrap()
            .unwrap_err();
        let message = "stands at 7.000 mm short of 10 mm with 50 mA, below the limit of 500 mA";
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn a_drive_in_fault_ends_the_bite_in_doubt() {
        let error = watch()
            .observe(&sample(0x0008, 3.0, 0.0, 600))
            .unwrap()
            .unwrap_err();
        assert!(matches!(error, BiteError::LeftOperation { .. }));
    }
}
