//! What an axis' drive sends by itself. The EPOS4 sends process data when they change, so that silence means that nothing
//! changes, or that nothing comes: whoever relies on silence has it confirmed.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use epos4_link::canopen::pdo::{Data, Mapped, Mapping, MappingError};
use epos4_link::cia402::Statusword;
use epos4_link::objects;
use tokio::sync::watch;

/// The TPDO of the statusword, alone so that it comes at once.
pub(super) const STATUS_PDO: u8 = 1;
/// The TPDO of position and current, which belong together.
pub(super) const MOTION_PDO: u8 = 2;
/// The TPDO of the inputs.
pub(super) const INPUTS_PDO: u8 = 3;
/// The RPDO of the controlword.
pub(super) const CONTROL_PDO: u8 = 1;

/// What a drive sends.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct Values {
    pub(super) statusword: Statusword,
    pub(super) position_qc: i32,
    pub(super) current_ma: i32,
    pub(super) inputs: u32,
}

/// What comes in one frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Part {
    Status,
    Motion,
    Inputs,
}

/// What one drive sent last.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct Image {
    values: Values,
    /// When each part was sent or confirmed last, on the clock of the bus.
    stamps: [Option<Duration>; 3],
    /// How often each part was sent.
    frames: [u64; 3],
    /// Which parts the drive was asked for since and had otherwise: what was sent is behind an order.
    behind: [bool; 3],
}

/// One frame of [`MOTION_PDO`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Passed {
    pub(super) position_qc: i32,
    pub(super) current_ma: i32,
    pub(super) stamp: Duration,
}

/// The image of one axis and the clock of the bus, for whoever waits for either. Clones are the same.
#[derive(Clone, Debug)]
pub(super) struct ProcessData {
    image: watch::Sender<Image>,
    clock: watch::Sender<Duration>,
    passed: Arc<Mutex<VecDeque<Passed>>>,
}

// === impl Part ===

impl Part {
    pub(super) const ALL: [Self; 3] = [Self::Status, Self::Motion, Self::Inputs];

    fn index(self) -> usize {
        match self {
            Self::Status => 0,
            Self::Motion => 1,
            Self::Inputs => 2,
        }
    }

    /// The TPDO that brings it.
    pub(super) fn pdo(self) -> u8 {
        match self {
            Self::Status => STATUS_PDO,
            Self::Motion => MOTION_PDO,
            Self::Inputs => INPUTS_PDO,
        }
    }

    /// The objects of its TPDO.
    pub(super) fn mapping(self) -> Result<Mapping, MappingError> {
        match self {
            Self::Status => Mapping::new([Mapped::from(objects::STATUSWORD)]),
            Self::Motion => Mapping::new([
                Mapped::from(objects::POSITION_ACTUAL),
                objects::CURRENT_ACTUAL.into(),
            ]),
            Self::Inputs => Mapping::new([Mapped::from(objects::DIGITAL_INPUTS)]),
        }
    }

    fn is_same(self, a: &Values, b: &Values) -> bool {
        match self {
            Self::Status => a.statusword == b.statusword,
            Self::Motion => (a.position_qc, a.current_ma) == (b.position_qc, b.current_ma),
            Self::Inputs => a.inputs == b.inputs,
        }
    }
}

/// The objects of [`CONTROL_PDO`].
pub(super) fn control_mapping() -> Result<Mapping, MappingError> {
    Mapping::new([Mapped::from(objects::CONTROLWORD)])
}

// === impl Image ===

impl Image {
    /// Takes a frame of the drive. `false` for one that is not as mapped.
    fn take(&mut self, number: u8, data: &Data, stamp: Duration) -> bool {
        let part = Part::ALL.into_iter().find(|part| part.pdo() == number);
        let Some((part, values)) =
            part.and_then(|part| Some((part, self.values.with(part, data)?)))
        else {
            return false;
        };
        self.values = values;
        self.stamps[part.index()] = Some(stamp);
        self.frames[part.index()] += 1;
        self.behind[part.index()] = false;
        true
    }

