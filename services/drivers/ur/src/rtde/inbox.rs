//! What a connection received and nobody has read yet, without I/O: cuts frames off a buffer of fixed size, and finds the
//! newest data package in it.

use super::wire::{self, Frame, MAX_FRAME_BYTES, Reply, Text, Version};

/// Room for the largest frame and a read of half the buffer behind it.
const CAPACITY: usize = 2 * (MAX_FRAME_BYTES + 1);

/// Bytes received.
#[derive(Debug)]
pub struct Inbox {
    bytes: Box<[u8]>,
    /// First byte not read.
    start: usize,
    /// Behind the last byte received.
    end: usize,
}

/// Which data packages count, and how long they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// Version in use.
    pub version: Version,
    /// Recipe of the packages; version 1 does not tell.
    pub recipe: u8,
    /// Bytes of all fields.
    pub payload_bytes: usize,
}

impl Default for Inbox {
    fn default() -> Self {
        Self {
            bytes: vec![0; CAPACITY].into_boxed_slice(),
            start: 0,
            end: 0,
        }
    }
}

impl Inbox {
    /// Where to receive to: at least half the buffer, as long as all whole frames were taken.
    pub fn space(&mut self) -> &mut [u8] {
        if self.start > 0 {
            self.bytes.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        &mut self.bytes[self.end..]
    }

    /// So many bytes were received to [`space`](Self::space).
    pub fn received(&mut self, bytes: usize) {
        self.end = (self.end + bytes).min(self.bytes.len());
    }

    /// Takes the next whole frame.
    ///
    /// # Errors
    /// A size that cannot be.
    pub fn next(&mut self) -> Result<Option<Frame<'_>>, wire::Error> {
        let frame = Frame::first(&self.bytes[self.start..self.end])?;
        if let Some(frame) = frame {
            self.start += frame.size();
        }
        Ok(frame)
    }

    /// Takes all whole frames. The fields of the newest wanted data package replace `newest`; gives the number of such
    /// packages. Messages go to `log`; other replies, and packages of other recipes, are dropped.
    ///
    /// # Errors
    /// Anything that is not the protocol, and a data package that does not fit its recipe.
    pub fn take_newest(
        &mut self,
        wanted: &Wanted,
        newest: &mut Vec<u8>,
        mut log: impl FnMut(Text),
    ) -> Result<u64, wire::Error> {
        let mut packages = 0;
        let mut last = None;
        while let Some(frame) = Frame::first(&self.bytes[self.start..self.end])? {
            let next = self.start + frame.size();
            if !frame.is_data() {
                if let Reply::Text(text) = Reply::decode(frame, wanted.version)? {
                    log(text);
                }
            } else if let Some(fields) = wanted.fields(frame)? {
                packages += 1;
                last = Some(next - fields..next);
            }
            self.start = next;
        }
        if let Some(last) = last {
            newest.clear();
            newest.extend_from_slice(&self.bytes[last]);
        }
        Ok(packages)
    }
}

impl Wanted {
    /// Bytes of the fields at the end of this data package; `None` for another recipe.
    fn fields(&self, frame: Frame<'_>) -> Result<Option<usize>, wire::Error> {
        let fields = match (self.version, frame.payload) {
            (Version::V1, fields) => fields.len(),
            (Version::V2, []) => return Err(wire::Error::Short(frame.kind)),
            (Version::V2, [recipe, ..]) if *recipe != self.recipe => return Ok(None),
            (Version::V2, [_, fields @ ..]) => fields.len(),
        };
        match fields.checked_sub(self.payload_bytes) {
            Some(0) => Ok(Some(fields)),
            Some(more) => Err(wire::Error::Long(frame.kind, more)),
            None => Err(wire::Error::Short(frame.kind)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WANTED: Wanted = Wanted {
        version: Version::V2,
        recipe: 1,
        payload_bytes: 8,
    };

    fn package(recipe: u8, number: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        wire::data_frame(&mut bytes, Some(recipe), |out| {
            out.extend(number.to_be_bytes())
        });
        bytes
    }

    proptest! {
        #[test]
        fn the_newest_package_is_found_however_the_stream_is_cut(
            recipes in proptest::collection::vec(1..3u8, 1..60),
            cuts in proptest::collection::vec(1..40usize, 1..200),
        ) {
            let stream: Vec<u8> = (0u64..).zip(&recipes).flat_map(|(number, recipe)| package(*recipe, number)).collect();
            let expected = recipes.iter().rposition(|recipe| *recipe == 1).map(|number| number as u64);
            let (mut inbox, mut newest, mut packages) = (Inbox::default(), Vec::new(), 0);
            let mut rest = &stream[..];
            for cut in cuts.iter().cycle() {
                if rest.is_empty() {
                    break;
                }
                let (now, later) = rest.split_at((*cut).min(rest.len()));
                inbox.space()[..now.len()].copy_from_slice(now);
                inbox.received(now.len());
                packages += inbox.take_newest(&WANTED, &mut newest, |_| {}).unwrap();
                rest = later;
            }
            prop_assert_eq!(packages as usize, recipes.iter().filter(|recipe| **recipe == 1).count());
            if let Some(number) = expected {
                prop_assert_eq!(&newest[..], number.to_be_bytes());
            }
        }

        #[test]
        fn any_bytes_leave_room_for_more_or_are_an_error(chunks in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..2000), 0..200)) {
            let (mut inbox, mut newest) = (Inbox::default(), Vec::new());
            for chunk in chunks {
                let space = inbox.space();
                prop_assert!(space.len() > CAPACITY / 2 - 2);
                space[..chunk.len()].copy_from_slice(&chunk);
                inbox.received(chunk.len());
                if inbox.take_newest(&WANTED, &mut newest, |_| {}).is_err() {
                    break;
                }
            }
        }
    }

    #[test]
    fn a_package_that_does_not_fit_its_recipe_is_an_error() {
        for (fields, error) in [
            (7usize, wire::Error::Short(b'U')),
            (10, wire::Error::Long(b'U', 2)),
        ] {
            let mut bytes = Vec::new();
            wire::data_frame(&mut bytes, Some(1), |out| out.extend(vec![0; fields]));
            let mut inbox = Inbox::default();
            inbox.space()[..bytes.len()].copy_from_slice(&bytes);
            inbox.received(bytes.len());
            assert_eq!(
                inbox.take_newest(&WANTED, &mut Vec::new(), |_| {}),
                Err(error)
            );
        }
    }

    #[test]
    fn the_largest_frame_fits() {
        let mut bytes = Vec::new();
        wire::data_frame(&mut bytes, Some(2), |out| {
            out.extend(vec![7; MAX_FRAME_BYTES - 4])
        });
        assert_eq!(bytes.len(), MAX_FRAME_BYTES);
        let mut inbox = Inbox::default();
        let (head, tail) = bytes.split_at(MAX_FRAME_BYTES - 1);
        for part in [head, tail, head, tail] {
            inbox.space()[..part.len()].copy_from_slice(part);
            inbox.received(part.len());
            inbox.take_newest(&WANTED, &mut Vec::new(), |_| {}).unwrap();
        }
        assert_eq!(inbox.next(), Ok(None));
    }
}
