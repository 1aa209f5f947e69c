//! A stream of joint positions on its way to the controller: [`Stream`] keeps the samples that the program has not
//! consumed yet and cuts the [`Window`] that goes out with each package.

use std::collections::VecDeque;

use crate::Error;

/// Samples in a package, one for each controller cycle: what bridges packages that come late.
pub const WINDOW_SAMPLES: usize = 4;

/// Consecutive samples of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Number of the first of them; the first of a stream is 1.
    pub first: i32,
    /// Base, shoulder, elbow, wrist 1, 2, 3, a controller cycle apart at nominal speed. Beyond the end of the stream the
    /// last sample again.
    pub joints_rad: [[f64; 6]; WINDOW_SAMPLES],
    /// Number of the last sample of the stream, which is held once it is reached. None while it is not known: then a
    /// program that has consumed the whole window stops the arm and reports [`Fault::Starved`](crate::Fault::Starved).
    pub last: Option<i32>,
}

impl Window {
    /// The samples with their numbers, each once.
    pub fn samples(&self) -> impl Iterator<Item = (i32, &[f64; 6])> {
        (self.first..)
            .zip(&self.joints_rad)
            .take_while(|(number, _)| self.last.is_none_or(|last| *number <= last))
    }
}

/// The samples of one stream that are not consumed yet.
///
/// Time does not come into it: a sample goes out again and again until the program has consumed it, however long the
/// speed slider, a late package or a slow clock makes that take, and then the next one is due. None is skipped.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    /// The first is the one after the last consumed; at the end the last sample stays.
    samples: VecDeque<[f64; 6]>,
    pushed: i32,
    consumed: i32,
    ended: bool,
}

impl Stream {
    /// Nothing pushed yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Another sample is needed to fill the window.
    pub fn wants(&self) -> bool {
        !self.ended && self.samples.len() < WINDOW_SAMPLES
    }

    /// The number that the next sample pushed will have.
    pub fn next_number(&self) -> i32 {
        self.pushed + 1
    }

    /// Appends a sample, rad. After [`Stream::end`] it is ignored.
    pub fn push(&mut self, joints_rad: [f64; 6]) {
        if !self.ended {
            self.samples.push_back(joints_rad);
            self.pushed += 1;
        }
    }

    /// The sample pushed last is the last of the stream.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// Takes note of what the program has consumed, as
    /// [`ProgramState::sample_consumed`](crate::ProgramState::sample_consumed) tells.
    ///
    /// # Errors
    /// [`Error::Refused`] for a number that goes back, or beyond what was pushed.
    pub fn consume(&mut self, number: i32) -> Result<(), Error> {
        if !(self.consumed..=self.pushed).contains(&number) {
            return Err(Error::Refused {
                request: format!("samples {} to {}", self.consumed + 1, self.pushed),
                answer: format!("sample {number} consumed"),
            });
        }
        while self.consumed < number {
            self.consumed += 1;
            if self.samples.len() > 1 || !self.ended {
                self.samples.pop_front();
            }
        }
        Ok(())
    }

    /// Every sample up to the end was consumed.
    pub fn is_consumed(&self) -> bool {
        self.ended && self.consumed == self.pushed
    }

    /// What to send now. None while the stream wants samples.
    pub fn window(&self) -> Option<Window> {
        if self.wants() {
            return None;
        }
        let newest = *self.samples.back()?;
        let held = i32::try_from(self.samples.len()).ok()?;
        let mut joints_rad = [newest; WINDOW_SAMPLES];
        joints_rad
            .iter_mut()
            .zip(&self.samples)
            .for_each(|(slot, sample)| *slot = *sample);
        Some(Window {
            first: self.pushed - held + 1,
            joints_rad,
            last: self.ended.then_some(self.pushed),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sample(number: i32) -> [f64; 6] {
        [f64::from(number); 6]
    }

    proptest! {
        /// A program that consumes at any pace, seeing packages late or not at all, gets every sample once and in order.
        #[test]
        fn no_sample_is_skipped_at_any_pace(
            length in 1..60_i32,
            paces in prop::collection::vec((0..3_usize, any::<bool>()), 400),
        ) {
            let mut stream = Stream::new();
            let mut seen: Option<Window> = None;
            let mut got = Vec::new();
            for (pace, arrives) in paces {
                stream.consume(got.len() as i32).unwrap();
                while stream.wants() {
                    stream.push(sample(stream.next_number()));
                    if stream.next_number() > length {
                        stream.end();
                    }
                }
                if arrives {
                    seen = stream.window();
                }
                let Some(window) = seen else { continue };
                for _ in 0..pace {
                    let next = got.len() as i32 + 1;
                    if let Some((_, joints)) = window.samples().find(|(number, _)| *number == next) {
                        got.push(*joints);
                    }
                }
            }
            stream.consume(got.len() as i32).unwrap();
            let sent: Vec<_> = (1..=got.len() as i32).map(sample).collect();
            prop_assert_eq!(&got, &sent);
            prop_assert_eq!(stream.is_consumed(), got.len() as i32 == length);
        }
    }

    #[test]
    fn a_consumed_number_that_cannot_be_is_refused() {
        let mut stream = Stream::new();
        (1..=4).for_each(|number| stream.push(sample(number)));
        stream.consume(2).unwrap();
        assert!(stream.consume(1).is_err());
        assert!(stream.consume(5).is_err());
        assert!(stream.wants());
        assert_eq!(stream.window(), None);
    }

    #[test]
    fn the_end_is_held() {
        let mut stream = Stream::new();
        (1..=2).for_each(|number| stream.push(sample(number)));
        stream.end();
        stream.consume(2).unwrap();
        let window = stream.window().unwrap();
        assert_eq!((window.first, window.last), (2, Some(2)));
        assert_eq!(window.joints_rad, [sample(2); 4]);
        assert!(stream.is_consumed());
    }
}