    /// What was sent last; `None` while a part has never come.
    pub(super) fn values(&self) -> Option<Values> {
        self.stamps
            .iter()
            .all(Option::is_some)
            .then_some(self.values)
    }

    /// When a part was sent or confirmed last.
    pub(super) fn stamp(&self, part: Part) -> Option<Duration> {
        self.stamps[part.index()]
    }

    /// Whether a part has been sent since `before`.
    pub(super) fn is_newer(&self, part: Part, before: &Self) -> bool {
        self.frames[part.index()] > before.frames[part.index()]
    }

    /// The parts that the drive has otherwise than it sent them.
    pub(super) fn differing(&self, asked: &Values) -> Vec<Part> {
        let differs = |part: &Part| !part.is_same(&self.values, asked);
        Part::ALL.into_iter().filter(differs).collect()
    }

    /// Whether a part was otherwise when the drive was asked, and has not been sent since.
    pub(super) fn is_behind(&self, part: Part) -> bool {
        self.behind[part.index()]
    }

    fn confirm(&mut self, before: &Self, asked: &Values, stamp: Duration) {
        for part in Part::ALL {
            if part.is_same(&self.values, asked) {
                let last = &mut self.stamps[part.index()];
                *last = last.map(|last| last.max(stamp));
                self.behind[part.index()] = false;
            } else if !self.is_newer(part, before) {
                self.behind[part.index()] = true;
            }
        }
    }
}

impl Values {
    /// The same with a part as a frame has it; `None` for a frame that is not as mapped.
    fn with(self, part: Part, data: &Data) -> Option<Self> {
        let mapping = part.mapping().ok()?;
        if data.as_slice().len() != mapping.len() {
            return None;
        }
        Some(match part {
            Part::Status => Self {
                statusword: Statusword(mapping.value(objects::STATUSWORD, data)?),
                ..self
            },
            Part::Motion => Self {
                position_qc: mapping.value(objects::POSITION_ACTUAL, data)?,
                current_ma: mapping.value(objects::CURRENT_ACTUAL, data)?,
                ..self
            },
            Part::Inputs => Self {
                inputs: mapping.value(objects::DIGITAL_INPUTS, data)?,
                ..self
            },
        })
    }
}

// === impl ProcessData ===

impl ProcessData {
    /// So many frames of a motion are kept: five seconds at the highest rate.
    const KEPT: usize = 512;

    /// Nothing has come. The clock is that of the bus, shared by all axes.
    pub(super) fn new(clock: watch::Sender<Duration>) -> Self {
        Self {
            image: watch::Sender::new(Image::default()),
            clock,
            passed: Arc::default(),
        }
    }

    pub(super) fn image(&self) -> Image {
        *self.image.borrow()
    }

    /// Takes a frame of the drive. `false` for one that is not as mapped.
    pub(super) fn take(&self, number: u8, data: &Data, stamp: Duration) -> bool {
        let mut is_taken = false;
        self.image.send_modify(|image| {
            is_taken = image.take(number, data, stamp);
            if is_taken && number == MOTION_PDO {
                self.keep(&image.values, stamp);
            }
        });
        is_taken
    }

    fn keep(&self, values: &Values, stamp: Duration) {
        let mut passed = self.passed.lock().unwrap_or_else(PoisonError::into_inner);
        if passed.len() == Self::KEPT {
            passed.pop_front();
        }
        passed.push_back(Passed {
            position_qc: values.position_qc,
            current_ma: values.current_ma,
            stamp,
        });
    }

    /// What the motor went through after `from` and before `to`: an image alone forgets what comes between two looks at
    /// it, however far a busy host lets them be apart.
    pub(super) fn passed(&self, from: Duration, to: Duration) -> Vec<Passed> {
        let passed = self.passed.lock().unwrap_or_else(PoisonError::into_inner);
        let between = |frame: &&Passed| frame.stamp > from && frame.stamp < to;
        passed.iter().filter(between).copied().collect()
    }

