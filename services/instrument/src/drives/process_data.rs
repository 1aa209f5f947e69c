//! What an axis' drive sends by itself. The EPOS4 sends process data when they change, so that silence means that nothing
//! changes, or that nothing comes: whoever relies on silence has it confirmed.

use std::time::Duration;

use epos4_link::canopen::pdo::{Data, Mapped, Mapping, MappingError};
use epos4_link::cia402::Statusword;
use epos4_link::objects;
use tokio::sync::watch;
use tokio::time::sleep;

/// The TPDO of statusword and position.
pub(super) const MOTION_PDO: u8 = 1;
/// The TPDO of current and inputs.
pub(super) const LOAD_PDO: u8 = 2;
/// The RPDO of the controlword.
pub(super) const CONTROL_PDO: u8 = 1;

/// What one drive sent last.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct Image {
    pub(super) motion: Option<Dated<Motion>>,
    pub(super) load: Option<Dated<Load>>,
}

/// Statusword and position, of one frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Motion {
    pub(super) statusword: Statusword,
    pub(super) position_qc: i32,
}

/// Current and inputs, of one frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Load {
    pub(super) current_ma: i32,
    pub(super) inputs: u32,
}

/// Values and when the drive sent or confirmed them, on the clock of the bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Dated<T> {
    pub(super) value: T,
    pub(super) stamp: Duration,
    /// Frames so far.
    frames: u64,
}

/// The image of one axis and the clock of the bus, for whoever waits for either. Clones are the same.
#[derive(Clone, Debug)]
pub(super) struct ProcessData {
    image: watch::Sender<Image>,
    clock: watch::Sender<Duration>,
}

/// The objects of [`MOTION_PDO`].
pub(super) fn motion_mapping() -> Result<Mapping, MappingError> {
    Mapping::new([
        Mapped::from(objects::STATUSWORD),
        objects::POSITION_ACTUAL.into(),
    ])
}

/// The objects of [`LOAD_PDO`].
pub(super) fn load_mapping() -> Result<Mapping, MappingError> {
    Mapping::new([
        Mapped::from(objects::CURRENT_ACTUAL),
        objects::DIGITAL_INPUTS.into(),
    ])
}

/// The objects of [`CONTROL_PDO`].
pub(super) fn control_mapping() -> Result<Mapping, MappingError> {
    Mapping::new([Mapped::from(objects::CONTROLWORD)])
}

// === impl Image ===

impl Image {
    /// Takes a frame of the drive. `false` for one that is not as mapped.
    fn take(&mut self, number: u8, data: &Data, stamp: Duration) -> bool {
        let taken = match number {
            MOTION_PDO => motion_of(data).map(|value| {
                self.motion = Some(Dated::next(self.motion, value, stamp));
            }),
            LOAD_PDO => load_of(data).map(|value| {
                self.load = Some(Dated::next(self.load, value, stamp));
            }),
            _ => None,
        };
        taken.is_some()
    }

    fn frames(&self) -> [u64; 2] {
        [
            self.motion.map_or(0, |dated| dated.frames),
            self.load.map_or(0, |dated| dated.frames),
        ]
    }

    /// Whether both have come since `before`.
    pub(super) fn is_renewed_since(&self, before: &Self) -> bool {
        self.frames()
            .iter()
            .zip(before.frames())
            .all(|(now, before)| *now > before)
    }

    /// Whether current and inputs have come since `before`.
    pub(super) fn load_since(&self, before: &Self) -> bool {
        self.frames()[1] > before.frames()[1]
    }

    /// Whether statusword and position have come since `before`.
    pub(super) fn motion_since(&self, before: &Self) -> bool {
        self.frames()[0] > before.frames()[0]
    }
}

impl<T> Dated<T> {
    /// A value that was asked for.
    pub(super) fn asked(value: T, stamp: Duration) -> Self {
        Self {
            value,
            stamp,
            frames: 0,
        }
    }

    fn next(before: Option<Self>, value: T, stamp: Duration) -> Self {
        Self {
            value,
            stamp,
            frames: before.map_or(0, |before| before.frames) + 1,
        }
    }
}

fn motion_of(data: &Data) -> Option<Motion> {
    let mapping = motion_mapping().ok()?;
    Some(Motion {
        statusword: Statusword(mapping.value(objects::STATUSWORD, data)?),
        position_qc: mapping.value(objects::POSITION_ACTUAL, data)?,
    })
}

fn load_of(data: &Data) -> Option<Load> {
    let mapping = load_mapping().ok()?;
    Some(Load {
        current_ma: mapping.value(objects::CURRENT_ACTUAL, data)?,
        inputs: mapping.value(objects::DIGITAL_INPUTS, data)?,
    })
}

// === impl ProcessData ===

impl ProcessData {
    /// Nothing has come. The clock is that of the bus, shared by all axes.
    pub(super) fn new(clock: watch::Sender<Duration>) -> Self {
        Self {
            image: watch::Sender::new(Image::default()),
            clock,
        }
    }

    pub(super) fn image(&self) -> Image {
        *self.image.borrow()
    }

    /// Takes a frame of the drive. `false` for one that is not as mapped.
    pub(super) fn take(&self, number: u8, data: &Data, stamp: Duration) -> bool {
        let mut is_taken = false;
        self.image
            .send_modify(|image| is_taken = image.take(number, data, stamp));
        is_taken
    }

    /// The drive has confirmed these of the parts.
    pub(super) fn confirm(&self, motion: Motion, load: Load, stamp: Duration) {
        self.image.send_modify(|image| {
            if let Some(sent) = image.motion.as_mut().filter(|sent| sent.value == motion) {
                sent.stamp = sent.stamp.max(stamp);
            }
            if let Some(sent) = image.load.as_mut().filter(|sent| sent.value == load) {
                sent.stamp = sent.stamp.max(stamp);
            }
        });
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

    /// Waits until something is older than a limit: since `stamp` by the time of the bus, or from now on by real time,
    /// so that a silent bus is asked too.
    pub(super) async fn older_than(&self, stamp: Duration, limit: Duration) {
        tokio::select! {
            () = self.past(stamp + limit) => {}
            () = sleep(limit) => {}
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
        let motion = Data::new(&[0x27, 0x84, 0x00, 0x54, 0, 0]).unwrap();
        assert!(image.take(MOTION_PDO, &motion, ms(7)));
        assert!(image.motion_since(&before) && !image.is_renewed_since(&before));
        let load = Data::new(&[0x28, 0, 0, 0, 1, 0, 0, 0]).unwrap();
        assert!(image.take(LOAD_PDO, &load, ms(8)));
        assert!(image.is_renewed_since(&before));
        let motion = image.motion.unwrap();
        assert_eq!(
            (
                motion.value.statusword,
                motion.value.position_qc,
                motion.stamp
            ),
            (Statusword(0x8427), 21_504, ms(7))
        );
        let load = image.load.unwrap().value;
        assert_eq!((load.current_ma, load.inputs), (40, 1));
    }

    #[test]
    fn a_frame_that_is_too_short_or_not_ours_is_not_taken() {
        let mut image = Image::default();
        let short = Data::new(&[0x27, 0x84, 0x00]).unwrap();
        assert!(!image.take(MOTION_PDO, &short, ms(1)));
        assert!(!image.take(3, &short, ms(1)));
        assert_eq!(image, Image::default());
    }
}
