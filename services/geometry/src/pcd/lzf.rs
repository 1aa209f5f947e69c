//! LZF, the packing of binary_compressed PCD files (format of Marc Lehmann's liblzf).
//!
//! The packed bytes are chunks, each opened by a byte whose upper three bits say what it is. `000`: a run of 1 to 32
//! bytes follows, as many as the lower five bits plus one. Anything else: bytes that came before are repeated, three to
//! 264 of them; the upper bits hold the length minus two, seven meaning that the next byte is to be added, and the lower
//! five bits with one more byte hold how far back they begin, minus one.

/// Longest run of bytes that are copied as they are.
const MAX_RUN: usize = 32;
/// Longest and shortest repetition; shorter ones would save nothing.
const MAX_REPEAT: usize = 264;
const MIN_REPEAT: usize = 3;
/// How far back a repetition may begin.
const MAX_DISTANCE: usize = 1 << 13;

/// Why packed bytes could not be unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Error {
    #[error("the packed data end within a chunk")]
    CutShort,
    #[error("byte {at} of the unpacked data repeats what lies {distance} bytes back")]
    BeforeStart { at: usize, distance: usize },
    #[error("the packed data hold {got} bytes, {announced} are announced")]
    WrongLength { got: usize, announced: usize },
}

/// Unpacks exactly `length` bytes. Never holds more than them and one chunk.
pub(super) fn unpack(mut packed: &[u8], length: usize) -> Result<Vec<u8>, Error> {
    let mut out = Vec::with_capacity(length.min(packed.len().saturating_mul(MAX_REPEAT)));
    while let Some(control) = take(&mut packed) {
        let (kind, low) = (usize::from(control >> 5), usize::from(control & 0x1F));
        if kind == 0 {
            let (run, rest) = packed.split_at_checked(low + 1).ok_or(Error::CutShort)?;
            out.extend_from_slice(run);
            packed = rest;
        } else {
            let mut repeat = kind + 2;
            if kind == 7 {
                repeat += usize::from(take(&mut packed).ok_or(Error::CutShort)?);
            }
            let distance = (low << 8 | usize::from(take(&mut packed).ok_or(Error::CutShort)?)) + 1;
            let at = out.len();
            let start = at
                .checked_sub(distance)
                .ok_or(Error::BeforeStart { at, distance })?;
            // A repetition may run into itself: `aaaa` is an `a` and a repetition of it from one byte back.
            for index in start..start + repeat {
                out.push(out[index]);
            }
        }
        if out.len() > length {
            break;
        }
    }
    if out.len() != length {
        return Err(Error::WrongLength {
            got: out.len(),
            announced: length,
        });
    }
    Ok(out)
}

fn take(bytes: &mut &[u8]) -> Option<u8> {
    let (first, rest) = bytes.split_first()?;
    *bytes = rest;
    Some(*first)
}

/// Packs bytes, greedily: of the places where the next three bytes stood before, the last one known is tried.
pub(super) fn pack(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len() + bytes.len() / MAX_RUN + 1);
    // Where three bytes that hash to this index stood last, plus one.
    let mut seen = vec![0_usize; 1 << HASH_BITS];
    let (mut at, mut run_start) = (0, 0);
    while let Some(next) = bytes[at..].first_chunk::<MIN_REPEAT>() {
        let last = std::mem::replace(&mut seen[hash(*next)], at + 1);
        let repeat = match last.checked_sub(1) {
            Some(start) if at - start <= MAX_DISTANCE => common(bytes, start, at),
            _ => 0,
        };
        if repeat < MIN_REPEAT {
            at += 1;
            continue;
        }
        put_runs(&mut out, &bytes[run_start..at]);
        put_repeat(&mut out, at + 1 - last, repeat);
        at += repeat;
        run_start = at;
    }
    put_runs(&mut out, &bytes[run_start..]);
    out
}

const HASH_BITS: u32 = 14;

fn hash([a, b, c]: [u8; MIN_REPEAT]) -> usize {
    let word = u32::from_le_bytes([a, b, c, 0]);
    // Knuth's multiplicative hash.
    (word.wrapping_mul(2_654_435_761) >> (32 - HASH_BITS)) as usize
}

/// How many bytes from `earlier` and from `later` on are the same.
fn common(bytes: &[u8], earlier: usize, later: usize) -> usize {
    bytes[earlier..]
        .iter()
        .zip(&bytes[later..])
        .take(MAX_REPEAT)
        .take_while(|(a, b)| a == b)
        .count()
}

fn put_runs(out: &mut Vec<u8>, bytes: &[u8]) {
    for run in bytes.chunks(MAX_RUN) {
        out.push((run.len() - 1) as u8);
        out.extend_from_slice(run);
    }
}

fn put_repeat(out: &mut Vec<u8>, distance: usize, repeat: usize) {
    let (back, length) = (distance - 1, repeat - 2);
    let high = (back >> 8) as u8;
    if length < 7 {
        out.push((length as u8) << 5 | high);
    } else {
        out.push(7 << 5 | high);
        out.push((length - 7) as u8);
    }
    out.push(back as u8);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_packed_unpacks_the_same(
            bytes in prop::collection::vec(0_u8..4, 0..3000),
            noise in prop::collection::vec(any::<u8>(), 0..3000),
        ) {
            for bytes in [bytes, noise] {
                prop_assert_eq!(unpack(&pack(&bytes), bytes.len()), Ok(bytes));
            }
        }

        #[test]
        fn whatever_is_unpacked_has_the_announced_length(
            packed in prop::collection::vec(any::<u8>(), 0..300),
            length in 0_usize..2000,
        ) {
            if let Ok(bytes) = unpack(&packed, length) {
                prop_assert_eq!(bytes.len(), length);
            }
        }
    }

    #[test]
    fn chunks_are_read_as_liblzf_writes_them() {
        // A run of `abc`, then 4 bytes from 3 back, then 9 + 1 bytes from 1 back.
        let packed = [2, b'a', b'b', b'c', 2 << 5, 2, 7 << 5, 1, 0];
        assert_eq!(
            unpack(&packed, 17).as_deref(),
            Ok(&b"abcabcaaaaaaaaaaa"[..])
        );
    }

    #[test]
    fn repetitions_are_found_and_far_ones_are_not_tried() {
        let zeros = vec![0; 100_000];
        assert!(pack(&zeros).len() < 1200);
        let mut far: Vec<u8> = (0..4).collect();
        far.extend(std::iter::repeat_n(9, MAX_DISTANCE));
        far.extend(0..4);
        assert_eq!(unpack(&pack(&far), far.len()), Ok(far));
    }

    #[test]
    fn broken_chunks_are_refused() {
        assert_eq!(unpack(&[5, 1, 2], 6), Err(Error::CutShort));
        assert_eq!(unpack(&[0, 1, 7 << 5], 6), Err(Error::CutShort));
        let before_start = Error::BeforeStart { at: 1, distance: 2 };
        assert_eq!(unpack(&[0, 1, 1 << 5, 1], 4), Err(before_start));
        let error = unpack(&[0, 1], 2).unwrap_err().to_string();
        assert_eq!(error, "the packed data hold 1 bytes, 2 are announced");
        assert!(unpack(&[1, 1, 1], 1).is_err());
    }
}