    /// The drive was asked when the image was as `before`: the parts that it has as it sent them are confirmed.
    pub(super) fn confirm(&self, before: &Image, asked: &Values, stamp: Duration) {
        self.image
            .send_modify(|image| image.confirm(before, asked, stamp));
    }

    /// Waits for an image as wanted.
    pub(super) async fn until(&self, wanted: impl Fn(&Image) -> bool) -> Image {
        let mut images = self.image.subscribe();
        let reached = images.wait_for(|image| wanted(image)).await;
        match reached.map(|image| *image).ok() {
            Some(image) => image,
            // This end holds the sender: it is never gone.
            None => std::future::pending().await,
        }
    }

    /// Waits until the bus is past this time.
    pub(super) async fn past(&self, stamp: Duration) {
        let mut clock = self.clock.subscribe();
        if clock.wait_for(|now| *now > stamp).await.is_err() {
            std::future::pending().await
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn frames_are_taken_as_they_are_mapped() {
        let mut image = Image::default();
        let before = image;
        let frames: [(u8, &[u8]); 3] = [
            (STATUS_PDO, &[0x27, 0x84]),
            (MOTION_PDO, &[0x00, 0x54, 0, 0, 0x28, 0, 0, 0]),
            (INPUTS_PDO, &[1, 0, 0, 0]),
        ];
        for (number, bytes) in frames {
            assert_eq!(image.values(), None);
            let data = Data::new(bytes).unwrap();
            assert!(image.take(number, &data, ms(number.into())));
        }
        assert!(Part::ALL.iter().all(|part| image.is_newer(*part, &before)));
        let values = Values {
            statusword: Statusword(0x8427),
            position_qc: 21_504,
            current_ma: 40,
            inputs: 1,
        };
        assert_eq!(image.values(), Some(values));
        assert_eq!(image.stamp(Part::Motion), Some(ms(2)));
    }

    #[test]
    fn what_is_asked_confirms_the_parts_that_are_as_sent() {
        let mut image = Image {
            stamps: [Some(ms(1)); 3],
            ..Image::default()
        };
        let asked = Values {
            current_ma: 7,
            ..Values::default()
        };
        let before = image;
        image.confirm(&before, &asked, ms(9));
        assert_eq!(
            Part::ALL.map(|part| image.is_behind(part)),
            [false, true, false]
        );
        assert_eq!(image.differing(&asked), [Part::Motion]);
        assert_eq!(
            Part::ALL.map(|part| image.stamp(part)),
            [Some(ms(9)), Some(ms(1)), Some(ms(9))]
        );
        let moved = Data::new(&[1, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        assert!(image.take(MOTION_PDO, &moved, ms(10)));
        assert!(!image.is_behind(Part::Motion));
        // What was sent while the drive was asked is newer than the answer.
        image.confirm(&before, &asked, ms(9));
        assert!(!image.is_behind(Part::Motion));
    }

    #[test]
    fn what_passed_between_two_looks_is_kept_and_bounded() {
        let data = ProcessData::new(watch::Sender::new(Duration::ZERO));
        for position_qc in 0..1000_u32 {
            let [a, b, c, d] = position_qc.to_le_bytes();
            let frame = Data::new(&[a, b, c, d, 40, 0, 0, 0]).unwrap();
            assert!(data.take(MOTION_PDO, &frame, ms(position_qc.into())));
        }
        let passed = data.passed(ms(989), ms(992));
        let positions: Vec<_> = passed.iter().map(|frame| frame.position_qc).collect();
        assert_eq!(positions, [990, 991]);
        assert_eq!(data.passed(ms(0), ms(2000)).len(), ProcessData::KEPT);
    }

    #[test]
    fn a_frame_that_has_another_length_or_is_not_ours_is_not_taken() {
        let mut image = Image::default();
        for (number, bytes) in [
            (MOTION_PDO, &[0x27, 0x84, 0x00][..]),
            (STATUS_PDO, &[1, 2, 3]),
            (4, &[1]),
        ] {
            assert!(!image.take(number, &Data::new(bytes).unwrap(), ms(1)));
        }
        assert_eq!(image, Image::default());
    }
}
