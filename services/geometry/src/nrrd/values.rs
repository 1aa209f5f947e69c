//! The voxels of a file as typed values. Nothing is allocated before the bytes at hand could hold what is announced.

use std::io::Read;
use std::str::FromStr;

use flate2::read::MultiGzDecoder;

use super::Error;
use super::header::Header;
use crate::scan::{MAX_BYTES, Voxels};

/// Deflate cannot shrink data further than to a 1032th.
const MAX_GZIP_RATIO: usize = 1032;
/// Bytes that are converted at a time.
const BUFFER_BYTES: usize = 1 << 16;

#[derive(Clone, Copy, PartialEq)]
enum Endian {
    Little,
    Big,
}

enum Encoding {
    Raw,
    Gzip,
    Text,
}

/// Reads `count` values of the type that the header names.
pub(super) fn read(header: &Header, count: usize, bytes: &[u8]) -> Result<Voxels, Error> {
    Ok(match header.need("type")? {
        "signed char" | "int8" | "int8_t" => Voxels::I8(typed(header, count, bytes)?),
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Voxels::U8(typed(header, count, bytes)?),
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Voxels::I16(typed(header, count, bytes)?)
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            Voxels::U16(typed(header, count, bytes)?)
        }
        "int" | "signed int" | "int32" | "int32_t" => Voxels::I32(typed(header, count, bytes)?),
        "uint" | "unsigned int" | "uint32" | "uint32_t" => {
            Voxels::U32(typed(header, count, bytes)?)
        }
        "float" => Voxels::F32(typed(header, count, bytes)?),
        "double" => Voxels::F64(typed(header, count, bytes)?),
        _ => {
            return Err(header.refuse(
                "type",
                "int8, uint8, int16, uint16, int32, uint32, float or double",
            ));
        }
    })
}

fn typed<T: Number>(header: &Header, count: usize, bytes: &[u8]) -> Result<Vec<T>, Error> {
    let announced = count as u128 * T::BYTES as u128;
    if announced > MAX_BYTES as u128 {
        return Err(Error::TooMany {
            bytes: announced,
            limit: MAX_BYTES,
        });
    }
    let bytes = after_skipped_lines(header, bytes)?;
    let skip = header.get("byte skip").unwrap_or("0");
    let wrong_skip = || header.refuse("byte skip", "-1 for raw voxels, or a whole number");
    match encoding(header)? {
        Encoding::Text => values_of_text(&bytes[skipped(skip, bytes, wrong_skip)?..], count),
        Encoding::Raw if skip == "-1" => {
            let first = bytes
                .len()
                .checked_sub(count * T::BYTES)
                .ok_or(Error::Short { announced: count })?;
            values(&bytes[first..], endian::<T>(header)?, count)
        }
        Encoding::Raw => {
            let bytes = &bytes[skipped(skip, bytes, wrong_skip)?..];
            if bytes.len() < count * T::BYTES {
                return Err(Error::Short { announced: count });
            }
            values(bytes, endian::<T>(header)?, count)
        }
        Encoding::Gzip => {
            // A skip counts unpacked bytes; no file is known to have one, and none is guessed.
            if skip != "0" {
                return Err(header.refuse("byte skip", "0 for gzip voxels"));
            }
            if bytes.len().saturating_mul(MAX_GZIP_RATIO) < count * T::BYTES {
                return Err(Error::Short { announced: count });
            }
            values(MultiGzDecoder::new(bytes), endian::<T>(header)?, count)
        }
    }
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
fn endian<T: Number>(header: &Header) -> Result<Endian, Error> {
    if T::BYTES == 1 {
        return Ok(Endian::Little);
    }
    match header.need("endian")? {
        "little" => Ok(Endian::Little),
        "big" => Ok(Endian::Big),
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

fn skipped(skip: &str, bytes: &[u8], wrong: impl Fn() -> Error) -> Result<usize, Error> {
    let skip = skip.parse::<usize>().ok();
    skip.filter(|skip| *skip <= bytes.len()).ok_or_else(wrong)
}

/// Reads exactly `count` values; the caller has made sure that the source may hold them.
fn values<T: Number>(mut source: impl Read, endian: Endian, count: usize) -> Result<Vec<T>, Error> {
    let mut values = Vec::with_capacity(count);
    let mut buffer = vec![0; BUFFER_BYTES.min(count * T::BYTES)];
    while values.len() < count {
        let wanted = buffer.len().min((count - values.len()) * T::BYTES);
        let chunk = &mut buffer[..wanted];
        source
            .read_exact(chunk)
            .map_err(|error| match error.kind() {
                std::io::ErrorKind::UnexpectedEof => Error::Short { announced: count },
                _ => Error::Damaged(error),
            })?;
        T::append(chunk, endian, &mut values);
    }
    // Reading on also checks the checksum at the end of gzip data.
    match source.read(&mut [0]) {
        Ok(0) => Ok(values),
        Ok(_) => Err(Error::Long { announced: count }),
        Err(error) => Err(Error::Damaged(error)),
    }
}

fn values_of_text<T: Number>(text: &[u8], count: usize) -> Result<Vec<T>, Error> {
    // A number takes at least one byte and, but for the last, a space.
    if text.len().div_ceil(2) < count {
        return Err(Error::Short { announced: count });
    }
    let mut values = Vec::with_capacity(count);
    let words = text.split(u8::is_ascii_whitespace);
    for word in words.filter(|word| !word.is_empty()) {
        if values.len() == count {
            return Err(Error::Long { announced: count });
        }
        let number = std::str::from_utf8(word)
            .ok()
            .and_then(|word| word.parse().ok());
        values.push(number.ok_or_else(|| Error::Number {
            index: values.len(),
            text: String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned(),
        })?);
    }
    if values.len() < count {
        return Err(Error::Short { announced: count });
    }
    Ok(values)
}

/// A number as it stands in a file.
trait Number: FromStr {
    const BYTES: usize;
    /// Appends the values of whole numbers of bytes.
    fn append(bytes: &[u8], endian: Endian, values: &mut Vec<Self>);
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Number for $number {
            const BYTES: usize = size_of::<$number>();

            fn append(bytes: &[u8], endian: Endian, values: &mut Vec<Self>) {
                let words = bytes.as_chunks::<{ size_of::<$number>() }>().0;
                match endian {
                    Endian::Little => values.extend(words.iter().map(|w| <$number>::from_le_bytes(*w))),
                    Endian::Big => values.extend(words.iter().map(|w| <$number>::from_be_bytes(*w))),
                }
            }
        }
    )*};
}

numbers!(i8, u8, i16, u16, i32, u32, f32, f64);
