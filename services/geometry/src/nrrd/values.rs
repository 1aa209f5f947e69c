//! The voxels of a file as typed values. Nothing is allocated before the bytes at hand could hold what is announced.

use std::io::Read;

use flate2::read::MultiGzDecoder;

use super::Error;
use super::header::Header;
use crate::scan::{ByteOrder, MAX_BYTES, VoxelType, Voxels};

/// Deflate cannot shrink data further than to a 1032th.
const MAX_GZIP_RATIO: usize = 1032;
/// Characters of a word that a refusal repeats.
const MAX_QUOTED: usize = 40;
/// Bytes that are converted at a time; whole values of every type.
const BUFFER_BYTES: usize = 1 << 16;

enum Encoding {
    Raw,
    Gzip,
    Text,
}

/// Reads `count` values of the type that the header names.
pub(super) fn read(header: &Header, count: usize, bytes: &[u8]) -> Result<Voxels, Error> {
    let kind = voxel_type(header)?;
    let announced = count as u128 * kind.bytes() as u128;
    if announced > MAX_BYTES as u128 {
        return Err(Error::TooMany {
            bytes: announced,
            limit: MAX_BYTES,
        });
    }
    let length = count * kind.bytes();
    let short = Error::Short { announced: count };
    let bytes = after_skipped_lines(header, bytes)?;
    let skip = header.get("byte skip").unwrap_or("0");
    match encoding(header)? {
        Encoding::Text => values_of_text(after_skipped(skip, bytes, header)?, kind, count),
        Encoding::Raw if skip == "-1" => {
            let first = bytes.len().checked_sub(length).ok_or(short)?;
            values(&bytes[first..], kind, byte_order(header, kind)?, count)
        }
        Encoding::Raw => {
            let bytes = after_skipped(skip, bytes, header)?;
            if bytes.len() < length {
                return Err(short);
            }
            values(bytes, kind, byte_order(header, kind)?, count)
        }
        Encoding::Gzip => {
            // A skip counts unpacked bytes; no writer is known to use one here.
            if skip != "0" {
                return Err(header.refuse("byte skip", "0 for gzip voxels"));
            }
            if bytes.len().saturating_mul(MAX_GZIP_RATIO) < length {
                return Err(short);
            }
            let unpacked = MultiGzDecoder::new(bytes);
            values(unpacked, kind, byte_order(header, kind)?, count)
        }
    }
}

fn voxel_type(header: &Header) -> Result<VoxelType, Error> {
    Ok(match header.need("type")? {
        "signed char" | "int8" | "int8_t" => VoxelType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => VoxelType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            VoxelType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            VoxelType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => VoxelType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => VoxelType::U32,
        "float" => VoxelType::F32,
        "double" => VoxelType::F64,
        _ => {
            let known = "int8, uint8, int16, uint16, int32, uint32, float or double";
            return Err(header.refuse("type", known));
        }
    })
}

fn encoding(header: &Header) -> Result<Encoding, Error> {
    match header.need("encoding")?.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        "text" | "txt" | "ascii" => Ok(Encoding::Text),
        _ => Err(header.refuse("encoding", "raw, gzip or text")),
    }
}

/// The order of a value's bytes; a value of one byte has none.
fn byte_order(header: &Header, kind: VoxelType) -> Result<ByteOrder, Error> {
    if kind.bytes() == 1 {
        return Ok(ByteOrder::Little);
    }
    match header.need("endian")? {
        "little" => Ok(ByteOrder::Little),
        "big" => Ok(ByteOrder::Big),
        _ => Err(header.refuse("endian", "little or big")),
    }
}

fn after_skipped_lines<'a>(header: &Header, mut bytes: &'a [u8]) -> Result<&'a [u8], Error> {
    let Some(lines) = header.get("line skip") else {
        return Ok(bytes);
    };
    let wrong = || {
        header.refuse(
            "line skip",
            "a whole number, at most the lines before the voxels",
        )
    };
    for _ in 0..lines.parse::<usize>().map_err(|_| wrong())? {
        let end = bytes.iter().position(|byte| *byte == b'\n');
        bytes = &bytes[end.ok_or_else(wrong)? + 1..];
    }
    Ok(bytes)
}

fn after_skipped<'a>(skip: &str, bytes: &'a [u8], header: &Header) -> Result<&'a [u8], Error> {
    let skip = skip.parse::<usize>().ok();
    skip.and_then(|skip| bytes.get(skip..)).ok_or_else(|| {
        let limit = "-1 for raw voxels, or a whole number of bytes that are there";
        header.refuse("byte skip", limit)
    })
}

/// Reads exactly `count` values; the caller has made sure that the source may hold them.
fn values(
    mut source: impl Read,
    kind: VoxelType,
    order: ByteOrder,
    count: usize,
) -> Result<Voxels, Error> {
    let mut voxels = Voxels::with_capacity(kind, count);
    let mut buffer = vec![0; BUFFER_BYTES.min(count * kind.bytes())];
    let mut missing = count * kind.bytes();
    while missing > 0 {
        let chunk = &mut buffer[..missing.min(BUFFER_BYTES)];
        source
            .read_exact(chunk)
            .map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => Error::Short { announced: count },
                _ => Error::Damaged(error),
            })?;
        voxels.append(chunk, order);
        missing -= chunk.len();
    }
    // Reading on also checks the checksum at the end of gzip data.
    match source.read(&mut [0]) {
        Ok(0) => Ok(voxels),
        Ok(_) => Err(Error::Long { announced: count }),
        Err(error) => Err(Error::Damaged(error)),
    }
}

fn values_of_text(text: &[u8], kind: VoxelType, count: usize) -> Result<Voxels, Error> {
    let short = Error::Short { announced: count };
    // A number takes at least one byte and, but for the last, a space.
    if text.len().div_ceil(2) < count {
        return Err(short);
    }
    let mut voxels = Voxels::with_capacity(kind, count);
    let words = text.split(u8::is_ascii_whitespace);
    for (index, word) in words.filter(|word| !word.is_empty()).enumerate() {
        if index == count {
            return Err(Error::Long { announced: count });
        }
        let word = String::from_utf8_lossy(word);
        voxels.append_word(&word).ok_or_else(|| Error::Number {
            index,
            text: word.chars().take(MAX_QUOTED).collect(),
        })?;
    }
    if voxels.len() < count {
        return Err(short);
    }
    Ok(voxels)
}
